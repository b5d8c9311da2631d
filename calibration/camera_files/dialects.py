"""The names under which other programs keep the same few numbers, and the checks that they make a camera.

Every dialect comes down to: a 3 x 3 matrix (or fx, fy, cx, cy), distortion coefficients in OpenCV's order, an image
size, and the name of a lens model.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.camera import PINHOLE_TERMS, CameraModel, Lens, area_matrix
from calibration.camera_files.plausibility import UNKNOWN_SIZE, NotACamera, refuse_impossible
from calibration.foundation.arrays import Floats

MATRIX_KEYS = (
    "K", "camera_matrix", "K-matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "camera_intrinsic_matrix",
    "intrinsic_matrix", "intrinsics_matrix", "intrinsicMatrix", "intrinsics", "intrinsic", "matrix", "mtx", "CameraMat",
    "camera_mat", "camera_mtx", "k",
)  # fmt: skip
DISTORTION_KEYS = (
    "distortion", "distortion_coefficients", "distCoeff", "distCoeffs", "dist_coeffs", "dist_coeff",
    "Distortion_Coefficients", "DistortionCoefficients", "distortion_coefficents", "distortion_coeffs", "distortions",
    "DistCoeff", "DistCoeffs", "distCoef", "dist_coefs", "dist_coef", "distortion_vector", "distortion_parameters",
    "coeffs", "dist", "D", "d",
)  # fmt: skip
SIZE_KEYS = (
    "image_size", "resolution", "size", "imageSize", "ImageSize", "image_resolution", "img_size", "image_dimension",
)  # fmt: skip
SIDE_KEYS = (
    ("image_width", "image_height"), ("image_Width", "image_Height"), ("imageWidth", "imageHeight"),
    ("img_width", "img_height"), ("width", "height"), ("w", "h"),
)  # fmt: skip
LENSES: Mapping[str, Lens] = {
    "": "pinhole", "none": "pinhole", "pinhole": "pinhole", "plumb_bob": "pinhole", "radtan": "pinhole",
    "rational_polynomial": "pinhole", "rational": "pinhole", "brown": "pinhole", "opencv": "pinhole",
    "perspective": "pinhole", "radial-tangential": "pinhole", "radialtangential": "pinhole", "brown-conrady": "pinhole",
    "radial_tangential": "pinhole", "brown_conrady": "pinhole", "full_opencv": "pinhole", "standard": "pinhole",
    "thin_prism": "pinhole", "tilted": "pinhole",
    "fisheye": "fisheye", "equidistant": "fisheye", "equi": "fisheye", "kannala_brandt": "fisheye",
    "kannalabrandt": "fisheye", "kannalabrandt8": "fisheye", "kannala-brandt": "fisheye", "kb4": "fisheye",
    "opencv_fisheye": "fisheye",
}  # fmt: skip
TERMS: Mapping[Lens, tuple[str, ...]] = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Coefficients by name, in OpenCV's order."""
SAYS_LITTLE = frozenset(["", "none", "pinhole", "perspective"])
"""Names that leave open how the lens bends: a pinhole, unless another key says fisheye."""


def camera_from(fields: Mapping[str, Any], made: Mapping[str, Any]) -> CameraModel:
    """One camera from a mapping in any dialect; `made` is what to remember about its origin.

    Raises NotACamera. Without an image size the camera has `image_size` (0, 0): unknown, so nothing can be checked
    against a video, and `made["note"]` says so.
    """
    lens = _lens(fields)
    K = _matrix(fields)
    size = _size(fields)
    notes = dict(made)
    refuse_impossible(K, size, cropped="area" in made)
    K, size = _as_sent(fields, K, size, notes)
    if size == UNKNOWN_SIZE:
        notes["note"] = "the file gives no image size: whether photos or video fit this camera cannot be checked"
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
    """The first of `keys` that is there. Raises NotACamera where another one says otherwise."""
    found = [(key, fields[key]) for key in keys if fields.get(key) is not None]
    for key, value in found[1:]:
        if _differ(found[0][1], value):
            raise NotACamera(key, f"other numbers than under {found[0][0]}", "one of the two")
    return found[0] if found else None


def _differ(one: object, other: object) -> bool:
    """Whether both are numbers, as many, and not the same."""
    try:
        a, b = (np.ravel(np.asarray(v["data"] if isinstance(v, Mapping) else v, dtype=float)) for v in (one, other))
    except (KeyError, TypeError, ValueError, OverflowError):
        return False
    return a.shape == b.shape and not np.allclose(a, b, rtol=1e-9, atol=0, equal_nan=True)


def _numbers(key: str, value: object) -> Floats:
    """The numbers in a list, a nested list or an OpenCV / ROS matrix mapping; refuses NaN and text."""
    if isinstance(value, Mapping) and "data" in value:
        rows, cols, data = value.get("rows"), value.get("cols"), value["data"]
        if isinstance(rows, int | float) and isinstance(cols, int | float) and rows * cols != np.size(data):
            raise NotACamera(key, f"{np.size(data)} numbers", f"{rows:g} x {cols:g}, as rows and cols say")
        value = data
    try:
        array = np.asarray(value, dtype=float)
        if isinstance(value, bool) or np.asarray(value).dtype == bool:
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise NotACamera(key, f"not numbers: {str(value)[:60]}", "numbers only") from None
    if not np.isfinite(array).all():
        raise NotACamera(key, "NaN or infinite values", "finite numbers")
    return array


