"""How well the intrinsics are known, and how well they predict views that were not used.

With g_v the pull of view v and S_v its part of the normal equations (bundle.py), the fit without view v is, to first
order, theta - (S - S_v)^-1 g_v' ... so leaving every view out in turn costs one small solve each and no new fit:

* held-out error: the residual of view v under the intrinsics of all the others (its pose is its own);
* covariance: sigma0^2 S^-1 believes in independent corners. Errors that a whole view shares (a bent board, motion
  while the image was read, blur) move theta more than that; the spread of the leave-one-out answers shows by how
  much
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.adjustment.bundle import (
    Corners,
    Fit,
    Model,
    adjust,
    normals,
    prior,
    project_all,
    project_with_jacobian,
    solvable,
)
from calibration.foundation.arrays import Bools, Floats

CLEARLY_MORE = 1.4
"""Scatter of one view's corners over the usual one: no accident from here on."""
FAR_SIGMAS = 3.5
"""As a distance, in sigmas of one coordinate: 0.2 % of good corners are further off."""
MEDIAN_OFF = float(np.sqrt(2 * np.log(2)))
"""Median distance of a corner that is off by one sigma per coordinate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """What a fit is worth.

    covariance     (4 + d, 4 + d) of the intrinsics; zero rows where held
    sigma0_px      of one coordinate of one corner, from the residuals and their degrees of freedom
    inflation      variance of the views' pulls on the intrinsics over that of independent corners (1: independent)
    pull           (v,) how hard each view pulls the shared unknowns, variance over that of independent corners
    without_view   (v, 4 + d) intrinsics that all the other views give
    determined     false where some direction of the unknowns is not determined at all
    """

    covariance: Floats
    sigma0_px: float
    inflation: float
    pull: Floats
    without_view: Floats
    determined: bool


def uncertainty(model: Model, fit: Fit, corners: Corners, noise_px: float) -> Uncertainty:
    """Covariance and leave-one-view-out intrinsics of an adjusted `fit`; `noise_px` is the least sigma0 believed."""
    q, free = len(model.free), solvable(model)
    equations = normals(model, fit, corners)
    sigma0 = max(_sigma0(model, fit, corners), noise_px)
    information, _ = prior(model, fit, sigma0)
    S = (equations.S + np.diag(information))[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    values = np.linalg.eigvalsh(S * np.outer(scale, scale))
    determined = bool(values[0] > 1e-12 * values[-1])
    inverse = np.outer(scale, scale) * np.linalg.pinv(S * np.outer(scale, scale), rcond=1e-14, hermitian=True)
    change = np.zeros((corners.views, model.shared))
    for v in range(corners.views):
        rest = (S - equations.S_v[v][np.ix_(free, free)]) * np.outer(scale, scale)
        pull = scale * equations.g_v[v][free]
        change[v, free] = scale * np.linalg.lstsq(rest, pull, rcond=1e-12)[0]
    parts = equations.S_v[np.ix_(np.arange(corners.views), free, free)]
    pull, inflation = _pulls(
        scale * equations.g_v[:, free], parts * np.outer(scale, scale), S * np.outer(scale, scale), sigma0
    )
    covariance = np.zeros((q, q))
    inside = np.ix_(free[:q], free[:q])
    covariance[inside] = inverse[: free[:q].sum(), : free[:q].sum()] * sigma0**2 * max(1.0, inflation)
    if model.one_focal:
        covariance = _tied_focal(covariance, fit)
        change[:, 1] = change[:, 0] * fit.intrinsics[1] / fit.intrinsics[0]
    return Uncertainty(
        covariance=covariance,
        sigma0_px=sigma0,
        inflation=inflation,
        pull=pull,
        without_view=fit.intrinsics + change[:, :q],
        determined=determined,
    )


def held_out_px(model: Model, fit: Fit, corners: Corners, without_view: Floats) -> Floats:
    """(v,) RMS residual of each view under the intrinsics that all the other views give; its pose is fitted to it."""
    held = replace(model, free=np.zeros_like(model.free), board_sigma_m=None)
    moved_board = replace(held, board_m=model.board_m + fit.bend_m)
    error = np.empty(corners.views)
    for v in range(corners.views):
        rows = corners.rows(v)
        one = Corners(
            xy=corners.xy[rows],
            index=corners.index[rows],
            view=np.zeros(rows.stop - rows.start, int),
            views=1,
            height=corners.height,
            weight=corners.weight[rows],
        )
        alone = Fit(
            intrinsics=without_view[v],
            rotation=fit.rotation[v : v + 1],
            translation_m=fit.translation_m[v : v + 1],
            turn_rad=fit.turn_rad[v : v + 1],
            bend_m=np.zeros_like(fit.bend_m),
            residual_px=fit.residual_px[rows],
            weight=one.weight,
        )
        error[v] = adjust(moved_board, alone, one, max_iterations=4).rms_px
    return error


def corner_noise_px(views_grids: list[Floats]) -> float:
    """How far corners scatter about a smooth grid, per coordinate, whatever the lens: fourth differences.

    Along a row or column the image of evenly spaced points is smooth, so (1, -4, 6, -4, 1) takes the signal away and
    leaves noise of variance 70 sigma^2. NaN entries are corners that were not seen.
    """
    squares = [
        np.diff(grid, 4, axis=axis).ravel() ** 2 / 70 for grid in views_grids for axis in (0, 1) if grid.shape[axis] > 4
    ]
    if not squares:
        return float("nan")
    every = np.concatenate(squares)
    every = every[np.isfinite(every)]
    return float(np.sqrt(every.mean())) if len(every) else float("nan")


def believed(fit: Fit, corners: Corners) -> Corners:
    """The corners with less weight where they are less exact: smeared or noisy views, and single ones far off.

    A view's own scatter is that of its residuals; only what no accident explains lowers its weight. The pull of a
    corner beyond `FAR_SIGMAS` of its view is bounded (Huber): a reflection, a dirty square.
    """
    off = np.linalg.norm(fit.residual_px, axis=1)
    count = np.bincount(corners.view, minlength=corners.views)
    middle = np.array([np.median(off[corners.rows(v)]) for v in range(corners.views)]) / MEDIAN_OFF
    scatter = middle * np.sqrt(2 * count / np.maximum(2 * count - 6, 1))
    usual = float(np.median(scatter))
    scatter = np.where(scatter > CLEARLY_MORE * usual, scatter, usual)
    limit = FAR_SIGMAS * scatter[corners.view]
    far = np.minimum(1, limit / np.maximum(off, np.maximum(limit, 1e-12)))
    return replace(corners, weight=(usual / np.maximum(scatter, 1e-12))[corners.view] ** 2 * far)


def projection_sigma_px(
    model: Model, intrinsics: Floats, covariance: Floats, rays: Floats, levelled: Bools | None = None
) -> Floats:
    """(n,) sigma of where the camera puts a direction: root of the trace of a pixel's covariance.

    A change of intrinsics that a rotation of the camera undoes does no harm (the pose takes it up), so the rotation
    that is best over the rays `levelled` (all of them, where not given) is taken off first. `rays` (n, 3).
    """
    _, by_point, by_intrinsics = project_with_jacobian(model.lens, intrinsics, rays)
    turn = np.stack([by_point @ np.cross(axis, rays)[:, :, None] for axis in np.eye(3)], axis=2)[..., 0]
    used = slice(None) if levelled is None else levelled
    flat_turn, flat = turn[used].reshape(-1, 3), by_intrinsics[used].reshape(-1, len(intrinsics))
    left = by_intrinsics - turn @ np.linalg.lstsq(flat_turn, flat, rcond=None)[0]
    return np.asarray(np.sqrt(np.einsum("nij,jk,nik->n", left, covariance, left)))


def _sigma0(model: Model, fit: Fit, corners: Corners) -> float:
    unknowns = int(solvable(model)[: len(model.free)].sum()) + model.own * corners.views
    if model.board_sigma_m is not None:
        unknowns += model.board_m.size - 6
    freedom = max(1, corners.xy.size - unknowns)
    square = float(np.sum(fit.weight[:, None] * project_residual(model, fit, corners) ** 2))
    return float(np.sqrt(square / freedom))


def project_residual(model: Model, fit: Fit, corners: Corners) -> Floats:
    """(n, 2) predicted minus observed pixels."""
    return project_all(model, fit, corners)[0] - corners.xy


def _pulls(pull: Floats, parts: Floats, S: Floats, sigma0: float) -> tuple[Floats, float]:
    """Variance of each view's pull over what independent corners would give, and the same over all views.

    With S whitened to 1, independent corners give E[g_v g_v'] = sigma0^2 (S_v - S_v^2) at the fit, so the ratios
    below have mean 1 then, whatever the views' leverages.
    """
    if len(pull) < 4:
        return np.ones(len(pull)), 1.0
    values, vectors = np.linalg.eigh(S)
    known = values > 1e-12 * values[-1]
    root = vectors[:, known] / np.sqrt(values[known])
    white = root.T @ parts @ root
    expected = np.trace(white, axis1=1, axis2=2) - np.einsum("vij,vji->v", white, white)
    size = np.sum((pull @ root) ** 2, axis=1) / sigma0**2
    return size / np.maximum(expected, 1e-12), float(size.sum() / expected.sum())


def _tied_focal(covariance: Floats, fit: Fit) -> Floats:
    tied = covariance.copy()
    ratio = fit.intrinsics[1] / fit.intrinsics[0]
    tied[1, :] = ratio * tied[0, :]
    tied[:, 1] = ratio * tied[:, 0]
    return tied
