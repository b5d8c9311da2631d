"""Camera files and videos of data/flight that do not fit each other: refused before tracking? And copies of photos.

usage: python -m scripts.validation.check_camera_mistakes [--flight data/flight]

Thirteen mistakes of resolution, crop and rotation are made in the camera file (or the video's header) of uav2, one at a
time, and `runningfix track` is asked: right is exit code 2 or 3, nothing tracked, both values in the words. Then six
rendered photos are calibrated with one, two, five and twenty copies of each, saved anew: sigmas and verdict must stay.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from calibration import Board, CameraModel, calibrate_files, read_camera, write_camera
from calibration.foundation.errors import RunningFixError
from calibration.picture import Area, scaled, turned
from pipeline.flight import read_flight
from pipeline.stages import run_track
from pipeline.synthetic.board_views import camera, poses, render
from scripts.validation.figures import tell

BOARD = Board(cols=9, rows=6, square_m=0.025)
COPIES = (1, 2, 5, 20)


def to(width: int, height: int) -> Callable[[CameraModel], CameraModel]:
    """The whole picture scaled."""
    return lambda c: scaled(c, Area(crop=(0, 0, *c.image_size), of=c.image_size), (width, height))


def cut(x: float, y: float, width: int, height: int) -> Callable[[CameraModel], CameraModel]:
    """A part of the picture, as large as it is."""
    return lambda c: scaled(c, Area(crop=(x, y, width, height), of=c.image_size), (width, height))


def matrix_only(factor: float) -> Callable[[CameraModel], CameraModel]:
    """The matrix of another resolution beside the size of this one."""
    return lambda c: replace(c, K=c.K * [[factor], [factor], [1]])


MISTAKES: dict[str, Callable[[CameraModel], CameraModel]] = {
    "file of twice the size": to(1280, 720),
    "file of half the size": to(320, 180),
    "file of three quarters": to(480, 270),
    "file of 4K": to(3840, 2160),
    "file of a 4:3 part": cut(80, 0, 480, 360),
    "file of the middle": cut(160, 90, 320, 180),
    "file of a corner": cut(0, 0, 320, 180),
    "file turned by 90 degrees": lambda c: turned(c, 90),
    "file turned by 180 degrees, said": lambda c: turned(replace(c, made={**c.made, "turned_deg": 0}), 180),
    "width and height exchanged": lambda c: replace(c, image_size=c.image_size[::-1]),
    "matrix of twice the size": matrix_only(2.0),
    "matrix of half the size": matrix_only(0.5),
    "no size, matrix of twice": lambda c: replace(c, image_size=(0, 0), K=c.K * [[2], [2], [1]]),
}


def answer(folder: Path) -> str:
    """The refusal's words, or "" where tracking began."""

    def begun(*_: object) -> None:
        raise InterruptedError

    try:
        run_track(read_flight(folder / "flight.toml"), folder / "out", progress=begun)
    except RunningFixError as error:
        return str(error) if error.exit_code in (2, 3) else ""
    except InterruptedError:
        return ""
    return ""


def flight_mistakes(source: Path) -> dict[str, object]:
    """How many of the mistakes are refused; a line for each."""
    refused, accepted = 0, []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(shutil.copytree(source, Path(scratch) / "flight"))
        for name in ("uav1", "uav2"):
            write_camera(folder / f"{name}.json", calibrate_files([folder / f"board-{name}"], BOARD).camera)
        right = read_camera(folder / "uav2.json")
        for name, mistake in MISTAKES.items():
            write_camera(folder / "uav2.json", mistake(right))
            words = answer(folder)
            refused += bool(words)
            accepted += [] if words else [name]
            print(f"{name}: {words or 'ACCEPTED'}", flush=True)
        write_camera(folder / "uav2.json", right)
        print(f"right: {answer(folder) or 'accepted'}", flush=True)
    return {"mistakes": len(MISTAKES), "refused": refused, "accepted": accepted}


def copies() -> dict[str, object]:
    """Largest relative change of a sigma over numbers of copies, and the verdicts."""
    lens = camera()
    shots = [render(lens, BOARD, p, seed=i) for i, p in enumerate(poses(6, 7, lens, BOARD))]
    sigmas, verdicts = [], []
    for count in COPIES:
        with tempfile.TemporaryDirectory() as folder:
            for i, shot in enumerate(shots):
                for k in range(count):
                    kind = [cv2.IMWRITE_JPEG_QUALITY, 98 - k] if k else []
                    cv2.imwrite(str(Path(folder) / f"{i}_{k:02d}.{'jpg' if k else 'bmp'}"), shot, kind)
            found = calibrate_files([Path(folder)], BOARD)
        sigmas.append(found.sigma[found.sigma > 0])
        verdicts.append(found.verdict)
        told = f"{found.verdict}, sigma of fx {found.sigma[0]:.5f} px, {len(found.views)} views"
        print(f"{count} copies: {told}", flush=True)
    change = max(float(np.abs(s / sigmas[0] - 1).max()) for s in sigmas)
    return {"copies": list(COPIES), "largest_change_of_a_sigma": change, "verdicts": sorted(set(verdicts))}


def main() -> None:
    """Makes the mistakes and the copies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flight", type=Path, default=Path(__file__).resolve().parents[2] / "data/flight")
    figures = {**flight_mistakes(parser.parse_args().flight), **copies()}
    print(json.dumps(figures))
    tell(figures)


if __name__ == "__main__":
    main()
