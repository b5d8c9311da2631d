"""Photos of two like cameras in one folder: refused or named wherever the mixture would be wrong?

usage: python -m scripts.validation.check_mixed_cameras [--pairs 40] [--single 20] [--first-seed 0]

Rendered photos (800 x 600, a 9x6 board, blur 0.5 to 1.2 px, noise 1 to 4 gray levels), 4 to 10 of each of two cameras
of one type: focal lengths 0 to 1 % apart, principal points 2 to 20 px, distortion nearly the same. What the mixture
would have been is calibrated with both refusals switched off; how wrong it is, is the largest of |found - true| / sigma
over fx, fy, cx, cy and both cameras. Then as many sets of a single camera: none may be refused.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from unittest.mock import patch

import numpy as np

from calibration import Board, BoardView, Calibration, CameraModel, calibrate
from calibration.detection.find import find_board
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import RunningFixError
from pipeline.synthetic.board_views import poses, render
from scripts.validation.figures import tell

BOARD = Board(cols=9, rows=6, square_m=0.03)
SIZE = (800, 600)
LEAST_PHOTOS, MOST_PHOTOS = 4, 10
FAR = 2.0
REFUSALS = ("_refuse_two_cameras", "_odd_view")


def pair(seed: int) -> tuple[CameraModel, CameraModel]:
    """Two cameras of one type."""
    random = np.random.default_rng([seed, 1])
    focal = random.uniform(500, 1400)
    terms = np.array([-0.28, 0.09, 0.0008, -0.0006, -0.01]) if focal < 900 else np.array([-0.12, 0.05, 0, 0, 0.0])
    centre = np.array([399.5, 299.5]) + random.normal(0, 6, 2)
    apart, way = np.exp(random.uniform(np.log(2), np.log(20))), random.uniform(0, 2 * np.pi)
    longer = 1 + random.uniform(0, 0.01)
    other = centre + apart * np.array([np.cos(way), np.sin(way)])
    return _camera(focal, centre, terms), _camera(focal * longer, other, terms + random.normal(0, 0.002, 5) * _FEW)


_FEW = np.array([1, 1, 0.05, 0.05, 0.0])


def _camera(focal: float, centre: Floats, terms: Floats) -> CameraModel:
    K = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return CameraModel(image_size=SIZE, K=K, distortion=terms)


def photographed(camera: CameraModel, count: int, seed: int, name: str) -> list[BoardView]:
    """The views that were found."""
    random = np.random.default_rng([seed, 2])
    blur, noise = random.uniform(0.5, 1.2), random.uniform(1, 4)
    views = []
    for i, pose in enumerate(poses(count, seed, camera, BOARD, fill=0.55)):
        shot = render(camera, BOARD, pose, blur_px=blur, noise=noise, seed=seed * 100 + i)
        view = find_board(shot, BOARD, f"{name}{i:02d}.png")
        views += [] if view is None else [view]
    return views


def pull(found: Calibration, cameras: tuple[CameraModel, ...]) -> float:
    """Largest error over sigma of fx, fy, cx, cy against any of the cameras."""
    at = ([0, 1, 0, 1], [0, 1, 2, 2])
    return max(float(np.abs((found.camera.K[at] - c.K[at]) / found.sigma[:4]).max()) for c in cameras)


def told(views: list[BoardView], names: tuple[str, ...]) -> str:
    """How the mixture is met: "refused", "named" (a warning, or one camera's photos set aside), or ""."""
    try:
        found = calibrate(views, BOARD)
    except RunningFixError:
        return "refused"
    used = {view.name[0] for view in found.views}
    said = any("camera" in words or "zoom" in words for words in found.warnings)
    return "named" if said or len(used) < len(names) else ""


def mixture(views: list[BoardView]) -> Calibration | None:
    """What would have been found, had nobody asked whether one camera took the photos."""
    with ExitStack() as off:
        for name in REFUSALS:
            off.enter_context(patch(f"calibration.stages.from_views.{name}", lambda *_: None))
        try:
            return calibrate(views, BOARD)
        except RunningFixError:
            return None


def mixed_pairs(seeds: range) -> dict[str, int]:
    """Counts over all pairs, a line for each."""
    count = {"pairs": 0, "wrong": 0, "told": 0, "missed": 0, "refused_though_right": 0}
    for seed in seeds:
        both, random = pair(seed), np.random.default_rng([seed, 3])
        numbers = random.integers(LEAST_PHOTOS, MOST_PHOTOS + 1, 2)
        groups = [
            photographed(c, int(n), 2 * seed + k, "ab"[k]) for k, (c, n) in enumerate(zip(both, numbers, strict=True))
        ]
        views = [view for group in groups for view in group]
        found, how = mixture(views), told(views, ("a", "b"))
        off = float("inf") if found is None else pull(found, both)
        wrong = off > FAR
        count["pairs"] += 1
        count["wrong"] += wrong
        count["told"] += wrong and bool(how)
        count["missed"] += wrong and not how
        count["refused_though_right"] += not wrong and bool(how)
        apart = np.hypot(*(both[0].K[:2, 2] - both[1].K[:2, 2]))
        longer = 100 * (both[1].K[0, 0] / both[0].K[0, 0] - 1)
        noise = float("nan") if found is None else found.corner_noise_px
        print(f"{seed:>4} {len(groups[0])} + {len(groups[1])} photos, {apart:5.1f} px and {longer:.2f} % apart, "
              f"corners {noise:.3f} px: off by {off:5.1f} sigma, {how or 'ACCEPTED'}", flush=True)  # fmt: skip
    return count


def single_cameras(seeds: range) -> dict[str, int]:
    """How many sets of one camera are refused or said to be of two."""
    alarms = 0
    for seed in seeds:
        number = 2 * int(np.random.default_rng([seed, 3]).integers(LEAST_PHOTOS, MOST_PHOTOS + 1))
        how = told(photographed(pair(seed)[0], number, 5000 + seed, "a"), ("a",))
        alarms += bool(how)
        if how:
            print(f"{seed:>4} one camera, {number} photos: {how}", flush=True)
    return {"single": len(seeds), "single_alarms": alarms}


def main() -> None:
    """Draws the sets and prints a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--single", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    first = options.first_seed
    figures = mixed_pairs(range(first, first + options.pairs)) | single_cameras(range(first, first + options.single))
    print(", ".join(f"{name.replace('_', ' ')} {value}" for name, value in figures.items()))
    tell(figures)


if __name__ == "__main__":
    main()
