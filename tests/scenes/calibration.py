"""Views and photos of a checkerboard by the dozen, for the tests of `calibration`."""

from __future__ import annotations

import numpy as np

from calibration.boards.board import Board
from calibration.boards.view import BoardView
from calibration.camera import CameraModel
from pipeline.synthetic.board_views import poses, render, true_corners

BOARD = Board(cols=9, rows=6, square_m=0.025)


def computed_views(
    lens: CameraModel, count: int = 15, seed: int = 1, noise_px: float = 0.05, board: Board = BOARD, **where
) -> list[BoardView]:
    """Views without pictures: true corners and noise."""
    random = np.random.default_rng(seed + 1000)
    return [
        BoardView(
            name=f"view{i:02d}.png",
            image_size=lens.image_size,
            corners=true_corners(lens, board, pose) + random.normal(0, noise_px, (board.cols * board.rows, 2)),
            index=np.arange(board.cols * board.rows),
        )
        for i, pose in enumerate(poses(count, seed, lens, board, **where))
    ]


def rendered_photos(
    lens: CameraModel,
    count: int = 10,
    seed: int = 1,
    board: Board = BOARD,
    blur_px: float = 0.7,
    noise: float = 2.0,
    **where,
):
    """(photos, poses)."""
    placed = poses(count, seed, lens, board, **where)
    shots = [render(lens, board, p, blur_px=blur_px, noise=noise, seed=seed * 100 + i) for i, p in enumerate(placed)]
    return shots, placed
