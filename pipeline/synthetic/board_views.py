"""Computed and rendered views of a checkerboard through a known lens, with their truth: what calibration is checked by.

Finer than `board_photos` (each squares' edge is as wide as one sample, so that corners can be compared to 0.01 px), and
plainer: one gray wall, light that falls off to one side.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.camera import CameraModel, Lens, project, unproject
from calibration.foundation.arrays import Floats

LENS = (-0.28, 0.09, 0.0008, -0.0006, 0.0)
Pose = tuple[Floats, Floats]
"""(R, t) of cam_from_board."""


def camera(
    width: int = 640,
    height: int = 480,
    focal: float = 540.0,
    distortion: tuple[float, ...] = LENS,
    model: Lens = "pinhole",
) -> CameraModel:
    """A camera whose principal point is a little off the middle."""
    K = [[focal, 0, width / 2 + 4.3], [0, focal * 1.001, height / 2 - 6.2], [0, 0, 1]]
    return CameraModel(model=model, image_size=(width, height), K=np.array(K), distortion=np.array(distortion))


def poses(
    count: int, seed: int, lens: CameraModel, board: Board, *, tilt_deg: float = 45.0, fill: float = 0.55
) -> list[Pose]:
    """`count` poses (R, t) of cam_from_board, the board inside the image, tilted up to `tilt_deg`."""
    random = np.random.default_rng(seed)
    found: list[Pose] = []
    edge = outline(board)
    for _ in range(400 * count):
        if len(found) == count:
            return found
        tilt = np.radians(random.uniform(0.3, 1.0) * tilt_deg) if tilt_deg else 0.0
        axis = random.uniform(0, 2 * np.pi)
        R = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0]))[0]
        R = R @ cv2.Rodrigues(np.array([0, 0, random.uniform(-np.pi, np.pi)]))[0]
        far = (
            lens.K[0, 0] * (board.cols + 1) * board.square_m / (fill * random.uniform(0.75, 1.25) * lens.image_size[0])
        )
        pixel = random.uniform(0.1, 0.9, 2) * lens.image_size
        ray = unproject(lens, pixel[None])[0]
        t = ray / ray[2] * far - R @ board.points_m.mean(axis=0)
        px = project(lens, edge @ R.T + t)
        if np.isfinite(px).all() and (px > 4).all() and (px < np.array(lens.image_size) - 5).all():
            found.append((np.asarray(R, dtype=float), t))
    raise AssertionError("no room for that many poses")


def outline(board: Board) -> Floats:
    """Corners of the printed squares' outer edge, a little further out."""
    low, high_x, high_y = -1.2, board.cols + 0.2, board.rows + 0.2
    return np.array([[low, low, 0], [high_x, low, 0], [low, high_y, 0], [high_x, high_y, 0]]) * board.square_m


def true_corners(lens: CameraModel, board: Board, pose: Pose, bend: Floats | None = None) -> Floats:
    """(n, 2) pixels of the inner corners."""
    R, t = pose
    points = board.points_m if bend is None else board.points_m + bend
    return project(lens, points @ R.T + t)


@lru_cache(maxsize=4)
def _rays(lens: CameraModel, supersample: int) -> Floats:
    """Directions (h * s, w * s, 2) on the plane z = 1 of the sub-pixels."""
    width, height = lens.image_size
    x = (np.arange(width * supersample) + 0.5) / supersample - 0.5
    y = (np.arange(height * supersample) + 0.5) / supersample - 0.5
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    if lens.model == "fisheye":
        flat = cv2.fisheye.undistortPoints(grid[:, None], lens.K, lens.distortion)
    else:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        flat = cv2.undistortPoints(grid[:, None], lens.K, lens.distortion, None, None, None, stop)
    return flat.astype(float).reshape(height * supersample, width * supersample, 2)


