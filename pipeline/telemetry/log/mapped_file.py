"""A file as bytes without reading it into memory."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Ints
from calibration.foundation.errors import InputFileError

Bytes = mmap.mmap | bytes


def mapped(path: Path, *, expected: str) -> Bytes:
    """The content of `path`, mapped; `expected` says in words what it should be.

    Raises InputFileError where the file is missing, empty or cannot be read.
    """
    try:
        with path.open("rb") as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        seen, advice = "no such file", f"check the name; files are looked for from {path.parent.resolve()}"
    except ValueError:
        seen, advice = "an empty file", "copy the log again"
    except OSError as error:
        seen, advice = f"cannot be read ({error.strerror})", "check that it is a file and its permissions"
    raise InputFileError(where=str(path), seen=seen, expected=expected, advice=advice)


def taken(source: npt.NDArray[np.uint8], place: Ints, length: int) -> npt.NDArray[Any]:
    """The `length` bytes (n,) that begin at each `place` (n,), each as one item, to be viewed as what it means."""
    windows = np.ndarray((len(source) - length + 1,), f"V{length}", source, strides=(1,))  # whole items copy faster
    return np.asarray(windows[place])
