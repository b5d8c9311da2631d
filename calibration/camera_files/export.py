"""A camera as the text of other programs' files: OpenCV YAML and XML, ROS camera_info, Kalibr, caliscope, aniposelib.

These formats hold no covariance; ours does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from calibration.camera import CameraModel
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import UsageError


def opencv_yaml(camera: CameraModel) -> str:
    """As `cv2.FileStorage` reads it: camera_matrix, distortion_coefficients, image_width, image_height."""
    width, height = camera.image_size
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {width}\nimage_height: {height}\n"
        f"fisheye_model: {int(camera.model == 'fisheye')}\n"
        f"distortion_model: {camera.model}\n"
        + _opencv_matrix("camera_matrix", camera.K)
        + _opencv_matrix("distortion_coefficients", camera.distortion.reshape(-1, 1))
        + (f"avg_reprojection_error: {camera.rms_px!r}\n" if camera.rms_px is not None else "")
    )


def opencv_xml(camera: CameraModel) -> str:
    """The same as XML."""
    width, height = camera.image_size
    return (
        '<?xml version="1.0"?>\n<opencv_storage>\n'
        f"<image_width>{width}</image_width>\n<image_height>{height}</image_height>\n"
        f"<distortion_model>{camera.model}</distortion_model>\n"
        + _xml_matrix("camera_matrix", camera.K)
        + _xml_matrix("distortion_coefficients", camera.distortion.reshape(-1, 1))
        + "</opencv_storage>\n"
    )


def ros_camera_info(camera: CameraModel) -> str:
    """As ROS's camera_calibration_parsers read it; `projection_matrix` is that of an image not rectified."""
    width, height = camera.image_size
    terms = camera.distortion
    if camera.model == "fisheye":
        name = "equidistant"
    else:
        name = "plumb_bob" if len(terms) <= 5 else "rational_polynomial"
        terms = _padded(camera, 5 if len(terms) <= 5 else 8, "ROS camera_info")
    projection = np.hstack([camera.K, np.zeros((3, 1))])
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: camera\n"
        + _ros_matrix("camera_matrix", camera.K)
        + f"distortion_model: {name}\n"
        + _ros_matrix("distortion_coefficients", terms.reshape(1, -1))
        + _ros_matrix("rectification_matrix", np.eye(3))
        + _ros_matrix("projection_matrix", projection)
    )


def kalibr(camera: CameraModel) -> str:
    """A Kalibr camchain of one camera, cam0."""
    fisheye = camera.model == "fisheye"
    terms = camera.distortion if fisheye else _padded(camera, 4, "Kalibr")
    intrinsics = camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
    return (
        "cam0:\n"
        "  cam_overlaps: []\n"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: {_list(terms)}\n"
        f"  distortion_model: {'equidistant' if fisheye else 'radtan'}\n"
        f"  intrinsics: {_list(intrinsics)}\n"
        f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]\n"
        "  rostopic: /cam0/image_raw\n"
    )


def caliscope_toml(camera: CameraModel) -> str:
    """A caliscope camera array of one camera that has no pose yet."""
    error = "" if camera.rms_px is None else f"error = {camera.rms_px!r}\n"
    return (
        f"[cameras.0]\ncam_id = 0\nrotation_count = 0\n{error}ignore = false\n{_toml(camera)}"
        f"fisheye = {'true' if camera.model == 'fisheye' else 'false'}\n"
    )


def aniposelib_toml(camera: CameraModel) -> str:
    """An aniposelib camera group of one camera at the origin."""
    return (
        f'[cam_0]\nname = "cam_0"\n{_toml(camera)}rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n'
        f"fisheye = {'true' if camera.model == 'fisheye' else 'false'}\n"
    )


EXPORTS: Mapping[str, Callable[[CameraModel], str]] = MappingProxyType(
    {
        "opencv-yaml": opencv_yaml,
        "opencv-xml": opencv_xml,
        "ros": ros_camera_info,
        "kalibr": kalibr,
        "caliscope": caliscope_toml,
        "aniposelib": aniposelib_toml,
    }
)


def _padded(camera: CameraModel, n: int, owner: str) -> Floats:
    """The first n coefficients; refuses where a later one is not zero."""
    terms = camera.distortion
    if np.any(terms[n:] != 0):
        raise UsageError(
            where=f"{owner} export",
            seen=f"{len(terms)} distortion coefficients, those after the {n}th not zero",
            expected=f"at most {n} for this format",
            advice="calibrate with fewer distortion terms, or choose another format",
        )
    return np.concatenate([terms[:n], np.zeros(max(0, n - len(terms)))])


def _list(values: Floats) -> str:
    return "[" + ", ".join(_number(float(v)) for v in np.ravel(values)) + "]"


def _number(value: float) -> str:
    """All digits of it, and always with a point: to YAML 1.1, 1e-05 is a text."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _opencv_matrix(name: str, matrix: Floats) -> str:
    rows, cols = matrix.shape
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: {_list(matrix)}\n"


def _xml_matrix(name: str, matrix: Floats) -> str:
    rows, cols = matrix.shape
    data = " ".join(repr(float(v)) for v in matrix.ravel())
    return (
        f'<{name} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n'
        f"  <dt>d</dt>\n  <data>{data}</data>\n</{name}>\n"
    )


def _ros_matrix(name: str, matrix: Floats) -> str:
    return f"{name}:\n  rows: {matrix.shape[0]}\n  cols: {matrix.shape[1]}\n  data: {_list(matrix)}\n"


def _toml(camera: CameraModel) -> str:
    rows = ", ".join(_list(row) for row in camera.K)
    return (
        f"size = [{camera.image_size[0]}, {camera.image_size[1]}]\nmatrix = [{rows}]\n"
        f"distortions = {_list(camera.distortion)}\n"
    )
