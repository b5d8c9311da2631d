"""Camera files of other programs, turned into the fields that `dialects` reads: K, distortion, image_size, model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from calibration.camera_files.documents import COLMAP, MRCAL
from calibration.camera_files.plausibility import NotACamera

Fields = Mapping[str, Any]
CORNER_PX = 0.5
"""What COLMAP's and nerfstudio's principal points are larger by: they count from the corner of the top-left pixel."""


def gyroflow(fields: Fields) -> Mapping[str, Fields]:
    """A lens profile: K is that of `calib_dimension`, whatever size the clip had."""
    lens, size = fields.get("fisheye_params"), fields.get("calib_dimension")
    model = str(fields.get("distortion_model") or "").lower()
    if not isinstance(lens, Mapping) or not isinstance(size, Mapping) or "w" not in size or "h" not in size:
        raise NotACamera("calib_dimension", "a gyroflow profile without the size it is for", "its w and h, in pixels")
    if model not in ("", "opencv_fisheye", "opencv_standard") or (
        not model and fields.get("use_opencv_fisheye") is False
    ):
        raise NotACamera("distortion_model", f"gyroflow's {model or 'own lens model'}", "opencv_fisheye")
    if fields.get("interpolations"):
        raise NotACamera("interpolations", "a gyroflow profile of a zoom lens", "a profile of one focal length")
    stretched = [key for key in _STRETCH if fields.get(key) not in (None, 0, 1, 1.0)]
    if stretched or fields.get("digital_lens"):
        what = stretched[0] if stretched else "digital_lens"
        raise NotACamera(what, str(fields[what])[:40], "a profile of the picture as it is")
    return {
        "": {
            "K": lens.get("camera_matrix"),
            "distortion": lens.get("distortion_coeffs"),
            "image_size": [size["w"], size["h"]],
            "model": "pinhole" if model == "opencv_standard" else "fisheye",
        }
    }


_STRETCH = ("input_horizontal_stretch", "input_vertical_stretch")


def camodocal(fields: Fields) -> Mapping[str, Fields]:
    """camodocal, and what is built on it (VINS): PINHOLE, or KANNALA_BRANDT with k2 to k5 and mu, mv, u0, v0."""
    model, lens = str(fields["model_type"]).upper(), fields.get("projection_parameters")
    if model not in ("PINHOLE", "KANNALA_BRANDT") or not isinstance(lens, Mapping):
        raise NotACamera("model_type", f"camodocal's {model}", "PINHOLE or KANNALA_BRANDT")
    size = [fields.get("image_width"), fields.get("image_height")]
    if model == "KANNALA_BRANDT":
        K = _listed(lens, "mu", "mv", "u0", "v0")
        return {
            "": {"K": K, "distortion": _listed(lens, "k2", "k3", "k4", "k5"), "image_size": size, "model": "fisheye"}
        }
    bent = fields.get("distortion_parameters")
    terms = _listed(bent, "k1", "k2", "p1", "p2") if isinstance(bent, Mapping) else []
    return {"": {"K": _listed(lens, "fx", "fy", "cx", "cy"), "distortion": terms, "image_size": size}}


def _listed(fields: Fields, *keys: str) -> list[Any]:
    missing = [key for key in keys if key not in fields]
    if missing:
        raise NotACamera(missing[0], "missing", f"{', '.join(keys)}")
    return [fields[key] for key in keys]


def orb_slam(fields: Fields) -> Mapping[str, Fields]:
    """ORB-SLAM's settings: `Camera.type` (version 2: none, a pinhole), then Camera.fx or (version 3) Camera1.fx ...

    OpenVSLAM has them too: `Camera.model`, Camera.cols, Camera.rows.
    """
    key = "Camera.model" if "Camera.model" in fields else "Camera.type"
    model = _ORB_LENSES.get(str(fields.get(key, "pinhole")).lower())
    if model is None:
        raise NotACamera(key, repr(fields[key]), "PinHole or KannalaBrandt8")
    found: dict[str, Fields] = {}
    for head in ("Camera", "Camera1", "Camera2"):
        if f"{head}.fx" not in fields:
            continue
        names = ("k1", "k2", "k3", "k4") if model == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
        terms = [fields.get(f"{head}.{name}", 0.0) for name in names]
        size = [
            next((fields[name] for name in names if name in fields), None)
            for names in (
                ("Camera.width", "Camera1.width", "Camera.cols"),
                ("Camera.height", "Camera1.height", "Camera.rows"),
            )
        ]
        found[head] = {
            "K": _listed(fields, *(f"{head}.{name}" for name in ("fx", "fy", "cx", "cy"))),
            "distortion": terms,
            "model": model,
            **({"image_size": size} if None not in size else {}),
        }
    if not found:
        raise NotACamera(key, "ORB-SLAM settings without Camera.fx", "Camera.fx, Camera.fy, Camera.cx, Camera.cy")
    return found


_ORB_LENSES = {"pinhole": "pinhole", "perspective": "pinhole", "kannalabrandt8": "fisheye", "fisheye": "fisheye"}


def okvis(fields: Fields) -> Mapping[str, Fields]:
    """OKVIS: focal_length, principal_point, image_dimension."""
    return {
        "": {
            "K": [*fields["focal_length"], *fields["principal_point"]],
            "distortion": fields.get("distortion_coefficients"),
            "image_size": fields.get("image_dimension"),
            "model": str(fields.get("distortion_type", "")).replace("radialtangential8", "rational"),
        }
    }


def basalt(fields: Fields) -> Mapping[str, Fields]:
    """Basalt: cameras as a list of {camera_type, intrinsics}, their sizes in `resolution` beside it."""
    found: dict[str, Fields] = {}
    sizes = fields.get("resolution") or []
    for i, camera in enumerate(fields["intrinsics"]):
        kind, lens = camera.get("camera_type"), camera.get("intrinsics", {})
        if kind not in ("kb4", "pinhole"):
            raise NotACamera("camera_type", f"Basalt's {kind!r}", "kb4 or pinhole")
        found[str(i) if len(fields["intrinsics"]) > 1 else ""] = {
            "K": _listed(lens, "fx", "fy", "cx", "cy"),
            "distortion": _listed(lens, "k1", "k2", "k3", "k4") if kind == "kb4" else [],
            "model": "fisheye" if kind == "kb4" else "pinhole",
            **({"image_size": sizes[i]} if i < len(sizes) else {}),
        }
    return found


def is_basalt(fields: Fields) -> bool:
    """Whether cameras stand in a list as Basalt writes it."""
    cameras = fields.get("intrinsics")
    return (
        isinstance(cameras, list)
        and bool(cameras)
        and all(isinstance(c, Mapping) and "camera_type" in c for c in cameras)
    )


def mrcal(fields: Fields) -> Mapping[str, Fields]:
    """mrcal's .cameramodel: fx, fy, cx, cy and the distortion in one list."""
    model, values = str(fields[MRCAL]), list(fields.get("intrinsics", []))
    if re.fullmatch(r"LENSMODEL_(PINHOLE|OPENCV(4|5|8|12))", model) is None:
        raise NotACamera(MRCAL, f"mrcal's {model}", "LENSMODEL_PINHOLE or LENSMODEL_OPENCV4, 5, 8, 12")
    return {"": {"K": values[:4], "distortion": values[4:], "image_size": fields.get("imagersize")}}


