"""Camera files that are no text: NumPy's arrays are read, what else there is is told by its first bytes."""

from __future__ import annotations

from io import BytesIO
from typing import Any
from zipfile import BadZipFile

import numpy as np

from calibration.camera_files.plausibility import NotACamera

NPY, ZIP = b"\x93NUMPY", b"PK\x03\x04"
MOST_NUMBERS = 10_000_000
"""Of all arrays of a file together: photos' corners and poses lie beside a camera, whole pictures do not."""

OTHERS = (
    (
        b"MATLAB",
        "a MATLAB .mat file",
        "in MATLAB, write IntrinsicMatrix' (1 off cx and cy), k1, k2, p1, p2 and the size",
    ),
    (b"\x89HDF", "an HDF5 or MATLAB 7.3 file", "write the camera's numbers as JSON"),
    (b"\x80", "a Python pickle, which is never opened: it can run programs", "save it with numpy.savez, or as JSON"),
    (ZIP, "a ZIP archive", "unpack it"),
    (b"\x1f\x8b", "a gzip archive", "unpack it"),
    (b"%PDF", "a PDF", "write its numbers as JSON"),
    (b"\xff\xd8\xff", "a photo", "runningfix calibrate takes photos of a board"),
    (b"\x89PNG", "a picture", "runningfix calibrate takes photos of a board"),
)
"""First bytes, what has them, what to do."""


def arrays_in(raw: bytes) -> Any | None:
    """The arrays of a .npz by name, or the one of a .npy, as lists; None where `raw` is neither.

    Raises NotACamera where they cannot be read without running what is in them.
    """
    if not raw.startswith((NPY, ZIP)) or (raw.startswith(ZIP) and b".npy" not in raw):
        return None
    try:
        opened = np.load(BytesIO(raw), allow_pickle=False)
        if isinstance(opened, np.ndarray):
            return _listed(opened)
        return {name: _listed(opened[name]) for name in opened.files if _asked_for(opened, name)}
    except BadZipFile:
        raise NotACamera("", "a cut or damaged .npz", "a whole file", "copy it again") from None
    except (ValueError, EOFError, OSError, KeyError) as error:
        objects = "Python objects in it, which are never opened" if "pickle" in str(error).lower() else "damaged arrays"
        raise NotACamera(
            "", objects, "arrays of numbers", "save K, distortion and image_size with numpy.savez"
        ) from None


def _asked_for(opened: Any, name: str) -> bool:
    """Poses and corners of the photos (lists of arrays are objects) are left where they are."""
    try:
        return bool(opened[name].size <= MOST_NUMBERS)
    except ValueError:
        if name.lower() in ("rvecs", "tvecs", "objpoints", "imgpoints", "r", "t"):
            return False
        raise


def _listed(array: Any) -> Any:
    return array.item() if array.ndim == 0 else array.tolist()


def refuse_binary(raw: bytes) -> None:
    """Raises NotACamera with what a file that is no text seems to be."""
    if _is_colmap(raw):
        raise NotACamera(
            "", "COLMAP's binary cameras", "its text: cameras.txt", "colmap model_converter --output_type TXT writes it"
        )
    for head, what, advice in OTHERS:
        if raw.startswith(head):
            raise NotACamera("", what, "a text file with a camera in it, or NumPy's .npz", advice)


def _is_colmap(raw: bytes) -> bool:
    """A count, then number, model, width and height of the first camera."""
    if len(raw) < 32:
        return False
    count, model = int.from_bytes(raw[:8], "little"), int.from_bytes(raw[12:16], "little")
    width, height = int.from_bytes(raw[16:24], "little"), int.from_bytes(raw[24:32], "little")
    return 0 < count < 100_000 and model < 20 and 0 < width < 100_000 and 0 < height < 100_000
