"""Which files are opened as videos: regular ones, by their bytes, and none that only names others."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from calibration.foundation.errors import InputFileError
from calibration.foundation.files import check_regular

HEAD_BYTES = 512
"""Of a file that are looked at: no container is text for so long; playlists, concat scripts and manifests are."""
RAW_HEAD = b"YUV4MPEG2"
"""The one kind of video that begins as text."""


def open_video(path: Path, expected: str = "a video") -> BinaryIO:
    """The video at `path`, open for reading: whoever decodes it is given bytes, never a name.

    Raises InputFileError where it is no regular file, cannot be read, or is text that names other files.
    """
    check_regular(path, expected=expected)
    try:
        file = path.open("rb")
        head = file.read(HEAD_BYTES)
        file.seek(0)
    except OSError as error:
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read ({error.strerror})",
            expected=expected,
            advice="check its permissions",
        ) from None
    if _is_text(head):
        file.close()
        raise InputFileError(
            where=str(path),
            seen="text, such as a playlist or a script that names other files",
            expected="one video file (mp4, mov, mkv, avi, ts ...)",
            advice="name the recording itself; join several with ffmpeg first",
        )
    return file


def _is_text(head: bytes) -> bool:
    if not head.strip() or head.startswith(RAW_HEAD):
        return False
    return all(byte >= 32 or byte in b"\t\n\r\f" for byte in head) and 127 not in head
