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

from typing import TYPE_CHECKING

from calibration.foundation.on_demand import on_demand

if TYPE_CHECKING:
    from calibration.boards.board import Board
    from calibration.boards.printing import board_pdf, board_svg
    from calibration.boards.view import BoardView
    from calibration.camera import CameraModel
    from calibration.camera_files import FORMATS, camera_json, read_camera, write_camera
    from calibration.judgement.result import CalibratedView, Calibration, DirectionSigma, RejectedView
    from calibration.report.page import calibration_page
    from calibration.report.pictures import pictures
    from calibration.stages.from_files import calibrate_files
    from calibration.stages.from_views import calibrate
else:  # OpenCV and its kin take a fifth of a second
    __getattr__ = on_demand(
        __name__,
        {
            "Board": "boards.board",
            "BoardView": "boards.view",
            "CalibratedView": "judgement.result",
            "Calibration": "judgement.result",
            "CameraModel": "camera",
            "DirectionSigma": "judgement.result",
            "FORMATS": "camera_files.writing",
            "RejectedView": "judgement.result",
            "board_pdf": "boards.printing",
            "board_svg": "boards.printing",
            "calibrate": "stages.from_views",
            "calibrate_files": "stages.from_files",
            "calibration_page": "report.page",
            "camera_json": "camera_files.writing",
            "pictures": "report.pictures",
            "read_camera": "camera_files.reading",
            "write_camera": "camera_files.writing",
        },
    )

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
