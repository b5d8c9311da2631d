"""A first state that outlier views cannot spoil: the focal length whose median view fits best."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.adjustment.bundle import Corners, Fit, Model, adjust
from calibration.camera import Lens
from calibration.foundation.arrays import Floats

FOCAL_SCAN = np.geomspace(0.35, 12.0, 22)
FISHEYE_SCAN = np.geomspace(0.2, 1.5, 14)


def first_fit(model: Model, corners: Corners, image_size: tuple[int, int]) -> Fit:
    """Scans the focal length with an undistorted lens, then lets focal length and k1 settle under a robust loss."""
    width, height = image_size
    scan = FISHEYE_SCAN if model.lens == "fisheye" else FOCAL_SCAN
    tried = []
    for focal in scan * max(width, height):
        intrinsics = np.zeros(len(model.free))
        intrinsics[:4] = focal, focal, (width - 1) / 2, (height - 1) / 2
        tried.append(posed(model, corners, intrinsics))
    best = min(tried, key=lambda fit: float(np.nan_to_num(np.median(view_rms_px(fit, corners)), nan=np.inf)))
    for unlocked in (1, 2):
        free = np.zeros(len(model.free), bool)
        free[[0, 1, 4] if unlocked == 1 and len(free) > 4 else [0, 1]] = True
        if unlocked == 2:
            free = model.free & (np.arange(len(free)) < 8)
        loose = float(np.clip(2 * np.median(view_rms_px(best, corners)), 0.5, 50))
        stage = Model(lens=model.lens, free=free & model.free, board_m=model.board_m, one_focal=unlocked == 1)
        best = adjust(stage, best, corners, huber_px=loose, max_iterations=30)
    return best


def posed(model: Model, corners: Corners, intrinsics: Floats) -> Fit:
    """Every view's pose for given intrinsics, by the planar pose solver."""
    normal = normalised(model.lens, intrinsics, corners.xy)
    rotation, translation = np.empty((corners.views, 3, 3)), np.empty((corners.views, 3))
    for v in range(corners.views):
        rows = corners.rows(v)
        rotation[v], translation[v] = plane_pose(model.board_m[corners.index[rows]], normal[rows])
    blank = Fit(
        intrinsics=intrinsics,
        rotation=rotation,
        translation_m=translation,
        turn_rad=np.zeros((corners.views, 3)),
        bend_m=np.zeros_like(model.board_m),
        residual_px=np.zeros_like(corners.xy),
        weight=np.ones(len(corners.xy)),
    )
    held = Model(lens=model.lens, free=np.zeros(len(model.free), bool), board_m=model.board_m)
    return adjust(held, blank, corners, max_iterations=3)


def normalised(lens: Lens, intrinsics: Floats, xy: Floats) -> Floats:
    """Points (n, 2) on the plane z = 1 that the pixels (n, 2) see."""
    fx, fy, cx, cy = intrinsics[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    pixels = xy.reshape(-1, 1, 2)
    if lens == "fisheye":
        return np.asarray(cv2.fisheye.undistortPoints(pixels, K, intrinsics[4:]), float).reshape(-1, 2)
    return np.asarray(cv2.undistortPoints(pixels, K, intrinsics[4:]), float).reshape(-1, 2)


def plane_pose(board: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """cam_from_board of a flat board (n, 3) from its undistorted directions (n, 2)."""
    found, turn, shift = cv2.solvePnP(board, normal.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    if not found or not np.isfinite(shift).all() or shift[2, 0] <= 0:
        return np.eye(3), np.array([0.0, 0.0, 10 * np.ptp(board[:, 0])])
    return np.asarray(cv2.Rodrigues(turn)[0], float), np.asarray(shift, float).ravel()


def view_rms_px(fit: Fit, corners: Corners) -> Floats:
    """(v,) root mean square residual of each view."""
    square = np.sum(fit.residual_px**2, axis=1)
    return np.sqrt(
        np.bincount(corners.view, square, corners.views) / np.bincount(corners.view, minlength=corners.views)
    )
