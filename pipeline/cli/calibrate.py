"""`runningfix calibrate`: board photos -> camera.json."""

from __future__ import annotations

import time
from argparse import Namespace
from typing import Any

from calibration import Board, Calibration, calibrate_files, write_camera
from pipeline.cli.console import Console


def run(arguments: Namespace, console: Console) -> int:
    """Calibrates, writes the camera file, says how far to believe it."""
    begin = time.perf_counter()
    board = Board.parse(arguments.board, square_mm=arguments.square_mm)
    found = calibrate_files(
        arguments.sources, board, progress=lambda done, total: console.progress("photos", done, total)
    )
    write_camera(arguments.output, found.camera)
    seconds = time.perf_counter() - begin
    for line in (*found.warnings, *found.advice):
        console.say(f"note: {line}")
    console.result(summary(found, arguments, seconds), words(found, arguments))
    return 0


def summary(found: Calibration, arguments: Namespace, seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    return {
        "status": "done",
        "command": "calibrate",
        "method": found.lens,
        "verdict": found.verdict,
        "rms_px": found.rms_px,
        "held_out_px": found.held_out_px,
        "K": found.camera.K.tolist(),
        "distortion": found.camera.distortion.tolist(),
        "sigma": found.sigma.tolist(),
        "views": [
            {"name": view.name, "rms_px": view.rms_px, "held_out_px": view.held_out_px, "tilt_deg": view.tilt_deg}
            for view in found.views
        ],
        "rejected": [{"name": view.name, "reason": view.reason} for view in found.rejected],
        "warnings": list(found.warnings),
        "advice": list(found.advice),
        "seconds": {"calibrate": round(seconds, 3)},
        "files": [str(arguments.output)],
    }


def words(found: Calibration, arguments: Namespace) -> str:
    """The same for people."""
    (fx, _, cx), (_, fy, cy), _ = found.camera.K
    rows = [f"{'view':<28}{'rms px':>8}{'held out':>10}{'tilt deg':>10}{'distance m':>12}"]
    rows += [
        f"{view.name[-28:]:<28}{view.rms_px:>8.3f}{view.held_out_px:>10.3f}{view.tilt_deg:>10.1f}{view.distance_m:>12.3f}"
        for view in found.views
    ]
    rows += [f"{view.name[-28:]:<28}not used: {view.reason}" for view in found.rejected]
    return "\n".join([
        *rows,
        "",
        f"focal length     {fx:.2f} +- {found.sigma[0]:.2f}  x  {fy:.2f} +- {found.sigma[1]:.2f} px",
        f"principal point  {cx:.2f} +- {found.sigma[2]:.2f},   {cy:.2f} +- {found.sigma[3]:.2f} px",
        f"lens             {found.lens}",
        f"reprojection     {found.rms_px:.3f} px RMS, {found.held_out_px:.3f} px for views left out",
        f"verdict          {found.verdict}",
        f"written          {arguments.output}",
    ])  # fmt: skip