COLMAP_MODELS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": ("pinhole", ("f", "cx", "cy")),
    "PINHOLE": ("pinhole", ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": ("pinhole", ("f", "cx", "cy", "k1")),
    "RADIAL": ("pinhole", ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": ("pinhole", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    "OPENCV_FISHEYE": ("fisheye", ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")),
    "FULL_OPENCV": ("pinhole", ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
}


def colmap(fields: Fields) -> Mapping[str, Fields]:
    """COLMAP's cameras.txt: number, model, width, height, parameters."""
    found: dict[str, Fields] = {}
    for line in fields[COLMAP]:
        number, model, width, height, *values = line.split()
        lens, names = COLMAP_MODELS.get(model, ("", ()))
        if len(values) != len(names):
            known = f"one of {', '.join(COLMAP_MODELS)}" if not lens else f"{len(names)} parameters"
            raise NotACamera(f"camera {number}", f"COLMAP's {model} with {len(values)} parameters", known)
        found[number] = _corner_counted(
            dict(zip(names, map(float, values), strict=True)), lens, [int(width), int(height)]
        )
    return found if len(found) > 1 else {"": next(iter(found.values()))}


def is_nerfstudio(fields: Fields) -> bool:
    """Whether focal lengths are named as nerfstudio does, for all pictures or for each."""
    frames = fields.get("frames")
    each = frames if isinstance(frames, list) else []
    return "fl_x" in fields or any(isinstance(frame, Mapping) and "fl_x" in frame for frame in each)


