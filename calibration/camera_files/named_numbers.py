"""Cameras whose numbers stand by name beside each other (fx, fy, cx, cy, k1 ...), and numbers without any name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.camera_files.dialects import DISTORTION_KEYS, TERMS
from calibration.camera_files.plausibility import NotACamera

Fields = Mapping[str, Any]
CENTRES = (("cx", "cy"), ("ppx", "ppy"))
BOUGUET = ("fc", "cc", "kc")


def is_flat(fields: Fields) -> bool:
    """Whether focal lengths and principal point stand as numbers of their own."""
    return all(_is_number(fields.get(key)) for key in ("fx", "fy")) and _centre(fields) is not None


def flat(fields: Fields) -> Mapping[str, Fields]:
    """fx, fy, cx, cy (librealsense: ppx, ppy, coeffs) with k1, k2, p1, p2 ... by name, or a list."""
    centre = _centre(fields)
    assert centre is not None
    rest = {key: value for key, value in fields.items() if key not in ("fx", "fy", *centre)}
    K = [fields["fx"], fields["fy"], fields[centre[0]], fields[centre[1]]]
    terms = {name: rest.pop(name) for name in {*TERMS["pinhole"], *TERMS["fisheye"]} if name in rest}
    if terms and not any(key in rest for key in DISTORTION_KEYS):
        rest["distortion"] = terms
    if "setup" in fields and {"cols", "rows"} <= set(fields):  # OpenVSLAM, stella_vslam
        rest["image_size"] = [fields["cols"], fields["rows"]]
    return {"": {**rest, "K": K}}


def _centre(fields: Fields) -> tuple[str, str] | None:
    return next((pair for pair in CENTRES if all(_is_number(fields.get(key)) for key in pair)), None)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def bouguet(fields: Fields) -> Mapping[str, Fields]:
    """Bouguet's toolbox: fc, cc, kc (k1, k2, p1, p2, k3), alpha_c (skew), nx, ny; pixels count from 0, as ours."""
    focal, centre = (np.ravel(fields[key]).tolist() for key in ("fc", "cc"))
    if len(focal) != 2 or len(centre) != 2:
        raise NotACamera("fc", f"{len(focal)} and {len(centre)} numbers", "fc and cc, two numbers each")
    skew = fields.get("alpha_c") or 0
    K = [[focal[0], float(np.ravel(skew)[0]) * focal[0], centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]
    size = {"image_size": [fields["nx"], fields["ny"]]} if {"nx", "ny"} <= set(fields) else {}
    return {"": {"K": K, "distortion": fields["kc"], **size}}


def refuse_bare_numbers(document: object, own_form: str) -> None:
    """Raises NotACamera where a document is nothing but numbers: a matrix alone says neither lens nor size."""
    numbers = _only_numbers(document)
    if numbers is None:
        return
    shape = " x ".join(map(str, numbers.shape)) if numbers.ndim > 1 else str(numbers.size)
    what = "a 3 x 3 matrix alone" if numbers.size == 9 else f"{shape} numbers without a name"
    raise NotACamera(
        "",
        f"{what}: no word of the lens' distortion and of the image size",
        f"a camera as {own_form}",
        'write {"image_size": [width, height], "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "distortion": [...]} as '
        "JSON (distortion [] where the lens has none)",
    )


def _only_numbers(document: object) -> np.ndarray | None:
    if isinstance(document, str):
        words = document.replace(",", " ").replace(";", " ").replace("[", " ").replace("]", " ").split()
        document = words
    if not isinstance(document, list) or not document:
        return None
    try:
        return np.asarray(document, dtype=float)
    except (TypeError, ValueError):
        return None
