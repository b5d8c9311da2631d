"""The adjustment: one camera, many views of one board, least squares.

View v sees board point X_i at

    x = K distort( Y / Y_z ),   Y = Z + tau (w_v x Z),   Z = R_v (X_i + e_i) + t_v

* intrinsics (fx, fy, cx, cy, distortion) are shared; those not in `free` are held;
* R_v, t_v: cam_from_board of each view;
* e_i (only with `board_sigma_m`): how far the real board is from the flat, square one, with a prior of that sigma per
  axis - small in the plane (a printer's error), larger out of it (a bent board);
* w_v (only with `turning`): how far camera or board turned, in radians, while the sensor was read out from top
  to bottom; tau = y / height - 1/2 is the moment at which the corner's image row was read. A rolling shutter.

Gauss-Newton with Levenberg's damping on the normal equations. A view's own unknowns touch nothing but that view, so
they are eliminated block by block (Schur), and only the shared ones are solved for together:

    S = sum_v H_ss - H_sv H_vv^-1 H_vs,      g_v = J_s' r - H_sv H_vv^-1 J_v' r

g_v is the pull of view v on the shared unknowns, which is what tells outlier views, held-out errors and a covariance
that does not believe in independent corners (quality of the fit, `covariance.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.boards.view import BoardView
from calibration.camera import Lens
from calibration.foundation.arrays import Bools, Floats, Ints


@dataclass(frozen=True, kw_only=True, eq=False)
class Corners:
    """All corners of all views, flat: pixel (n, 2), board corner (n,), view (n,) increasing.

    weight (n,) is 1 where a corner is as exact as usual, less where it is not: the variance is in inverse proportion.
    """

    xy: Floats
    index: Ints
    view: Ints
    views: int
    height: int
    weight: Floats

    def rows(self, view: int) -> slice:
        """The rows of one view."""
        return slice(*np.searchsorted(self.view, [view, view + 1]))


def stacked(views: Sequence[BoardView]) -> Corners:
    """The corners of `views`, which must all have the same image size."""
    return Corners(
        xy=np.concatenate([v.corners for v in views]),
        index=np.concatenate([v.index for v in views]),
        view=np.repeat(np.arange(len(views)), [len(v.index) for v in views]),
        views=len(views),
        height=views[0].image_size[1],
        weight=np.ones(sum(len(v.index) for v in views)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """What is estimated.

    free            (4 + d,) which of fx, fy, cx, cy, distortion
    board_m         (m, 3) the flat board
    board_sigma_m   (3,) prior of each axis of e_i; None: the board is taken as flat and square
    turning         the rolling shutter's w_v
    one_focal       fx / fy is held at what the start says
    """

    lens: Lens
    free: Bools
    board_m: Floats
    board_sigma_m: tuple[float, float, float] | None = None
    turning: bool = False
    one_focal: bool = False

    @property
    def shared(self) -> int:
        """Number of shared unknowns, held ones among them."""
        return len(self.free) + (0 if self.board_sigma_m is None else self.board_m.size)

    @property
    def own(self) -> int:
        """Number of unknowns of each view."""
        return 9 if self.turning else 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """An adjusted (or a first) state.

    intrinsics (4 + d,), rotation (v, 3, 3), translation_m (v, 3), turn_rad (v, 3), bend_m (m, 3): the unknowns
    residual_px (n, 2)  predicted minus observed
    weight (n,)         of each corner by the robust loss
    """

    intrinsics: Floats
    rotation: Floats
    translation_m: Floats
    turn_rad: Floats
    bend_m: Floats
    residual_px: Floats
    weight: Floats
    converged: bool = False

    @property
    def rms_px(self) -> float:
        """Root mean square distance between observed and predicted corners (OpenCV's RMS)."""
        return float(np.sqrt(np.mean(np.sum(self.residual_px**2, axis=1))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Normals:
    """Normal equations with every view's own unknowns eliminated.

    S (s, s) of the shared unknowns, S_v (v, s, s) each view's part of it, g_v (v, s) each view's pull;
    own: H_vv^-1 and H_vs of each view, with which its own step follows from the shared one.
    """

    S: Floats
    S_v: Floats
    g_v: Floats
    own_step: Floats
    own_gain: Floats


def project_all(model: Model, fit: Fit, corners: Corners) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Pixels (n, 2), their derivatives by Y (n, 2, 3) and by the intrinsics (n, 2, 4 + d), Z (n, 3), tau (n,)."""
    R = fit.rotation[corners.view]
    Z = np.einsum("nij,nj->ni", R, (model.board_m + fit.bend_m)[corners.index]) + fit.translation_m[corners.view]
    tau = corners.xy[:, 1] / corners.height - 0.5
    Y = Z + tau[:, None] * np.cross(fit.turn_rad[corners.view], Z) if model.turning else Z
    pixels, by_point, by_intrinsics = project_with_jacobian(model.lens, fit.intrinsics, Y)
    return pixels, by_point, by_intrinsics, Z, tau


def project_with_jacobian(lens: Lens, intrinsics: Floats, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Pixels (n, 2) of camera-frame points (n, 3), derivatives by point (n, 2, 3) and intrinsics (n, 2, 4 + d)."""
    fx, fy, cx, cy = intrinsics[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    zero, n, d = np.zeros(3), len(points), len(intrinsics) - 4
    if lens == "fisheye":
        pixels, jac = cv2.fisheye.projectPoints(points.reshape(-1, 1, 3), zero, zero, K, intrinsics[4:])
        jac = _floats(jac, (n, 2, -1))
        return _floats(pixels, (n, 2)), jac[:, :, 11:14], jac[:, :, :8]
    pixels, jac = cv2.projectPoints(points.reshape(-1, 1, 3), zero, zero, K, intrinsics[4:])
    jac = _floats(jac, (n, 2, -1))
    return _floats(pixels, (n, 2)), jac[:, :, 3:6], jac[:, :, 6 : 10 + d]


def _floats(array: cv2.typing.MatLike, shape: tuple[int, ...]) -> Floats:
    return np.asarray(array, float).reshape(shape)


def jacobians(model: Model, fit: Fit, corners: Corners) -> tuple[Floats, Floats, Floats]:
    """Residual (n, 2), its derivatives by the shared (n, 2, s) and by the view's own unknowns (n, 2, 6 or 9).

    Own unknowns: a small rotation about the board's origin in camera axes, translation, and w.
    """
    pixels, by_point, by_intrinsics, Z, tau = project_all(model, fit, corners)
    n, q = len(pixels), len(model.free)
    by_place = by_point
    if model.turning:
        by_place = by_point + tau[:, None, None] * (by_point @ _cross(fit.turn_rad[corners.view]))
    shared = np.zeros((n, 2, model.shared))
    shared[:, :, :q] = by_intrinsics * model.free
    if model.one_focal:
        ratio = fit.intrinsics[1] / fit.intrinsics[0]
        shared[:, :, 0] += ratio * shared[:, :, 1]
        shared[:, :, 1] = 0
    if model.board_sigma_m is not None:
        by_board = by_place @ fit.rotation[corners.view]
        place = q + 3 * corners.index[:, None] + np.arange(3)
        np.put_along_axis(shared, np.broadcast_to(place[:, None, :], by_board.shape), by_board, axis=2)
    turned = Z - fit.translation_m[corners.view]
    own = np.concatenate([-by_place @ _cross(turned), by_place], axis=2)
    if model.turning:
        own = np.concatenate([own, -tau[:, None, None] * (by_point @ _cross(Z))], axis=2)
    return pixels - corners.xy, shared, own


def _cross(v: Floats) -> Floats:
    """(n, 3, 3) with [v]x u = v x u."""
    x, y, z = v[:, 0], v[:, 1], v[:, 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def normals(model: Model, fit: Fit, corners: Corners, damping: float = 0.0) -> Normals:
    """Normal equations at `fit`, every row weighted by its robust weight; priors of the board are not in them."""
    residual, shared, own = jacobians(model, fit, corners)
    s, o, views = model.shared, model.own, corners.views
    S_v, g_v = np.empty((views, s, s)), np.empty((views, s))
    own_step, own_gain = np.empty((views, o)), np.empty((views, o, s))
    for v in range(views):
        rows = corners.rows(v)
        root = np.sqrt(fit.weight[rows])[:, None]
        r = (residual[rows] * root).ravel()
        Js, Jv = (shared[rows] * root[..., None]).reshape(-1, s), (own[rows] * root[..., None]).reshape(-1, o)
        H = Jv.T @ Jv
        if model.turning:
            H[6:, 6:] += np.eye(3) * 1e-9 * np.trace(H[:3, :3])
        H[np.diag_indices(o)] *= 1 + damping
        both = np.linalg.solve(H, np.column_stack([Jv.T @ r, Jv.T @ Js]))
        own_step[v], own_gain[v] = both[:, 0], both[:, 1:]
        S_v[v] = Js.T @ Js - Js.T @ Jv @ own_gain[v]
        g_v[v] = Js.T @ r - Js.T @ (Jv @ own_step[v])
    return Normals(S=S_v.sum(axis=0), S_v=S_v, g_v=g_v, own_step=own_step, own_gain=own_gain)


def prior(model: Model, fit: Fit, noise_px: float) -> tuple[Floats, Floats]:
    """Information (s,) and gradient (s,) of the board's prior, in pixels^2 so that it stands beside S."""
    q = len(model.free)
    information, gradient = np.zeros(model.shared), np.zeros(model.shared)
    if model.board_sigma_m is not None:
        information[q:] = np.tile((noise_px / np.asarray(model.board_sigma_m)) ** 2, len(model.board_m))
        gradient[q:] = information[q:] * fit.bend_m.ravel()
    return information, gradient


def solvable(model: Model) -> Bools:
    """(s,) which shared unknowns are estimated."""
    free = model.free.copy()
    if model.one_focal:
        free[1] = False
    return np.concatenate([free, np.ones(model.shared - len(free), bool)])


def adjust(
    model: Model,
    start: Fit,
    corners: Corners,
    *,
    noise_px: float = 0.1,
    huber_px: float | None = None,
    max_iterations: int = 60,
) -> Fit:
    """The least-squares fit from `start`; `huber_px` bounds the pull of corners further off than that."""
    fit = _weighed(replace(start, residual_px=project_all(model, start, corners)[0] - corners.xy), corners, huber_px)
    cost, damping, free = _cost(model, fit, corners, noise_px, huber_px), 1e-4, solvable(model)
    for _ in range(max_iterations):
        tried = _step(model, fit, corners, noise_px, damping, free)
        if tried is None:
            return fit
        tried = _weighed(
            replace(tried, residual_px=project_all(model, tried, corners)[0] - corners.xy), corners, huber_px
        )
        new = _cost(model, tried, corners, noise_px, huber_px)
        if not new < cost:
            damping *= 10
            if damping > 1e6:
                return replace(fit, converged=True)
            continue
        settled = cost - new < 1e-10 * cost
        fit, cost, damping = tried, new, max(damping / 10, 1e-9)
        if settled:
            return replace(fit, converged=True)
    return fit


def _step(model: Model, fit: Fit, corners: Corners, noise_px: float, damping: float, free: Bools) -> Fit | None:
    """One damped step, or None where the state has run away and there are no finite equations."""
    equations = normals(model, fit, corners, damping)
    information, gradient = prior(model, fit, noise_px)
    S = (equations.S + np.diag(information))[np.ix_(free, free)]
    if not np.isfinite(S).all():
        return None
    S[np.diag_indices(len(S))] *= 1 + damping
    step = np.zeros(model.shared)
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    right = scale * (equations.g_v.sum(axis=0) + gradient)[free]
    step[free] = -scale * np.linalg.lstsq(S * np.outer(scale, scale), right, rcond=1e-14)[0]
    if model.one_focal:
        step[1] = step[0] * fit.intrinsics[1] / fit.intrinsics[0]
    own = -equations.own_step - equations.own_gain @ np.where(free, step, 0)
    q = len(model.free)
    bend = fit.bend_m if model.board_sigma_m is None else fit.bend_m + step[q:].reshape(-1, 3)
    return replace(
        fit,
        intrinsics=fit.intrinsics + step[:q],
        rotation=_turned(fit.rotation, own[:, :3]),
        translation_m=fit.translation_m + own[:, 3:6],
        turn_rad=fit.turn_rad + own[:, 6:] if model.turning else fit.turn_rad,
        bend_m=bend,
    )


def _turned(rotation: Floats, by_rad: Floats) -> Floats:
    return np.stack([cv2.Rodrigues(w)[0] @ R for R, w in zip(rotation, by_rad, strict=True)])


def _weighed(fit: Fit, corners: Corners, huber_px: float | None) -> Fit:
    if huber_px is None:
        return replace(fit, weight=corners.weight)
    off = np.linalg.norm(fit.residual_px, axis=1)
    return replace(fit, weight=corners.weight * huber_px / np.maximum(off, huber_px))


def _cost(model: Model, fit: Fit, corners: Corners, noise_px: float, huber_px: float | None) -> float:
    off = np.linalg.norm(fit.residual_px, axis=1)
    loss = off**2 if huber_px is None else np.where(off < huber_px, off**2, 2 * huber_px * off - huber_px**2)
    _, gradient = prior(model, fit, noise_px)
    q = len(model.free)
    total = float(corners.weight @ loss + gradient[q:] @ fit.bend_m.ravel()[: len(gradient) - q])
    ahead = (
        np.isfinite(total) and fit.intrinsics[0] > 0 and fit.intrinsics[1] > 0 and (fit.translation_m[:, 2] > 0).all()
    )
    return total if ahead else float("inf")
