"""Whose camera file it is, told before anything is read: by the keys that only that program writes.

Every kind is either turned into the fields that `dialects` reads (K, distortion in OpenCV's order, image_size, model),
or refused by its name with how to get a file that can be read. The first kind whose signs are there is it.

Pixels: ours, OpenCV's, ROS', Kalibr's and mrcal's count from the centre of the top-left pixel; COLMAP's and
nerfstudio's from its corner (their cx, cy are 0.5 larger).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from calibration.camera_files.dialects import MATRIX_KEYS
from calibration.camera_files.documents import COLMAP, MATLAB_SCRIPT, MRCAL, PIX4D, XML_ROOT
from calibration.camera_files.named_numbers import BOUGUET, bouguet, flat, is_flat
from calibration.camera_files.other_programs import (
    Fields,
    basalt,
    camodocal,
    colmap,
    gyroflow,
    is_basalt,
    is_nerfstudio,
    mrcal,
    nerfstudio,
    okvis,
    orb_slam,
    stereo,
    stereo_pair,
)
from calibration.camera_files.plausibility import NotACamera

OWN_FORM = "{image_size, K, distortion}, K in pixels from the centre of the top-left pixel"


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One program's camera files.

    name     whose they are
    signs    whether a mapping is one
    cameras  the cameras in it by name ("" where there is one without), as fields that `dialects` reads
    """

    name: str
    signs: Callable[[Fields], bool]
    cameras: Callable[[Fields], Mapping[str, Fields]]


def cameras_in(document: object, depth: int = 0) -> dict[str, Fields]:
    """The cameras in a document by name; "" where the document itself is one. Raises NotACamera for what is refused."""
    if depth > 8:
        return {}
    if isinstance(document, list):
        document = {str(i): part for i, part in enumerate(document) if isinstance(part, Mapping)}
    if not isinstance(document, Mapping):
        return {}
    kind = kind_of(document)
    if kind is not None:
        return dict(kind.cameras(document))
    found: dict[str, Fields] = {}
    for name, part in document.items():
        for inner, camera in cameras_in(part, depth + 1).items():
            found[f"{name}.{inner}" if inner else str(name)] = camera
    return found


def kind_of(fields: Fields) -> Kind | None:
    """The kind of camera file that a mapping is, or None where its parts may be some."""
    return next((kind for kind in KINDS if kind.signs(fields)), None)


def _refused(name: str, seen: str, advice: str) -> Callable[[Fields], Mapping[str, Fields]]:
    def refuse(_: Fields) -> Mapping[str, Fields]:
        raise NotACamera("", f"{name}: {seen}", f"a camera as {OWN_FORM}, or one of the formats read", advice)

    return refuse


def _has(*keys: str) -> Callable[[Fields], bool]:
    return lambda fields: all(key in fields for key in keys)


def _any(*keys: str) -> Callable[[Fields], bool]:
    return lambda fields: any(key in fields for key in keys)


def _generic(fields: Fields) -> Mapping[str, Fields]:
    if "M1" in fields and "D1" in fields:
        return {"": {**fields, "K": fields["M1"], "distortion": fields["D1"]}}
    return {"": fields}


# --- all kinds, the most particular first -----------------------------------------------------------------------------

