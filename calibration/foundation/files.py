"""Files appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from calibration.foundation.errors import InputFileError, WriteError


def read_bytes(path: Path, *, expected: str) -> bytes:
    """The content of `path`; `expected` says in words what kind of file it should be.

    Raises InputFileError where the file is missing or cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputFileError(
            where=str(path),
            seen="no such file",
            expected=expected,
            advice=f"check the name; files are looked for from {path.parent.resolve()}",
        ) from None
    except OSError as error:
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read ({error.strerror})",
            expected=expected,
            advice="check that it is a file and its permissions",
        ) from None


def write_whole(path: Path, content: bytes | str) -> None:
    """Write `content` so that a reader, or a crash at any moment, sees the old file or the new one.

    Raises WriteError where the folder cannot be written.
    """
    raw = content.encode() if isinstance(content, str) else content
    part = path.with_name(f".{path.name}.part")  # always the same, so that a killed run's part is written over
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as out:
            out.write(raw)
            out.flush()
            os.fsync(out.fileno())
        os.replace(part, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise WriteError(
            where=str(path),
            seen=f"cannot be written ({error.strerror})",
            expected="a writable folder with free space",
            advice="choose another -o folder",
        ) from None
