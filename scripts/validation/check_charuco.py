"""ChArUco corners beside a checkerboard's and OpenCV's, on the same rendered photos of the same boards.

usage: python -m scripts.validation.check_charuco [--photos 40] [--first-seed 0]

Each photo (800 x 600, drawn lens, blur 0.5 to 1.2 px, noise 1 to 4 gray levels, tilts up to 55 degrees) is rendered
twice from one pose: a ChArUco board of 9x6 inner corners with markers of 18/25 of a square, and the same board without
markers. In every other photo the board reaches out of the picture; a checkerboard must be seen whole, so that there
ChArUco's error stands beside that of the whole checkerboards. OpenCV's are `CharucoDetector.detectBoard` and
`findChessboardCorners` with `cornerSubPix`. Errors are RMS per axis over all corners found.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import cv2
import numpy as np

from calibration import Board, CameraModel
from calibration.boards.charuco import charuco_board
from calibration.camera import project, unproject
from calibration.detection.find import find_board
from calibration.foundation.arrays import Floats, Ints
from pipeline.synthetic.board_views import Pose, poses
from scripts.validation.figures import tell

CHARUCO = Board(cols=9, rows=6, square_m=0.025, marker_m=0.018, dictionary="DICT_5X5_100")
PLAIN = Board(cols=9, rows=6, square_m=0.025)
SIZE, FINE, PER = (800, 600), 3, 175
"""Samples a pixel each way; texture pixels a square, a multiple of a marker's 7 cells over 18/25."""
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.001)


def sheet(board: Board) -> cv2.typing.MatLike:
    """The printed board with a white margin of one square."""
    if board.marker_m is not None:
        size = ((board.cols + 1) * PER, (board.rows + 1) * PER)
        inside = np.asarray(charuco_board(board).generateImage(size, marginSize=0))
    else:
        y, x = np.mgrid[: board.rows + 1, : board.cols + 1]
        inside = np.kron(((x + y) % 2 * 255).astype(np.uint8), np.ones((PER, PER), np.uint8))
    return cv2.copyMakeBorder(inside, PER, PER, PER, PER, cv2.BORDER_CONSTANT, value=255)


def camera(seed: int) -> CameraModel:
    """A lens of its own for each photo."""
    random = np.random.default_rng([seed, 1])
    f = random.uniform(500, 1300)
    K = [[f, 0, 399.5 + random.normal(0, 6)], [0, f, 299.5 + random.normal(0, 6)], [0, 0, 1]]
    return CameraModel(image_size=SIZE, K=np.array(K), distortion=np.array([random.uniform(-0.25, 0.1), 0.03, 0, 0]))


def pose(lens: CameraModel, seed: int, partial: bool) -> Pose:
    """The board whole in the picture, or moved so that a part of it is outside."""
    ((R, t),) = poses(1, seed, lens, PLAIN, tilt_deg=55, fill=0.6)
    if partial:
        random = np.random.default_rng([seed, 2])
        way = random.uniform(0, 2 * np.pi)
        t = t + t[2] * 0.4 * SIZE[0] / lens.K[0, 0] * np.array([np.cos(way), 0.7 * np.sin(way), 0]) - [0, 0, 0.2 * t[2]]
    return R, t


def on_sheet(lens: CameraModel, at: Pose) -> Floats:
    """(h, w, 2) pixels of the sheet that each sample of the photo sees."""
    x, y = ((np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in SIZE)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = cv2.undistortPoints(grid[:, None], lens.K, lens.distortion, None, None, None, STOP_FINE)[:, 0]
    R, t = at
    inverse = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    on_board = np.column_stack([rays, np.ones(len(rays))]) @ inverse.T
    place = on_board[:, :2] / on_board[:, 2:] / PLAIN.square_m * PER + 2 * PER - 0.5
    return np.asarray(place.reshape(SIZE[1] * FINE, SIZE[0] * FINE, 2))


def photo(board: Board, place: Floats, seed: int) -> cv2.typing.MatLike:
    """The board as the lens shows it."""
    random = np.random.default_rng([seed, 3])
    blur, noise = random.uniform(0.5, 1.2), random.uniform(1, 4)
    across, down = (place[..., i].astype(np.float32) for i in (0, 1))
    seen = cv2.remap(sheet(board), across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=160)
    small = cv2.resize(seen, SIZE, interpolation=cv2.INTER_AREA).astype(float)
    small = cv2.GaussianBlur(0.75 * small + 25, (0, 0), blur)
    return np.asarray(np.clip(small + random.normal(0, noise, small.shape), 0, 255), np.uint8)


STOP_FINE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 1e-9)


def finders(marked: cv2.typing.MatLike, plain: cv2.typing.MatLike) -> dict[str, tuple[Floats, Ints] | None]:
    """(corners, numbers) by each of the four ways."""
    every = np.arange(PLAIN.cols * PLAIN.rows)
    found: dict[str, tuple[Floats, Ints] | None] = {}
    for name, image, board in (("charuco", marked, CHARUCO), ("checkerboard", plain, PLAIN)):
        view = find_board(image, board, "")
        found[name] = None if view is None else (view.corners, view.index)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(CHARUCO)).detectBoard(marked)
    found["opencv charuco"] = None if ids is None else (np.asarray(corners, float).reshape(-1, 2), np.ravel(ids))
    good, first = cv2.findChessboardCorners(plain, (PLAIN.cols, PLAIN.rows))
    found["opencv checkerboard"] = None
    if good:
        fine = cv2.cornerSubPix(plain, first, (5, 5), (-1, -1), STOP)
        found["opencv checkerboard"] = (np.asarray(fine, float).reshape(-1, 2), every)
    return found


def error(found: tuple[Floats, Ints], true: Floats) -> Floats:
    """(n, 2); a checkerboard may be counted from either end."""
    corners, number = found
    return min((corners - way[number] for way in (true, true[::-1])), key=lambda e: float(np.abs(e).max()))


def main() -> None:
    """Draws the photos and prints the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    errors: dict[tuple[str, bool], list[Floats]] = defaultdict(list)
    for seed in range(options.first_seed, options.first_seed + options.photos):
        lens, partial = camera(seed), bool(seed % 2)
        at = pose(lens, seed, partial)
        true = project(lens, PLAIN.points_m @ at[0].T + at[1])
        assert np.isfinite(unproject(lens, true[:1])).all() or partial
        said, place = [], on_sheet(lens, at)
        for name, found in finders(photo(CHARUCO, place, seed), photo(PLAIN, place, seed)).items():
            if found is None:
                said.append(f"{name} none")
                continue
            off = error(found, true)
            errors[name, partial].append(off)
            said.append(f"{name} {len(off)}: {np.sqrt(np.mean(off**2)):.4f} (worst {np.abs(off).max():.3f})")
        print(f"{seed:>4} {'part ' if partial else 'whole'} " + ", ".join(said), flush=True)
    figures = {}
    for (name, partial), some in sorted(errors.items()):
        every = np.concatenate(some)
        key = f"{name.replace(' ', '_')}_{'partial' if partial else 'whole'}"
        figures[f"{key}_px"] = float(np.sqrt(np.mean(every**2)))
        figures[f"{key}_worst_px"] = float(np.abs(every).max())
        figures[f"{key}_corners"] = len(every)
        print(f"{name:<20} {'part ' if partial else 'whole'} {len(some):>3} photos {len(every):>5} corners "
              f"{figures[f'{key}_px']:.4f} px RMS per axis, worst {figures[f'{key}_worst_px']:.3f}")  # fmt: skip
    tell({"photos": options.photos, **figures})


if __name__ == "__main__":
    main()
