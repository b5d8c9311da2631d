"""Rendered photo sets with a known camera: how wrong are corners, focal length, and the claimed uncertainty?

usage: python scripts/check_calibration.py [--sets 60] [--first-seed 0]

Five lenses in turn, 20 photos of an 11x8 board at 800 x 600, drawn anew for each set: blur of 0.5 to 1.3 px and noise
of 1 to 5 gray levels (each set its own), one photo smeared by 5 px, one of another zoom (2 %), one with a hand over a
corner of the board. The lens model is chosen by `calibrate` itself. Corner error is per axis, of the views that were
used; error / sigma is the RMS over the sets in which the parameter is estimated. Terms that were left out
as not needed change the meaning of the others a little; the last rows say the same of what a camera is for: where it
puts a direction, over the whole image, with the best rotation taken off.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calibration import Board, BoardView, Calibration, CameraModel, calibrate
from calibration.arrays import Floats
from calibration.camera import project, unproject
from calibration.detect import find_board
from tests.calibration_scenes import poses, render, true_corners

BOARD = Board(cols=11, rows=8, square_m=0.03)
SIZE = (800, 600)
VIEWS = 20
LENSES: dict[str, tuple[str, float, tuple[float, ...]]] = {
    "normal": ("pinhole", 640.0, (-0.28, 0.09, 0.0008, -0.0006, -0.01)),
    "wide": ("pinhole", 400.0, (-0.30, 0.11, -0.0004, 0.0005, -0.02)),
    "phone": ("pinhole", 610.0, (0.14, -0.35, 0.0006, 0.0003, 0.25)),
    "long": ("pinhole", 2200.0, (-0.06, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": ("fisheye", 275.0, (0.03, -0.012, 0.004, -0.001)),
}
NAMES = {"pinhole": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"), "fisheye": ("fx", "fy", "cx", "cy",
         "k1 fisheye", "k2 fisheye", "k3 fisheye", "k4 fisheye")}  # fmt: skip
ZOOMED, SMEARED, COVERED = 4, 9, 14


def camera(lens: str, seed: int) -> CameraModel:
    """One of the lenses, its focal length and principal point a little different in each set."""
    random = np.random.default_rng([seed, 1])
    model, focal, distortion = LENSES[lens]
    f = focal * random.uniform(0.95, 1.05)
    cx, cy = 399.5 + random.normal(0, 5), 299.5 + random.normal(0, 5)
    K = np.array([[f, 0, cx], [0, f * random.uniform(0.998, 1.002), cy], [0, 0, 1]])
    return CameraModel(model=model, image_size=SIZE, K=K, distortion=np.array(distortion))  # type: ignore[arg-type]


def photographed(true: CameraModel, seed: int) -> tuple[list[BoardView], dict[str, Floats]]:
    """The views that were found, and the true corners by name."""
    random = np.random.default_rng([seed, 2])
    blur, noise = random.uniform(0.5, 1.3), random.uniform(1, 5)
    K = true.K * [[1.02], [1.02], [1]]
    K[:2, 2] = true.K[:2, 2]
    zoomed = CameraModel(model=true.model, image_size=SIZE, K=K, distortion=true.distortion)
    views, corners = [], {}
    for i, pose in enumerate(poses(VIEWS, seed, true, BOARD, fill=0.5)):
        lens, name = (zoomed if i == ZOOMED else true), f"{i:02d}.png"
        shot = render(lens, BOARD, pose, blur_px=blur, noise=noise, seed=seed * 100 + i,
                      motion_px=5.0 if i == SMEARED else 0.0)  # fmt: skip
        corners[name] = true_corners(lens, BOARD, pose)
        if i == COVERED:
            x, y = corners[name][0].astype(int)
            shot[max(y - 25, 0) : y + 9, max(x - 25, 0) : x + 9] = 150
        view = find_board(shot, BOARD, name)
        if view is not None:
            views.append(view)
    return views, corners


def corner_errors(found: Calibration, corners: dict[str, Floats]) -> Floats:
    """(n, 2) found minus true corners of the views that were used; a board may be counted from either end."""
    off = []
    for view in found.views:
        ways = [view.corners - c[view.index] for c in (corners[view.name], corners[view.name][::-1])]
        off.append(min(ways, key=lambda e: float(np.abs(e).max())))
    return np.concatenate(off)


def parameter_errors(found: Calibration, true: CameraModel) -> dict[str, float]:
    """Error over sigma of each parameter that was estimated."""
    names = NAMES[found.camera.model]
    have, want = (np.concatenate([c.K[[0, 1, 0, 1], [0, 1, 2, 2]], c.distortion]) for c in (found.camera, true))
    n = min(len(have), len(want), len(names))
    return {names[i]: (have[i] - want[i]) / found.sigma[i] for i in range(n) if found.sigma[i] > 0}


def direction_error_px(found: Calibration, true: CameraModel) -> float:
    """RMS over the image of where the found camera puts what the true one sees, the best rotation taken off."""
    x, y = np.meshgrid(np.linspace(0, SIZE[0] - 1, 11), np.linspace(0, SIZE[1] - 1, 9))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    a, b = unproject(true, pixels), unproject(found.camera, pixels)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    U, _, Vt = np.linalg.svd(b[good].T @ a[good])
    turned = a[good] @ (U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt).T
    off = project(found.camera, turned) - pixels[good]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def main() -> None:
    """Draws the sets and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    pulls: dict[str, list[float]] = {}
    rows = []
    print(
        f"{'set':>4} {'lens':<8}{'views':>6} {'chosen':<18}{'corner px':>10}{'focal %':>9}{'direction px':>13}"
        f"{'claimed':>9}"
    )
    for seed in range(options.first_seed, options.first_seed + options.sets):
        lens = list(LENSES)[seed % len(LENSES)]
        true = camera(lens, seed)
        views, corners = photographed(true, seed)
        found = calibrate(views, BOARD)
        off = corner_errors(found, corners)
        focal = 100 * (found.camera.K[0, 0] / true.K[0, 0] - 1)
        bad_kept = f"{ZOOMED:02d}.png" in {v.name for v in found.views}
        row = (float(np.sqrt(np.mean(off**2))), focal, direction_error_px(found, true), found.projection_sigma_px[0])
        rows.append((lens, *row, bad_kept))
        for name, pull in parameter_errors(found, true).items():
            pulls.setdefault(name, []).append(pull)
        print(f"{seed:>4} {lens:<8}{len(found.views):>6} {found.lens:<18}{row[0]:>10.4f}{focal:>9.4f}{row[2]:>13.4f}"
              f"{row[3]:>9.4f}{'  the zoomed photo was kept' if bad_kept else ''}", flush=True)  # fmt: skip
    report(rows, pulls)


def report(rows: list[tuple[str, float, float, float, float, bool]], pulls: dict[str, list[float]]) -> None:
    """The summary over all sets."""

    def rms(values: list[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    print(f"\ncorner error: {rms([r[1] for r in rows]):.4f} px RMS per axis over all sets, worst set "
          f"{max(r[1] for r in rows):.4f}")  # fmt: skip
    print(f"focal error: {rms([r[2] for r in rows]):.4f} % RMS, worst {max(abs(r[2]) for r in rows):.4f} %")
    print(f"zoomed photos kept: {sum(r[5] for r in rows)} of {len(rows)}")
    print(f"direction error / claimed (typical) sigma: {rms([r[3] / r[4] for r in rows]):.2f}")
    print("\nerror / sigma, RMS over the sets (its own one sigma beside it)")
    for name, values in pulls.items():
        print(f"  {name:<12}{rms(values):>6.2f} +- {rms(values) / np.sqrt(2 * len(values)):.2f}   {len(values)} sets")


if __name__ == "__main__":
    main()
