"""Rendered photo sets with a known camera: how wrong are corners, focal length, and the claimed uncertainty?

usage: python -m scripts.validation.check_calibration [--sets 60] [--more-fisheye 24] [--keep FOLDER]

Five lenses in turn, 20 photos of an 11x8 board at 800 x 600, drawn anew for each set: blur of 0.5 to 1.3 px and noise
of 1 to 5 gray levels (each set its own), one photo smeared by 5 px, one of another zoom (2 %), one with a hand over a
corner of the board. The lens model is chosen by `calibrate` itself. Corner error is per axis, of the views that were
used. Error / sigma is the RMS over the sets in which a parameter is estimated, with its own one sigma, which 12 sets
of a lens leave at 20 %: parameters of the pinhole lenses are pooled, and for those of the fisheye further sets are
drawn. The last rows say the same of what a camera is for: where it puts a direction, over the part of the image that
boards reached, with the best rotation taken off.

About 10 to 25 s a set and 20 minutes in all, on one core. With `--keep` every set is kept as it is done, and a later
run of the same code goes on from there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from calibration import Board, BoardView, Calibration, CameraModel, calibrate
from calibration.adjustment.bundle import Model
from calibration.adjustment.covariance import projection_sigma_px
from calibration.camera import project, unproject
from calibration.detection.find import find_board
from calibration.foundation.arrays import Floats
from calibration.judgement.coverage import lattice, reached
from pipeline.synthetic.board_views import poses, render, true_corners
from scripts.validation.figures import tell

BOARD = Board(cols=11, rows=8, square_m=0.03)
SIZE = (800, 600)
VIEWS = 20
LENSES: dict[str, tuple[str, float, tuple[float, ...]]] = {
    "normal": ("pinhole", 640.0, (-0.28, 0.09, 0.0008, -0.0006, -0.01)),
    "wide": ("pinhole", 400.0, (-0.20, 0.05, -0.0004, 0.0005, -0.005)),
    "phone": ("pinhole", 610.0, (0.14, -0.35, 0.0006, 0.0003, 0.25)),
    "long": ("pinhole", 2200.0, (-0.06, 0.0, 0.0, 0.0, 0.0)),
    "fisheye": ("fisheye", 275.0, (0.03, -0.012, 0.004, -0.001)),
}
"""Each is one-to-one as far as the corners of the image. A wide lens of k = -0.30, 0.11, -0.02, used here before, folds
back 395 px from the middle while the image reaches to 500: what is rendered out there no lens can show."""

NAMES = {"pinhole": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"), "fisheye": ("fx", "fy", "cx", "cy",
         "k1 fisheye", "k2 fisheye", "k3 fisheye", "k4 fisheye")}  # fmt: skip
ZOOMED, SMEARED, COVERED = 4, 9, 14
FURTHER = 1000


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
    """Error over sigma of each parameter that was estimated; none where another kind of lens was chosen."""
    if found.camera.model != true.model or len(found.camera.distortion) > 5:
        return {}
    names = NAMES[found.camera.model]
    have, want = (np.concatenate([c.K[[0, 1, 0, 1], [0, 1, 2, 2]], c.distortion]) for c in (found.camera, true))
    n = min(len(have), len(want), len(names))
    return {names[i]: (have[i] - want[i]) / found.sigma[i] for i in range(n) if found.sigma[i] > 0}


def direction_pull(found: Calibration, true: CameraModel) -> tuple[float, float]:
    """RMS of where the found camera puts what the true one sees, and of its sigma, px, where boards were seen."""
    pixels = lattice(SIZE)
    pixels = pixels[reached(found.views, pixels)]
    a, b = unproject(true, pixels), unproject(found.camera, pixels)
    U, _, Vt = np.linalg.svd(b.T @ a)
    turned = a @ (U @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ Vt).T
    off = np.sum((project(found.camera, turned) - pixels) ** 2, axis=1)
    intrinsics = np.concatenate([found.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], found.camera.distortion])
    model = Model(lens=found.camera.model, free=np.ones(len(intrinsics), bool), board_m=BOARD.points_m)
    assert found.camera.covariance is not None
    sigma = projection_sigma_px(model, intrinsics, found.camera.covariance, b / b[:, 2:])
    return float(np.sqrt(np.mean(off))), float(np.sqrt(np.mean(sigma**2)))


@dataclass(frozen=True, kw_only=True)
class Row:
    """What one set showed."""

    seed: int
    lens: str
    chosen: str
    views: int
    corner_px: float
    focal_percent: float
    direction_px: float
    direction_sigma_px: float
    zoomed_kept: bool
    pulls: dict[str, float]


def one_set(seed: int, lens: str) -> Row:
    """Draws, finds, calibrates, compares."""
    true = camera(lens, seed)
    views, corners = photographed(true, seed)
    found = calibrate(views, BOARD)
    off, (direction, sigma) = corner_errors(found, corners), direction_pull(found, true)
    return Row(
        seed=seed,
        lens=lens,
        chosen=found.lens,
        views=len(found.views),
        corner_px=float(np.sqrt(np.mean(off**2))),
        focal_percent=float(100 * (found.camera.K[0, 0] / true.K[0, 0] - 1)),
        direction_px=direction,
        direction_sigma_px=sigma,
        zoomed_kept=f"{ZOOMED:02d}.png" in {v.name for v in found.views},
        pulls={name: float(pull) for name, pull in parameter_errors(found, true).items()},
    )


def kept_set(seed: int, lens: str, folder: Path | None) -> Row:
    """A set that an earlier run of the same code has kept, or a new one."""
    if folder is None:
        return one_set(seed, lens)
    path = folder / f"{_code()}-{lens}-{seed}.json"
    if path.exists():
        return Row(**json.loads(path.read_text()))
    row = one_set(seed, lens)
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(row)))
    return row


def _code() -> str:
    """Of everything a row depends on."""
    root = Path(__file__).resolve().parents[2]
    drawn = root / "pipeline/synthetic/board_views.py"
    files = [*sorted((root / "calibration").rglob("*.py")), drawn, Path(__file__)]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def main() -> None:
    """Draws the sets and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--more-fisheye", type=int, default=24, help="further sets of the fisheye")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder in which sets are kept as they are done")
    options = parser.parse_args()
    first, names = options.first_seed, list(LENSES)
    plan = [(seed, names[seed % len(names)]) for seed in range(first, first + options.sets)]
    plan += [(FURTHER + first + i, "fisheye") for i in range(options.more_fisheye)]
    print(f"{'set':>4} {'lens':<8}{'views':>6} {'chosen':<18}{'corner px':>10}{'focal %':>9}{'direction px':>13}"
          f"{'sigma':>8}")  # fmt: skip
    rows = []
    for seed, lens in plan:
        row = kept_set(seed, lens, options.keep)
        rows.append(row)
        print(f"{seed:>4} {lens:<8}{row.views:>6} {row.chosen:<18}{row.corner_px:>10.4f}{row.focal_percent:>9.4f}"
              f"{row.direction_px:>13.4f}{row.direction_sigma_px:>8.4f}"
              f"{'  the zoomed photo was kept' if row.zoomed_kept else ''}", flush=True)  # fmt: skip
    report(rows)


