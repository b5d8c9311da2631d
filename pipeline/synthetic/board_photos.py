"""Photos of a checkerboard through the scene's lens.

Every pixel is traced back through the lens onto the board's plane, twice finer than the photo in each direction, then
averaged, blurred and given noise. Board axes: origin at the first inner corner, x along a row, y along a column.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from calibration.camera import CameraModel, project
from calibration.foundation.arrays import Floats
from pipeline.synthetic.landscape import Image
from pipeline.synthetic.render import Grain, Optics, grain_of, sensed

FINE = 2
OPTICS = Optics(blur_px=0.7, noise=2.0)
DARK, PAPER, DESK = 38, 222, 128


@dataclass(frozen=True, kw_only=True)
class PrintedBoard:
    """A checkerboard of `columns` x `rows` inner corners with squares of `square_m`, on paper one square wider."""

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def inner_corners(self) -> Floats:
        """(columns * rows, 3) in board axes, row by row."""
        grid = np.stack(np.meshgrid(np.arange(self.columns), np.arange(self.rows)), axis=-1).reshape(-1, 2)
        return np.hstack([grid * self.square_m, np.zeros((len(grid), 1))])

    def paper(self) -> Floats:
        """The paper's corners (4, 3) in board axes."""
        low, right, bottom = -2 * self.square_m, (self.columns + 1) * self.square_m, (self.rows + 1) * self.square_m
        return np.array([[low, low, 0.0], [right, low, 0.0], [right, bottom, 0.0], [low, bottom, 0.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardPose:
    """Board axes in camera axes: x_cam = cam_from_board x_board + place_cam_m."""

    cam_from_board: Floats
    place_cam_m: Floats


def board_poses(lens: CameraModel, board: PrintedBoard, *, count: int, seed: int) -> tuple[BoardPose, ...]:
    """Poses that spread the board over the image, tilted up to 38 degrees, the whole paper in sight."""
    rng = np.random.default_rng([seed, 6])
    width, height = lens.image_size
    across = int(np.ceil(np.sqrt(count * width / height)))
    cells = [(i % across, i // across) for i in range(count)]
    down = cells[-1][1] + 1
    made = []
    for column, row in cells:
        aim = np.array([(column + 0.5) / across * width, (row + 0.5) / down * height])
        while True:
            pose = _drawn_pose(lens, board, aim, rng)
            paper = project(lens, board.paper() @ pose.cam_from_board.T + pose.place_cam_m)
            if np.isfinite(paper).all() and ((paper > 4) & (paper < np.array([width, height]) - 5)).all():
                break
            aim = aim + 0.06 * (np.array([width, height]) / 2 - aim)
        made.append(pose)
    return tuple(made)


def _drawn_pose(lens: CameraModel, board: PrintedBoard, aim_px: Floats, rng: np.random.Generator) -> BoardPose:
    tilt = rng.uniform(12, 38)
    way = rng.uniform(0, 2 * np.pi)
    spin = rng.normal(0, 8.0)
    turn = Rotation.from_euler("z", spin, degrees=True) * Rotation.from_rotvec(
        np.radians(tilt) * np.array([np.cos(way), np.sin(way), 0.0])
    )
    long_m = (board.columns + 3) * board.square_m
    distance = long_m * lens.K[0, 0] / (rng.uniform(0.42, 0.72) * lens.image_size[0])
    ray = np.array([*((aim_px - lens.K[:2, 2]) / lens.K[[0, 1], [0, 1]]), 1.0])
    middle = board.inner_corners().mean(axis=0)
    return BoardPose(cam_from_board=turn.as_matrix(), place_cam_m=distance * ray - turn.as_matrix() @ middle)


def photos(lens: CameraModel, board: PrintedBoard, *, count: int, seed: int) -> Iterator[Image]:
    """`count` photos (rows, columns, 3), blue, green, red; the same seed gives the same pixels."""
    rng = np.random.default_rng([seed, 7])
    rays, grain = _fine_rays(lens), grain_of(lens.image_size, OPTICS.noise, rng)
    for pose in board_poses(lens, board, count=count, seed=seed):
        yield _photo(lens, board, pose, rays, grain, rng)


def _fine_rays(lens: CameraModel) -> npt.NDArray[np.float32]:
    """Where each fine pixel looks on the plane z = 1."""
    width, height = lens.image_size
    columns, rows = ((np.arange(size * FINE) + 0.5) / FINE - 0.5 for size in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-9)
    flat = cv2.undistortPoints(pixels, lens.K, lens.distortion, None, None, None, stop)
    return np.asarray(flat, np.float32).reshape(height * FINE, width * FINE, 2)


def _photo(
    lens: CameraModel,
    board: PrintedBoard,
    pose: BoardPose,
    rays: npt.NDArray[np.float32],
    grain: Grain,
    rng: np.random.Generator,
) -> Image:
    width, height = lens.image_size
    distance = float((pose.cam_from_board @ board.inner_corners().mean(axis=0) + pose.place_cam_m)[2])
    per_square = max(4, round(FINE * lens.K[0, 0] * board.square_m / distance))
    print_, texel_from_board = _printed(board, per_square)
    plane_in_cam = np.column_stack([pose.cam_from_board[:, 0], pose.cam_from_board[:, 1], pose.place_cam_m])
    lookup = cv2.perspectiveTransform(rays, texel_from_board @ np.linalg.inv(plane_in_cam))
    border = cv2.BORDER_CONSTANT
    fine = cv2.remap(print_, lookup, None, cv2.INTER_LINEAR, borderMode=border, borderValue=DESK)  # type: ignore[call-overload]
    grey = np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), np.float32)
    light = [
        np.linspace(1 - a, 1 + a, size, dtype=np.float32)
        for a, size in zip(rng.uniform(-0.1, 0.1, 2), (width, height), strict=True)
    ]
    grey *= light[0] * light[1][:, None]
    tinted = cv2.merge([np.clip(grey * shade, 0, 255).astype(np.uint8) for shade in (0.97, 1.0, 1.02)])
    return sensed(np.asarray(tinted, np.uint8), OPTICS, grain, rng)


def _printed(board: PrintedBoard, per_square: int) -> tuple[Image, Floats]:
    """The paper with `per_square` texels to a square, and board metres to texels (3, 3)."""
    squares = (np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2).astype(np.uint8)
    pattern = np.kron(squares, np.ones((per_square, per_square), np.uint8)) * (PAPER - DARK) + DARK
    paper = np.pad(pattern, per_square, constant_values=PAPER).astype(np.uint8)
    scale = per_square / board.square_m
    first = 2 * per_square - 0.5
    return paper, np.array([[scale, 0.0, first], [0.0, scale, first], [0.0, 0.0, 1.0]])