def _lens(fields: Mapping[str, Any]) -> Lens:
    """What every key that speaks of the lens says; refuses names that are not known, and two that contradict."""
    said: dict[Lens, str] = {}
    for key in ("fisheye", "fisheye_model"):
        flag = fields.get(key)
        if flag not in (None, False, 0, 1, True) and str(flag).lower() not in ("true", "false"):
            raise NotACamera(key, repr(flag), "true or false")
        if flag in (True, 1) or str(flag).lower() == "true":
            said["fisheye"] = key
        elif flag is not None:
            said["pinhole"] = key
    for key in ("distortion_model", "camera_model", "model"):
        name = str("" if fields.get(key) is None else fields[key]).strip().lower()
        if name not in LENSES:
            raise NotACamera(key, repr(fields[key]), "pinhole (plumb_bob, radtan, rational_polynomial) or fisheye")
        if name not in SAYS_LITTLE:
            said[LENSES[name]] = key
    if len(said) > 1:
        raise NotACamera(said["fisheye"], f"a fisheye, while {said['pinhole']} says it is none", "one kind of lens")
    return next(iter(said), "pinhole")


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


def _as_sent(
    fields: Mapping[str, Any], K: Floats, size: tuple[int, int], notes: dict[str, Any]
) -> tuple[Floats, tuple[int, int]]:
    """K and size of the pictures that a ROS camera sends: a region of the sensor's (`roi`), then binned."""
    roi = fields.get("roi") if isinstance(fields.get("roi"), Mapping) else {}
    assert isinstance(roi, Mapping)
    x, y, width, height = (_whole(roi, name) for name in ("x_offset", "y_offset", "width", "height"))
    bins = max(1, _whole(fields, "binning_x")), max(1, _whole(fields, "binning_y"))
    if size == UNKNOWN_SIZE or (bins == (1, 1) and not (x or y or width or height)):
        return K, size
    part = width or size[0] - x, height or size[1] - y
    if x + part[0] > size[0] or y + part[1] > size[1] or min(part) < 1:
        raise NotACamera("roi", f"{part[0]} x {part[1]} from {x}, {y}", f"a part of {size[0]} x {size[1]}")
    if part != size or bins != (1, 1):
        notes["area"] = f"{part[0]} x {part[1]} from {x}, {y} of {size[0]} x {size[1]}, binned {bins[0]} x {bins[1]}"
    sent = part[0] // bins[0], part[1] // bins[1]
    return area_matrix(K, (x, y), (1 / bins[0], 1 / bins[1])), sent


def _whole(fields: Mapping[str, Any], key: str) -> int:
    value = fields.get(key) or 0
    if not isinstance(value, int | float) or value % 1 or value < 0:
        raise NotACamera(key, repr(value), "a whole number, 0 or more")
    return int(value)


def _distortion(fields: Mapping[str, Any], lens: Lens) -> Floats:
    if str(fields.get("distortion_model", "")).lower() == "none":
        return np.zeros(4)
    found = _first(fields, DISTORTION_KEYS)
    if found is None:
        raise NotACamera("distortion", "no distortion coefficients", "a list, [] where the lens has none")
    key, value = found
    if isinstance(value, Mapping) and "data" not in value:
        value = named_terms(value, lens, key)
    flat = _numbers(key, value).ravel()
    if len(flat) in (1, 2) and lens == "pinhole":
        flat = np.concatenate([flat, np.zeros(4 - len(flat))])
    allowed = (4,) if lens == "fisheye" else PINHOLE_TERMS
    if len(flat) not in allowed:
        raise NotACamera(key, f"{len(flat)} coefficients", f"{', '.join(map(str, allowed))} for a {lens} lens")
    return flat


def named_terms(terms: Mapping[str, Any], lens: Lens, key: str) -> list[Any]:
    """Coefficients that stand by name (k1, p1 ...), in OpenCV's order; those that are not there are 0."""
    unknown = [name for name in terms if name not in TERMS[lens]]
    if unknown or not terms:
        what = f"coefficients {', '.join(map(str, unknown))}" if unknown else "no coefficients"
        raise NotACamera(key, what, f"{', '.join(TERMS[lens][:5])} for a {lens} lens, or a list in OpenCV's order")
    values = [terms.get(name, 0.0) for name in TERMS[lens]]
    given = max(i for i, name in enumerate(TERMS[lens]) if name in terms) + 1
    return values[: 4 if lens == "fisheye" else next(n for n in PINHOLE_TERMS if n >= given)]


def _size(fields: Mapping[str, Any]) -> tuple[int, int]:
    sides = next(
        (pair for pair in SIDE_KEYS if fields.get(pair[0]) is not None and fields.get(pair[1]) is not None), None
    )
    by_sides = None if sides is None else _whole_sides(" and ".join(sides), [fields[side] for side in sides])
    found = _first(fields, SIZE_KEYS)
    if found is None:
        return by_sides or UNKNOWN_SIZE
    key, value = found
    if isinstance(value, Mapping) and "data" not in value:
        value = next(([value[a], value[b]] for a, b in SIDE_KEYS if a in value and b in value), value)
    if isinstance(value, str) and (text := re.fullmatch(r"\s*(\d+)\s*[xX*,]\s*(\d+)\s*", value)):
        value = [int(text[1]), int(text[2])]
    size = _whole_sides(key, value)
    if by_sides is not None and by_sides != size:
        assert sides is not None
        raise NotACamera(
            key, f"{size[0]} x {size[1]}, {' and '.join(sides)} {by_sides[0]} and {by_sides[1]}", "one size"
        )
    return size


def _whole_sides(key: str, value: object) -> tuple[int, int]:
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