def render(
    lens: CameraModel,
    board: Board,
    pose: Pose,
    *,
    blur_px: float = 0.7,
    noise: float = 2.0,
    seed: int = 0,
    supersample: int = 2,
    motion_px: float = 0.0,
) -> cv2.typing.MatLike:
    """The photo (h, w) uint8 of the board in front of a gray wall; light falls off to one side.

    `motion_px` is by how much the image moved to the lower right while it was exposed.
    """
    width, height = lens.image_size
    small = np.full((height, width), 110.0)
    place = _around(lens, board, pose)
    part = _rays(lens, supersample)[tuple(slice(s.start * supersample, s.stop * supersample) for s in place)]
    tone = _tone(part, board, pose)
    rows, cols = tone.shape[0] // supersample, tone.shape[1] // supersample
    small[place] = tone.reshape(rows, supersample, cols, supersample).mean(axis=(1, 3))
    small *= np.linspace(0.8, 1.0, width)
    if blur_px:
        small = cv2.GaussianBlur(small, (0, 0), blur_px)
    if motion_px:
        small = cv2.filter2D(small, -1, _smear(motion_px))
    noisy = small + np.random.default_rng(seed).normal(0, noise, small.shape)
    return np.clip(noisy + 0.5, 0, 255).astype(np.uint8)


def _around(lens: CameraModel, board: Board, pose: Pose) -> tuple[slice, slice]:
    """Rows and columns of the image that hold the paper."""
    R, t = pose
    edge = np.linspace(0, 1, 30)
    low, right, bottom = -1.6, board.cols + 0.6, board.rows + 0.6
    x, y = low + edge * (right - low), low + edge * (bottom - low)
    sides = [(x, np.full(30, low)), (x, np.full(30, bottom)), (np.full(30, low), y), (np.full(30, right), y)]
    rim = np.concatenate([np.stack([a, b, np.zeros(30)], axis=1) for a, b in sides]) * board.square_m
    pixels = project(lens, rim @ R.T + t)
    size = np.array(lens.image_size)
    first = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 3, 0, size - 1)
    last = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 4, 1, size)
    return slice(first[1], last[1]), slice(first[0], last[0])


def _tone(rays: Floats, board: Board, pose: Pose) -> Floats:
    """Brightness of what the rays (h, w, 2) on the plane z = 1 meet."""
    R, t = pose
    inverse = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    w = rays[..., 0] * inverse[2, 0] + rays[..., 1] * inverse[2, 1] + inverse[2, 2]
    u = (rays[..., 0] * inverse[0, 0] + rays[..., 1] * inverse[0, 1] + inverse[0, 2]) / w / board.square_m
    v = (rays[..., 0] * inverse[1, 0] + rays[..., 1] * inverse[1, 1] + inverse[1, 2]) / w / board.square_m
    dark = (1 + _square_wave(u) * _square_wave(v)) / 2
    squares = (u > -1) & (u < board.cols) & (v > -1) & (v < board.rows)
    paper = (u > -1.6) & (u < board.cols + 0.6) & (v > -1.6) & (v < board.rows + 0.6)
    return np.where(squares, 215.0 - 185.0 * dark, np.where(paper, 215.0, 110.0))


def _smear(length_px: float) -> Floats:
    """Kernel of a straight motion at 30 degrees, its middle in the middle."""
    half = int(np.ceil(length_px / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    for s in np.linspace(-0.5, 0.5, 201) * length_px:
        x, y = half + s * np.cos(np.pi / 6), half + s * np.sin(np.pi / 6)
        i, j = int(y), int(x)
        fy, fx = y - i, x - j
        for di, wy in ((0, 1 - fy), (1, fy)):
            for dj, wx in ((0, 1 - fx), (1, fx)):
                kernel[min(i + di, 2 * half), min(j + dj, 2 * half)] += wy * wx
    return np.asarray(kernel / kernel.sum(), dtype=float)


def _square_wave(u: Floats) -> Floats:
    """+1 and -1 in turn from one whole number to the next, the step as wide as one sample: no staircases."""
    down, across = np.gradient(u)
    past = u - np.round(u)
    sign = np.where(np.round(u) % 2 == 0, 1.0, -1.0)
    return np.asarray(sign * np.clip(2 * past / np.maximum(np.abs(down) + np.abs(across), 1e-12), -1, 1))
