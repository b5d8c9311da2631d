"""Finding the board: ours beside OpenCV's two ways, in one run.

usage: python -m scripts.validation.bench_calibration [--rounds 7] [--only 720p] [--threads 0]

One thread each and CPU time, or, with `--threads 0`, wall time with as many threads as OpenCV takes by itself (ours
calls OpenCV too, so the same holds for all three); `calibrate` searches several photos at once besides.

20 rendered views at 1280 x 720 and 12 at 3840 x 2160 of an 11x8 board (blur 0.7 px, noise 2; seeded). Plain is
`findChessboardCorners` and `cornerSubPix` with a window of 11 as in OpenCV's tutorial. Each view is searched in turn
by all three, several rounds, and a view's time is its median; ours checks every corner and measures blur besides.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np

from calibration import Board
from calibration.detection.find import find_board
from calibration.foundation.arrays import Floats
from pipeline.synthetic.board_views import camera, poses, render, true_corners
from scripts.validation.figures import tell

BOARD = Board(cols=11, rows=8, square_m=0.03)
LENS = (-0.28, 0.09, 0.0008, -0.0006, -0.01)
CASES = (("20 views 720p", 20, 1280, 720, 1000.0), ("12 views 4K", 12, 3840, 2160, 3000.0))
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.001)
Finder = Callable[[cv2.typing.MatLike], Floats | None]


def ours(gray: cv2.typing.MatLike) -> Floats | None:
    """`find_board`."""
    view = find_board(gray, BOARD, "")
    return None if view is None or len(view.index) < BOARD.cols * BOARD.rows else view.corners


def plain(gray: cv2.typing.MatLike) -> Floats | None:
    """`findChessboardCorners` and `cornerSubPix`."""
    found, corners = cv2.findChessboardCorners(gray, (BOARD.cols, BOARD.rows))
    return cv2.cornerSubPix(gray, corners, (11, 11), (-1, -1), STOP).reshape(-1, 2) if found else None


def sector(gray: cv2.typing.MatLike) -> Floats | None:
    """`findChessboardCornersSB`."""
    found, corners = cv2.findChessboardCornersSB(gray, (BOARD.cols, BOARD.rows))
    return corners.reshape(-1, 2) if found else None


FINDERS: dict[str, Finder] = {"ours": ours, "plain": plain, "SB": sector}


def measured(
    photos: list[cv2.typing.MatLike], truth: list[Floats], rounds: int, clock: Callable[[], float]
) -> dict[str, tuple[float, float, int]]:
    """(ms per view, RMS error per axis, views found whole) of every finder."""
    ms: dict[str, list[list[float]]] = {name: [[] for _ in photos] for name in FINDERS}
    off: dict[str, list[Floats]] = {name: [] for name in FINDERS}
    for round_ in range(rounds):
        for name, find in _in_turn(round_):
            if name == "SB" and round_ > 0:
                continue  # a hundred times slower than the rest: once is exact enough
            for i, (gray, true) in enumerate(zip(photos, truth, strict=True)):
                begin = clock()
                corners = find(gray)
                ms[name][i].append((clock() - begin) * 1000)
                if round_ == 0 and corners is not None:
                    ways = (corners - true, corners - true[::-1])
                    off[name].append(min(ways, key=lambda e: float(np.abs(e).max())))
    return {
        name: (
            float(np.mean([np.median(t) for t in ms[name]])),
            float(np.sqrt(np.mean(np.concatenate(off[name]) ** 2))),
            len(off[name]),
        )
        for name in FINDERS
    }


def _in_turn(turn: int) -> list[tuple[str, Finder]]:
    """The finders, another one first each round. Each goes through all photos, as it would in use."""
    every = list(FINDERS.items())
    return every[turn % 3 :] + every[: turn % 3]


def main() -> None:
    """Renders, measures, prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", choices=("720p", "4K"), help="one of the two sizes")
    parser.add_argument("--threads", type=int, choices=(0, 1), default=1, help="of OpenCV; 0: what it takes by itself")
    options = parser.parse_args()
    if options.threads:
        cv2.setNumThreads(options.threads)
    clock = time.thread_time if options.threads else time.perf_counter
    kind = "CPU" if options.threads else "wall"
    print(f"OpenCV's threads: {cv2.getNumThreads()}, {kind} time")
    print(f"{'':<16}{'':<8}{'ms a view':>10}{'times ours':>12}{'corner px':>11}{'found':>7}")
    for title, count, width, height, focal in CASES:
        if options.only and options.only not in title:
            continue
        lens = camera(width, height, focal, LENS)
        placed = poses(count, 3, lens, BOARD)
        photos = [render(lens, BOARD, pose, seed=i, supersample=1) for i, pose in enumerate(placed)]
        figures = measured(photos, [true_corners(lens, BOARD, pose) for pose in placed], options.rounds, clock)
        for name, (ms, px, found) in figures.items():
            tell(
                {
                    f"{title.split()[-1]} {name}": {
                        "ms_a_view": ms,
                        "times_ours": ms / figures["ours"][0],
                        "corner_px": px,
                    }
                }
            )
            print(f"{title:<16}{name:<8}{ms:>10.2f}{ms / figures['ours'][0]:>12.2f}{px:>11.4f}{found:>7}", flush=True)


if __name__ == "__main__":
    main()
