"""Camera files: recognised, read and written, ours and those of other programs."""

from calibration.camera_files.plausibility import doubts
from calibration.camera_files.reading import read_camera
from calibration.camera_files.writing import FORMATS, camera_json, write_camera

__all__ = ["FORMATS", "camera_json", "doubts", "read_camera", "write_camera"]