def nerfstudio(fields: Fields) -> Mapping[str, Fields]:
    """transforms.json of nerfstudio and instant-ngp: fl_x, fl_y, cx, cy, w, h, k1 ... in pixels."""
    frames = fields.get("frames") or []
    if any(isinstance(frame, Mapping) and "fl_x" in frame for frame in frames):
        raise NotACamera("frames", "nerfstudio with a camera of its own for each frame", "one camera for all")
    model = str(fields.get("camera_model") or ("OPENCV_FISHEYE" if fields.get("is_fisheye") else "OPENCV")).upper()
    if model not in ("OPENCV", "OPENCV_FISHEYE", "PINHOLE", "PERSPECTIVE", "SIMPLE_PINHOLE"):
        raise NotACamera("camera_model", f"nerfstudio's {model}", "OPENCV or OPENCV_FISHEYE")
    fx = fields["fl_x"]
    values = {"fx": fx, "fy": fields.get("fl_y", fx), "cx": fields.get("cx"), "cy": fields.get("cy")}
    size = [fields.get("w"), fields.get("h")]
    if None in values.values() or None in size:
        raise NotACamera("fl_x", "nerfstudio without cx, cy, w, h", "fl_x, fl_y, cx, cy, w and h, in pixels")
    terms = {name: fields[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2") if fields.get(name) is not None}
    fisheye = model == "OPENCV_FISHEYE"
    if not fisheye and terms.get("k4", 0) != 0:
        raise NotACamera("k4", "a fourth radial term beside a lens that is no fisheye", "k1, k2, p1, p2, k3")
    return {"": _corner_counted({**values, **terms}, "fisheye" if fisheye else "pinhole", size)}


def _corner_counted(values: Mapping[str, Any], lens: str, size: Sequence[Any]) -> Fields:
    """Fields from named values whose principal point counts from the corner of the top-left pixel."""
    order = ("k1", "k2", "k3", "k4") if lens == "fisheye" else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    terms = [values.get(name, 0.0) for name in order]
    if lens == "pinhole" and not any(terms[5:]):
        terms = terms[:5]
    fx = values.get("fx", values.get("f"))
    K = [fx, values.get("fy", fx), _less(values["cx"]), _less(values["cy"])]
    return {"K": K, "distortion": terms, "image_size": list(size), "model": lens}


def _less(value: Any) -> Any:
    return value - CORNER_PX if isinstance(value, int | float) else value


_PAIRS = tuple(
    (a.format(one), b.format(one), a.format(two), b.format(two))
    for a, b in (("M{}", "D{}"), ("K{}", "D{}"), ("cameraMatrix{}", "distCoeffs{}"),
                 ("camera_matrix{}", "dist_coeffs{}"),
                 ("camera_matrix_{}", "distortion_coefficients_{}"), ("mtx{}", "dist{}"), ("K_{}", "D_{}"),
                 ("CM{}", "D{}"), ("{}_camera_matrix", "{}_distortion_coefficients"), ("mtx_{}", "dist_{}"),
                 ("{}_K", "{}_D"), ("M_{}", "D_{}"))
    for one, two in (("1", "2"), ("0", "1"), ("L", "R"), ("l", "r"), ("left", "right"), ("_left", "_right"))
)  # fmt: skip
"""Names under which two cameras lie in one mapping: matrix and distortion of either."""


def stereo_pair(fields: Fields) -> tuple[str, str, str, str] | None:
    """The names of matrix and distortion of either camera, where two lie side by side."""
    return next((pair for pair in _PAIRS if pair[0] in fields and pair[2] in fields), None)


def stereo(fields: Fields) -> Mapping[str, Fields]:
    """Two cameras side by side, as OpenCV's stereo calibration writes them."""
    pair = stereo_pair(fields)
    assert pair is not None
    rest = {key: value for key, value in fields.items() if key not in pair}
    return {
        matrix: {**rest, "K": fields[matrix], **({"distortion": fields[terms]} if terms in fields else {})}
        for matrix, terms in (pair[:2], pair[2:])
    }
