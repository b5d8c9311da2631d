"""The one door that every command leaves through: whatever happens becomes one message and the right exit code.

Under `--json` that message is a JSON object on standard output too: for usage errors, interrupts, faults of the
program and a full disk as for every user's mistake.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

from calibration.foundation.errors import RunningFixError, UsageError, WriteError
from pipeline.cli.console import Console, OutputClosedError

INTERRUPTED = 130
LONGEST_PART = 600
"""Characters of each part of a message; a name of megabytes is cut in its middle."""
LEAST_ADDRESSES = 512_000_000
"""Bytes: with fewer, OpenBLAS cannot be loaded and does not return. What needs more says so itself."""
OF_MEMORY = ("failed to map segment", "cannot allocate memory", "can't start new thread", "unable to allocate")
"""In what libraries say where memory was not enough."""


class InternalError(RunningFixError):
    """A fault of the program, not of the user."""

    exit_code = 1


class EndedByUserError(RunningFixError):
    """The user ended the command."""

    exit_code = INTERRUPTED


def through_door(command: str, action: Callable[[], int], console: Console) -> int:
    """Does `action`; its exit code, or that of what went wrong, said once."""
    try:
        return action()
    except KeyboardInterrupt:
        return _said(command, _interrupted(), console)
    except RunningFixError as error:
        return _said(command, error, console)
    except Exception as error:
        console.detail(traceback.format_exc())
        return _said(command, fault(error), console)


def _said(command: str, error: RunningFixError, console: Console) -> int:
    closed = isinstance(error, OutputClosedError)
    with contextlib.suppress(OSError, ValueError):
        console.error(message(error))
    if console.as_json and not closed:
        try:
            console.result(failure(command, error), "")
        except (OutputClosedError, OSError):  # a closed pipe; a full disk behind standard output
            closed = True
    if closed:
        silence_stdout()
    return error.exit_code


def message(error: RunningFixError) -> str:
    """The four parts in a line, without control characters."""
    where, seen, expected, advice = (cut(part) for part in (error.where, error.seen, error.expected, error.advice))
    return f"{where}: {seen}; expected {expected}. Try: {advice}"


def failure(command: str, error: RunningFixError) -> dict[str, Any]:
    """The machine-readable form of a mistake."""
    parts = {name: cut(getattr(error, name)) for name in ("where", "seen", "expected", "advice")}
    return {"status": "error", "command": command, "exit_code": error.exit_code, "error": parts}


def cut(text: str) -> str:
    """`text` as it is safe and short enough to show."""
    shown = text if len(text) <= LONGEST_PART else f"{text[: LONGEST_PART // 2]} ... {text[-LONGEST_PART // 2 :]}"
    return "".join(c if c.isprintable() else " " if c.isspace() else f"\\x{ord(c):02x}" for c in shown)


def fault(error: Exception) -> RunningFixError:
    """What an exception that nobody expected is for the user."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return WriteError(
            where=str(error.filename or "a temporary file"),
            seen="cannot be written (no space left)",
            expected="free space on the disk",
            advice="make room, then give the same command again",
        )
    if is_of_memory(error):
        return _out_of_memory("not enough", f"room for what was asked ({error})")
    frame = traceback.extract_tb(error.__traceback__)[-1] if error.__traceback__ else None
    place = "runningfix" if frame is None else f"{os.path.basename(frame.filename)}, line {frame.lineno}"
    return InternalError(
        where=place,
        seen=f"{type(error).__name__}: {error}",
        expected="no such thing: this is a fault of the program",
        advice="report it with what --verbose says; the files written so far are whole",
    )


def is_of_memory(error: BaseException) -> bool:
    """Whether memory, or the room for addresses, was not enough: libraries say it in their own ways."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    said = str(error).lower()
    if isinstance(error, ImportError | RuntimeError) and any(words in said for words in OF_MEMORY):
        return True
    behind = error.__cause__ or error.__context__
    return behind is not None and isinstance(error, ImportError) and is_of_memory(behind)


def _out_of_memory(seen: str, expected: str) -> InternalError:
    return InternalError(
        where="memory",
        seen=seen,
        expected=expected,
        advice="close other programs, or raise the limit (`ulimit -v unlimited`)",
    )


def check_address_space() -> None:
    """Refuses a limit of addresses under which NumPy's libraries end the process, or wait for ever, without a word.

    Raises InternalError.
    """
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_ADDRESSES:
        raise _out_of_memory(
            f"a limit of {limit / 1e6:.0f} MB of addresses", f"at least {LEAST_ADDRESSES / 1e6:.0f} MB"
        )


def check_arguments(argv: list[str]) -> None:
    """Refuses bytes that are not text in names, on which libraries that open files by name fail hard, and empty names,
    as an unset variable leaves them: `-o ""` would fill the current folder.

    Raises UsageError.
    """
    for argument in argv:
        if argument in ("", "--output="):
            raise UsageError(
                where="command line",
                seen="an empty argument",
                expected="a name or a value",
                advice="look whether a variable is unset; the current folder is `.`",
            )
        try:
            argument.encode()
        except UnicodeEncodeError:
            raise UsageError(
                where="command line",
                seen=f"{argument.encode(errors='backslashreplace').decode()}, which is not UTF-8",
                expected="names in UTF-8",
                advice="rename the file",
            ) from None


def mend_streams() -> None:
    """Standard streams that are closed lead nowhere, so that no file of ours takes their place; text always passes."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            with contextlib.suppress(OSError, ValueError):
                reconfigure(errors="backslashreplace")
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115


def silence_stdout() -> None:
    """What is still buffered for a closed pipe goes nowhere, instead of failing when Python ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _interrupted() -> EndedByUserError:
    return EndedByUserError(
        where="runningfix",
        seen="interrupted",
        expected="patience",
        advice="the same command goes on from there; what is finished is kept",
    )
