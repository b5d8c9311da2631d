"""Errors of the pipeline; each class owns its exit code (0 done, 7 ran but did not converge)."""

from __future__ import annotations

from calibration.errors import InputFileError, RunningFixError, UsageError, WriteError

__all__ = ["GeometryError", "InputFileError", "RunningFixError", "TrackingError", "UsageError", "WriteError"]

DID_NOT_CONVERGE = 7


class TrackingError(RunningFixError):
    """The video could be read, but a target could not be followed."""

    exit_code = 4


class GeometryError(RunningFixError):
    """The observations cannot determine the answer."""

    exit_code = 5
