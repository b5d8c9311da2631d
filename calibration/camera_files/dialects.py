"""The names under which other programs keep the same few numbers, and the checks that they make a camera.

Every dialect comes down to: a 3 x 3 matrix (or fx, fy, cx, cy), distortion coefficients in OpenCV's order, an image
size, and the name of a lens model.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.camera import PINHOLE_TERMS, CameraModel, Lens
from calibration.foundation.arrays import Floats

MATRIX_KEYS = (
    "K", "camera_matrix", "K-matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "camera_intrinsic_matrix",
    "intrinsic_matrix", "intrinsics", "intrinsic", "matrix", "mtx", "M1", "k",
)  # fmt: skip
DISTORTION_KEYS = (
    "distortion", "distortion_coefficients", "distCoeff", "distCoeffs", "dist_coeffs", "dist_coeff",
    "Distortion_Coefficients", "DistortionCoefficients", "distortion_coefficents", "distortion_coeffs", "distortions",
    "dist", "D", "D1", "d",
)  # fmt: skip
SIZE_KEYS = ("image_size", "resolution", "size", "imageSize", "image_resolution", "img_size")
SIDE_KEYS = (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height"), ("w", "h"))
LENSES: Mapping[str, Lens] = {
    "": "pinhole", "none": "pinhole", "pinhole": "pinhole", "plumb_bob": "pinhole", "radtan": "pinhole",
    "rational_polynomial": "pinhole", "rational": "pinhole", "brown": "pinhole", "opencv": "pinhole",
    "perspective": "pinhole", "radial-tangential": "pinhole",
    "fisheye": "fisheye", "equidistant": "fisheye", "equi": "fisheye", "kannala_brandt": "fisheye",
    "opencv_fisheye": "fisheye",
}  # fmt: skip
UNKNOWN_SIZE = (0, 0)


class NotACamera(ValueError):  # noqa: N818  (an intermediate verdict, turned into an InputFileError)
    """Why a mapping is no camera: what was seen, what was expected."""

    def __init__(self, key: str, seen: str, expected: str) -> None:
        self.key, self.seen, self.expected = key, seen, expected
        super().__init__(f"{key}: {seen}; expected {expected}")


def cameras_in(document: object) -> dict[str, Mapping[str, Any]]:
    """The cameras a document holds, by name; "" where the document itself is one."""
    if not isinstance(document, Mapping):
        return {}
    if _first(document, MATRIX_KEYS) is not None:
        return {"": document}
    found: dict[str, Mapping[str, Any]] = {}
    for name, part in document.items():
        for inner, camera in cameras_in(part).items():
            found[f"{name}.{inner}" if inner else str(name)] = camera
    return found


def camera_from(fields: Mapping[str, Any], made: Mapping[str, Any]) -> CameraModel:
    """One camera from a mapping in any dialect; `made` is what to remember about its origin.

    Raises NotACamera. Without an image size the camera has `image_size` (0, 0): unknown, so nothing can be checked
    against a video, and `made["note"]` says so.
    """
    lens = _lens(fields)
    K = _matrix(fields)
    size = _size(fields)
    notes = dict(made)
    if size == UNKNOWN_SIZE:
        notes["note"] = "the file gives no image size: whether photos or video fit this camera cannot be checked"
    _check_matrix(K, size)
    distortion = _distortion(fields, lens)
    rms = _number(fields, ("rms_px", "rms", "error", "avg_reprojection_error", "reprojection_error"))
    return CameraModel(
        model=lens,
        image_size=size,
        K=K,
        distortion=distortion,
        rms_px=rms,
        covariance=_covariance(fields, 4 + len(distortion)),
        made=notes,
    )


def _first(fields: Mapping[str, Any], keys: tuple[str, ...]) -> tuple[str, Any] | None:
    return next(((key, fields[key]) for key in keys if fields.get(key) is not None), None)


def _numbers(key: str, value: object) -> Floats:
    """The numbers in a list, a nested list or an OpenCV / ROS matrix mapping; refuses NaN and text."""
    if isinstance(value, Mapping) and "data" in value:
        value = value["data"]
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise NotACamera(key, f"not numbers: {str(value)[:60]}", "numbers only") from None
    if not np.isfinite(array).all():
        raise NotACamera(key, "NaN or infinite values", "finite numbers")
    return array


def _lens(fields: Mapping[str, Any]) -> Lens:
    if fields.get("fisheye") is True:
        return "fisheye"
    for key in ("distortion_model", "camera_model", "model"):
        name = str(fields.get(key) or "").strip().lower()
        if name not in LENSES:
            raise NotACamera(key, repr(fields[key]), "pinhole (plumb_bob, radtan, rational_polynomial) or fisheye")
        if name and name != "pinhole":
            return LENSES[name]
    return "pinhole"


def _matrix(fields: Mapping[str, Any]) -> Floats:
    found = _first(fields, MATRIX_KEYS)
    if found is None:
        raise NotACamera("K", "no camera matrix", f"one of the keys {', '.join(MATRIX_KEYS[:6])}")
    key, value = found
    if isinstance(value, Mapping) and {"fx", "fy", "cx", "cy"} <= set(value):
        value = [value[name] for name in ("fx", "fy", "cx", "cy")]
    flat = _numbers(key, value)
    if flat.shape == (4,):
        return np.array([[flat[0], 0, flat[2]], [0, flat[1], flat[3]], [0, 0, 1.0]])
    if flat.shape not in ((3, 3), (9,)):
        raise NotACamera(key, f"{'x'.join(map(str, flat.shape)) or 'one'} numbers", "3 x 3 numbers, or fx, fy, cx, cy")
    return flat.reshape(3, 3)


def _check_matrix(K: Floats, size: tuple[int, int]) -> None:
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        raise NotACamera("K", f"focal lengths {K[0, 0]:g}, {K[1, 1]:g}", "focal lengths above 0, in pixels")
    if not np.allclose(K[[1, 2, 2, 2], [0, 0, 1, 2]], (0, 0, 0, 1), atol=1e-9):
        raise NotACamera("K", f"last row {K[2].tolist()}", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], row by row")
    if abs(K[0, 1]) > 1e-6 * K[0, 0]:
        raise NotACamera("K", f"skew {K[0, 1]:g}", "no skew: OpenCV's lens model has none")
    width, height = size
    if size != UNKNOWN_SIZE and not (-width < K[0, 2] < 2 * width and -height < K[1, 2] < 2 * height):
        raise NotACamera(
            "K", f"principal point {K[0, 2]:g}, {K[1, 2]:g}", f"a point in or near the image of {width} x {height}"
        )


def _distortion(fields: Mapping[str, Any], lens: Lens) -> Floats:
    if str(fields.get("distortion_model", "")).lower() == "none":
        return np.zeros(4)
    found = _first(fields, DISTORTION_KEYS)
    if found is None:
        raise NotACamera("distortion", "no distortion coefficients", "a list, [] where the lens has none")
    key, value = found
    flat = _numbers(key, value).ravel()
    if len(flat) in (1, 2) and lens == "pinhole":
        flat = np.concatenate([flat, np.zeros(4 - len(flat))])
    allowed = (4,) if lens == "fisheye" else PINHOLE_TERMS
    if len(flat) not in allowed:
        raise NotACamera(key, f"{len(flat)} coefficients", f"{', '.join(map(str, allowed))} for a {lens} lens")
    return flat


def _size(fields: Mapping[str, Any]) -> tuple[int, int]:
    found = _first(fields, SIZE_KEYS)
    if found is not None:
        key, value = found
    else:
        sides = next((pair for pair in SIDE_KEYS if pair[0] in fields and pair[1] in fields), None)
        if sides is None:
            return UNKNOWN_SIZE
        key, value = " and ".join(sides), [fields[side] for side in sides]
    numbers = _numbers(key, value).ravel()
    if len(numbers) != 2 or (numbers % 1 != 0).any() or (numbers < 0).any() or (numbers == 0).sum() == 1:
        raise NotACamera(key, str(numbers.tolist()), "width and height, two whole numbers above 0")
    return int(numbers[0]), int(numbers[1])


def _number(fields: Mapping[str, Any], keys: tuple[str, ...]) -> float | None:
    found = _first(fields, keys)
    if found is None or not isinstance(found[1], int | float) or not np.isfinite(found[1]):
        return None
    return float(found[1])


def _covariance(fields: Mapping[str, Any], n: int) -> Floats | None:
    if fields.get("covariance") is None:
        return None
    matrix = _numbers("covariance", fields["covariance"])
    if matrix.shape != (n, n):
        raise NotACamera("covariance", f"shape {matrix.shape}", f"{n} x {n}: fx, fy, cx, cy and the distortion")
    scale = np.sqrt(np.clip(np.diag(matrix), 0, None))
    outside = np.abs(matrix) > 1.000001 * np.outer(scale, scale) + 1e-300
    if (np.diag(matrix) < 0).any() or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0) or outside.any():
        raise NotACamera("covariance", "not a covariance", "a symmetric matrix with no negative variance")
    return (matrix + matrix.T) / 2