def report(rows: list[Row]) -> None:
    """The summary over all sets."""

    def rms(values: list[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")

    def told(name: str, values: list[float]) -> str:
        return f"  {name:<14}{rms(values):>6.2f} +- {rms(values) / np.sqrt(2 * len(values)):.2f}   {len(values)} sets"

    by_lens = {lens: [r for r in rows if r.lens == lens] for lens in LENSES}
    print(f"\ncorner error: {rms([r.corner_px for r in rows]):.4f} px RMS per axis over all sets, worst set "
          f"{max(r.corner_px for r in rows):.4f}")  # fmt: skip
    each = ", ".join(f"{lens} {rms([r.focal_percent for r in some]):.4f}" for lens, some in by_lens.items())
    print(f"focal error: {rms([r.focal_percent for r in rows]):.4f} % RMS, worst "
          f"{max(abs(r.focal_percent) for r in rows):.4f} %; {each}")  # fmt: skip
    tell({
        "sets": len(rows), "corner_px": rms([r.corner_px for r in rows]),
        "corner_worst_px": max(r.corner_px for r in rows),
        "focal_percent": rms([r.focal_percent for r in rows]),
        "focal_worst_percent": max(abs(r.focal_percent) for r in rows),
        "error_over_sigma": {
            name: rms([r.pulls[name] for r in rows if name in r.pulls])
            for name in dict.fromkeys(name for r in rows for name in r.pulls)
        },
        "direction_error_over_sigma": rms([r.direction_px / r.direction_sigma_px for r in rows]),
    })  # fmt: skip
    print(f"another kind of lens chosen: {sum(not r.pulls for r in rows)} of {len(rows)}")
    print(f"zoomed photos kept: {sum(r.zoomed_kept for r in rows)} of {len(rows)}")
    print("\nerror / sigma, RMS over the sets (its own one sigma beside it)")
    for name in dict.fromkeys(name for r in rows for name in r.pulls):
        print(told(name, [r.pulls[name] for r in rows if name in r.pulls]))
    print("direction error / sigma")
    for lens, some in by_lens.items():
        if some:
            print(told(lens, [r.direction_px / r.direction_sigma_px for r in some]))
    print(told("all lenses", [r.direction_px / r.direction_sigma_px for r in rows]))


if __name__ == "__main__":
    main()
