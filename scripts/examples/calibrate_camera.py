"""Board photos -> camera.json, over the Python API.

usage: python scripts/examples/calibrate_camera.py PHOTOS_FOLDER camera.json [9x6] [25]
"""

import sys
from pathlib import Path

from calibration import Board, calibrate_files, write_camera


def main(photos: str, output: str, board: str = "9x6", square_mm: str = "25") -> None:
    """Calibrates and prints the focal length."""
    found = calibrate_files([Path(photos)], Board.parse(board, square_mm=float(square_mm)))
    write_camera(Path(output), found.camera)
    fx, fy = found.camera.K[0, 0], found.camera.K[1, 1]
    print(f"focal length {fx:.2f} x {fy:.2f} px, reprojection error {found.camera.rms_px:.3f} px")


if __name__ == "__main__":
    main(*sys.argv[1:])
