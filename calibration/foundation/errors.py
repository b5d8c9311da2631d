"""What goes wrong, said once and well: where, what was seen, what was expected, what to try.

Every error a user can cause is a `RunningFixError`; its class decides the exit code of the command line.
"""

from __future__ import annotations

DID_NOT_CONVERGE = 7
"""Exit code of a run that ended without an answer to be used: not an error, a status of the solution."""


class RunningFixError(Exception):
    """One message for one mistake.

    where     file, key, frame or time the mistake sits at
    seen      what was found there
    expected  what would have been right
    advice    what the user can try next
    """

    exit_code = 1

    def __init__(self, *, where: str, seen: str, expected: str, advice: str) -> None:
        self.where, self.seen, self.expected, self.advice = where, seen, expected, advice
        super().__init__(f"{where}: {seen}; expected {expected}. Try: {advice}")

    def __reduce__(self) -> tuple[object, ...]:
        """So that an error crosses from a worker process whole."""
        return _again, (type(self), self.where, self.seen, self.expected, self.advice)


def _again(kind: type[RunningFixError], where: str, seen: str, expected: str, advice: str) -> RunningFixError:
    return kind(where=where, seen=seen, expected=expected, advice=advice)


class UsageError(RunningFixError):
    """The command line or the configuration is wrong."""

    exit_code = 2


class InputFileError(RunningFixError):
    """An input file is missing, unreadable, truncated or says something impossible."""

    exit_code = 3


class TrackingError(RunningFixError):
    """The video could be read, but a target could not be followed."""

    exit_code = 4


class GeometryError(RunningFixError):
    """The observations cannot determine the answer."""

    exit_code = 5


class WriteError(RunningFixError):
    """A result could not be written."""

    exit_code = 6


class CalibrationError(RunningFixError):
    """The photos are readable, but they cannot determine the camera."""

    exit_code = 5
