"""`runningfix calibrate`: board photos -> camera.json."""

from __future__ import annotations

from argparse import Namespace

from calibration import Board, calibrate_files, write_camera
from pipeline.cli.console import Console


def run(arguments: Namespace, console: Console) -> int:
    """Calibrates, writes the camera file, says how good it is."""
    board = Board.parse(arguments.board, square_mm=arguments.square_mm)
    found = calibrate_files(
        arguments.sources, board, progress=lambda done, total: console.progress("photos", done, total)
    )
    write_camera(arguments.output, found.camera)
    console.result({}, "")
    return 0
