"""One process at a time writes into an output folder.

The lock is the operating system's own on `.runningfix/lock`, so that it ends with its process, however that ends.
The file holds who has it, for the message to the next.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

from calibration.foundation.errors import WriteError
from calibration.foundation.files import cannot_write

if sys.platform == "win32":  # pragma: no cover - the tests run on POSIX
    import msvcrt

    def _take(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Holds the lock file `path`, which goes away at the end.

    Raises WriteError where another process holds it, named, and where the folder cannot be written.
    """
    handle = _acquire(path)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(handle)


def _acquire(path: Path) -> int:
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError as error:
            raise cannot_write(path, error) from None
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise cannot_write(path, OSError(0, "a pipe or device where our lock file goes"))
        try:
            _take(handle)
        except (BlockingIOError, PermissionError):
            holder = os.read(handle, 200).decode(errors="replace").strip()
            os.close(handle)
            raise _busy(path, holder) from None
        except OSError:  # a file system without locks: as before there were any
            return handle
        if _still_there(path, handle):
            with contextlib.suppress(
                OSError
            ):  # a full disk: the lock holds without a name; what is written next says it
                os.ftruncate(handle, 0)
                os.write(handle, f"{os.getpid()} on {socket.gethostname()}".encode())
            return handle
        os.close(handle)  # its holder ended between our opening and our taking it: the file is gone


def _still_there(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except OSError:
        return False


def _busy(path: Path, holder: str) -> WriteError:
    return WriteError(
        where=str(path.parent.parent),
        seen=f"process {holder or 'unknown'} is writing results here",
        expected="one run at a time in a folder",
        advice="wait for it to end, or choose another -o folder",
    )