KINDS: tuple[Kind, ...] = (
    Kind(
        name="Agisoft",
        signs=lambda f: (
            f.get(XML_ROOT) == "calibration"
            or (XML_ROOT in f and ("projection" in f["parts"] or {"sensor", "calibration"} <= set(f["parts"])))
        ),
        cameras=_refused(
            "a calibration of Agisoft Metashape",
            "a principal point counted from the middle, and p1 and p2 exchanged",
            "export the calibration from Metashape as OpenCV Camera Calibration (*.xml)",
        ),
    ),
    Kind(
        name="DJI",
        signs=lambda f: "DewarpData" in f.get("told", ()),
        cameras=_refused(
            "the XMP of a DJI photo",
            "its DewarpData: a date, fx, fy, the principal point from the middle, k1, k2, p1, p2, k3",
            f"write the camera as {OWN_FORM}: cx + (width - 1) / 2, cy + (height - 1) / 2; or calibrate it",
        ),
    ),
    Kind(
        name="Adobe",
        signs=lambda f: "stCamera" in f.get("told", ()),
        cameras=_refused(
            "a lens profile of Adobe (LCP)", "focal lengths in shares of the longer side, and no camera of its own",
            f"write the camera as {OWN_FORM}, or calibrate it",
        ),
    ),
    Kind(
        name="RealityCapture",
        signs=lambda f: f.get(XML_ROOT) == "xmpmeta",
        cameras=_refused(
            "an XMP file, as RealityCapture writes them",
            "focal lengths in millimetres of a 35 mm picture",
            f"write the camera as {OWN_FORM}: f x longer side / 36",
        ),
    ),
    Kind(
        name="XML",
        signs=lambda f: XML_ROOT in f,
        cameras=lambda f: _refused(
            f"XML of <{f[XML_ROOT]}>", "no OpenCV storage", "export the camera in OpenCV's format"
        )(f),
    ),
    Kind(
        name="Pix4D",
        signs=_any(PIX4D, "pix4d_calibrated_internal_camera_parameters"),
        cameras=_refused(
            "a camera of Pix4D",
            "focal length and principal point in millimetres",
            f"write the camera as {OWN_FORM}: f x image width / sensor width, and so on",
        ),
    ),
    Kind(name="COLMAP", signs=_has(COLMAP), cameras=colmap),
    Kind(name="mrcal", signs=_has(MRCAL), cameras=mrcal),
    Kind(name="gyroflow", signs=_any("fisheye_params", "calib_dimension"), cameras=gyroflow),
    Kind(name="nerfstudio", signs=is_nerfstudio, cameras=nerfstudio),
    Kind(
        name="NeRF",
        signs=_has("camera_angle_x"),
        cameras=_refused(
            "transforms of a NeRF", "an angle of view, no focal length in pixels", f"write the camera as {OWN_FORM}"
        ),
    ),
    Kind(
        name="OpenSfM",
        signs=lambda f: "projection_type" in f,
        cameras=_refused(
            "a camera of OpenSfM or OpenDroneMap",
            "focal lengths and principal point in shares of the longer side",
            f"write the camera as {OWN_FORM}: K times the longer side, the principal point from the middle",
        ),
    ),
    Kind(
        name="Meshroom",
        signs=lambda f: "intrinsicId" in f or ("pxFocalLength" in f and "focalLength" in f),
        cameras=_refused(
            "a camera of Meshroom (AliceVision)", "its own lens model", f"write the camera as {OWN_FORM}"
        ),
    ),
    Kind(
        name="MATLAB",
        signs=_any("IntrinsicMatrix", "RadialDistortion", "PrincipalPoint", MATLAB_SCRIPT),
        cameras=_refused(
            "camera parameters of MATLAB",
            "a matrix (IntrinsicMatrix: transposed) whose pixels count from 1, and sizes as rows, columns",
            f"write the camera as {OWN_FORM}: K = IntrinsicMatrix' with 1 off cx and cy, distortion k1, k2, p1, p2",
        ),
    ),
    Kind(
        name="Open3D",
        signs=lambda f: isinstance(f.get("intrinsic_matrix"), list)
        and _length(f["intrinsic_matrix"]) == 9
        and not isinstance(f["intrinsic_matrix"][0], list),
        cameras=_refused(
            "a camera of Open3D",
            "a matrix written column by column, and no word of the distortion",
            f"write the camera as {OWN_FORM}, row by row, distortion [] where the lens has none",
        ),
    ),
    Kind(
        name="Azure Kinect",
        signs=_any("ModelParameters", "CALIBRATION_InterOp"),
        cameras=_refused(
            "a camera of Azure Kinect", "focal lengths and principal point in shares of the image",
            f"write the camera as {OWN_FORM}",
        ),
    ),
    Kind(
        name="fisheye script",
        signs=lambda f: "DIM" in f and "K" in f and not {"model", "fisheye", "distortion_model"} & set(f),
        cameras=_refused(
            "DIM, K and D, as scripts for fisheye lenses write them", "no word of which lens model the terms are of",
            'call DIM image_size, and add "model": "fisheye" (or "pinhole")',
        ),
    ),
    Kind(
        name="omnidirectional",
        signs=lambda f: "xi" in f and any(key in f for key in MATRIX_KEYS),
        cameras=_refused(
            "an omnidirectional camera (Mei's model, xi)", "a lens that is neither pinhole nor fisheye",
            "calibrate it with `runningfix calibrate --terms fisheye`",
        ),
    ),
    Kind(name="camodocal", signs=_has("model_type"), cameras=camodocal),
    Kind(name="ORB-SLAM", signs=_any("Camera.type", "Camera.fx", "Camera1.fx"), cameras=orb_slam),
    Kind(
        name="OKVIS",
        signs=lambda f: _length(f.get("focal_length")) == 2 == _length(f.get("principal_point")),
        cameras=okvis,
    ),
    Kind(name="Basalt", signs=is_basalt, cameras=basalt),
    Kind(name="OpenCV stereo", signs=lambda f: stereo_pair(f) is not None, cameras=stereo),
    Kind(
        name="camera matrix",
        signs=lambda f: any(_may_be_a_matrix(f.get(key)) for key in MATRIX_KEYS) or ("M1" in f and "D1" in f),
        cameras=_generic,
    ),
    Kind(name="Bouguet", signs=_has(*BOUGUET), cameras=bouguet),
    Kind(name="numbers by name", signs=is_flat, cameras=flat),
)  # fmt: skip


def _may_be_a_matrix(value: object) -> bool:
    """Not so where what stands under a matrix' name has parts of its own, one of which may be a camera."""
    if isinstance(value, Mapping):
        return bool({"data", "fx"} & set(value))
    return value is not None and not (isinstance(value, list) and any(isinstance(part, Mapping) for part in value))


def _length(value: object) -> int:
    return len(value) if isinstance(value, list) else 0
