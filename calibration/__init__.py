"""Stage 1: photos of a calibration board become a `CameraModel`.

Conventions, the same everywhere in the project:

* Camera axes are OpenCV's: x right, y down, z forward, along the optical axis.
* Pixel (0, 0) is the centre of the top-left pixel, so an image w pixels wide covers -0.5 to w - 0.5.
* `K` is 3 x 3 in pixels; `distortion` is in OpenCV's order (k1, k2, p1, p2, k3, ...), or
  (k1, k2, k3, k4) for a fisheye lens.
* A sigma is one standard deviation. Lengths are metres and angles radians unless a name says otherwise.

This package never imports `pipeline`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.board_print import board_pdf, board_svg
    from calibration.camera import CameraModel
    from calibration.camera_files import FORMATS, camera_json, read_camera, write_camera
    from calibration.from_files import calibrate_files
    from calibration.report import calibration_page
    from calibration.result import CalibratedView, Calibration, DirectionSigma, RejectedView
    from calibration.solve import calibrate
    from calibration.view_pictures import pictures
    from calibration.views import BoardView

__all__ = [
    "FORMATS",
    "Board",
    "BoardView",
    "CalibratedView",
    "Calibration",
    "CameraModel",
    "DirectionSigma",
    "RejectedView",
    "board_pdf",
    "board_svg",
    "calibrate",
    "calibrate_files",
    "calibration_page",
    "camera_json",
    "pictures",
    "read_camera",
    "write_camera",
]

_HOME = {
    "Board": "board",
    "BoardView": "views",
    "CalibratedView": "result",
    "Calibration": "result",
    "CameraModel": "camera",
    "DirectionSigma": "result",
    "FORMATS": "camera_files",
    "RejectedView": "result",
    "board_pdf": "board_print",
    "board_svg": "board_print",
    "calibrate": "solve",
    "calibrate_files": "from_files",
    "calibration_page": "report",
    "camera_json": "camera_files",
    "pictures": "view_pictures",
    "read_camera": "camera_files",
    "write_camera": "camera_files",
}
"""The module of each name: loaded when it is first asked for, as OpenCV and its kin take a fifth of a second."""


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"calibration.{_HOME[name]}"), name)
