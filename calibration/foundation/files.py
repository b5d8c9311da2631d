"""Files are read within bounds and appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path

from calibration.foundation.errors import InputFileError, WriteError

LARGEST_TEXT_BYTES = 1 << 30
"""Of a file that is read whole, where its reader sets no narrower bound; what is larger is no table of ours."""
LONGEST_NAME = 200
"""Bytes of a file's name: file systems take 255, and a part's name is longer than the whole's."""


def read_bytes(path: Path, *, expected: str, most: int = LARGEST_TEXT_BYTES) -> bytes:
    """The content of `path`; `expected` says in words what kind of file it should be.

    Raises InputFileError where the file is missing, is no regular file, is larger than `most` bytes or cannot be read.
    """
    check_regular(path, expected=expected)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except (OSError, ValueError) as error:
        raise unreadable(path, error, expected) from None
    if len(content) > most:
        raise InputFileError(
            where=str(path),
            seen=f"more than {most:,} bytes",
            expected=f"{expected} of at most that many bytes",
            advice="check that it is the file you mean",
        )
    return content


def check_regular(path: Path, *, expected: str) -> None:
    """Refuses what is missing, a folder, or a pipe or device that could go on for ever. Raises InputFileError."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        raise unreadable(path, error, expected) from None
    if not stat.S_ISREG(mode):
        raise InputFileError(
            where=str(path),
            seen=f"{kind_of(mode)}, not a file",
            expected=expected,
            advice="name a file; what comes through a pipe has to be saved first",
        )


def kind_of(mode: int) -> str:
    """What a file that is no regular file is, in words."""
    kinds = (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
    )
    return next((words for is_kind, words in kinds if is_kind(mode)), "something else")


def unreadable(path: Path, error: Exception, expected: str) -> InputFileError:
    """The error for a file that could not be read."""
    if isinstance(error, FileNotFoundError):
        return InputFileError(
            where=str(path),
            seen="no such file",
            expected=expected,
            advice=f"check the name; files are looked for from {path.parent.resolve()}",
        )
    return InputFileError(
        where=str(path),
        seen=f"cannot be read ({getattr(error, 'strerror', None) or error})",
        expected=expected,
        advice="check that it is a file and its permissions",
    )


def write_whole(path: Path, content: bytes | str) -> None:
    """Write `content` so that a reader, or a crash at any moment, sees the old file or the new one.

    The permissions of a file that was there stay. Raises WriteError where the folder cannot be written, and where
    `path` is a folder, a device or a pipe: those are never replaced.
    """
    raw = content.encode() if isinstance(content, str) else content
    before = _replaceable(path)
    part = path.with_name(part_name(path.name))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        with part.open("xb") as out:
            out.write(raw)
            out.flush()
            if before is not None:
                os.chmod(part, stat.S_IMODE(before.st_mode))
            os.fsync(out.fileno())
        os.replace(part, path)
    except (OSError, ValueError) as error:
        with contextlib.suppress(OSError, ValueError):
            part.unlink(missing_ok=True)
        raise cannot_write(path, error) from None


def part_name(name: str) -> str:
    """The name of a file while it is written: always the same, so that a killed run's part is written over."""
    return f".{name}.part" if len(os.fsencode(name)) <= LONGEST_NAME else f".{name[:40]}{name[-20:]}.part"


def cannot_write(path: Path, error: Exception) -> WriteError:
    """The error for a file that could not be written."""
    return WriteError(
        where=str(path),
        seen=f"cannot be written ({getattr(error, 'strerror', None) or error})",
        expected="a writable folder with free space",
        advice="choose another -o folder",
    )


def _replaceable(path: Path) -> os.stat_result | None:
    """What is at `path` now; None where there is nothing. Raises WriteError where it must not be replaced."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from None
    if not stat.S_ISREG(found.st_mode) or not path.name:
        raise WriteError(
            where=str(path),
            seen=f"{kind_of(found.st_mode)}, not a file",
            expected="the name of a file to write",
            advice="choose another name for -o",
        )
    return found
