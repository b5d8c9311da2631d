"""A video as it is named to libraries, which take names for URLs and protocols, and text for a list of other files."""

from __future__ import annotations

import os
from pathlib import Path

from calibration.foundation.errors import InputFileError
from calibration.foundation.files import check_regular

HEAD_BYTES = 512
"""Of a file that are looked at: no container is text for so long; playlists, concat scripts and manifests are."""
RAW_HEAD = b"YUV4MPEG2"
"""The one kind of video that begins as text."""


def video_name(path: Path, expected: str = "a video") -> str:
    """The name under which libraries open the video at `path`: absolute, so that nothing in it is a protocol.

    Raises InputFileError where it is no regular file, its name is not UTF-8, or it is text that names other files.
    """
    check_regular(path, expected=expected)
    name = os.path.abspath(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        raise InputFileError(
            where=ascii(str(path)), seen="a name that is not UTF-8", expected=expected, advice="rename the file"
        ) from None
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read ({error.strerror})",
            expected=expected,
            advice="check its permissions",
        ) from None
    if _is_text(head):
        raise InputFileError(
            where=str(path),
            seen="text, such as a playlist or a script that names other files",
            expected="one video file (mp4, mov, mkv, avi, ts ...)",
            advice="name the recording itself; join several with ffmpeg first",
        )
    return name


def _is_text(head: bytes) -> bool:
    if not head.strip() or head.startswith(RAW_HEAD):
        return False
    return all(byte >= 32 or byte in b"\t\n\r\f" for byte in head) and 127 not in head
