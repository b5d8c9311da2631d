"""Two cameras in one folder, however alike: do the views fall into two groups that want other intrinsics?

At the fit of all views together, view v pulls the shared unknowns by g_v and holds them by S_v (adjustment/bundle.py),
and sum g_v = 0. If the views of a group G had focal lengths and principal point p of their own, the sum of squares
would fall by

    gain(G) = g' (D - B' S^-1 B)^-1 g,     g = sum_G g_v[p],  B = sum_G S_v[:, p],  D = sum_G S_v[p, p]

and by `free` if every view had its own. The variance is what that last fit leaves. Two cameras explain nearly all that
separate ones would; of views that merely scatter (motion, a bent board), the best cut explains two thirds
(a normal variable cut at its mean: 2 / pi). Where one view alone brings most of what the cut brings, and the two
cameras would be more alike than two of one type are, there is one camera and one bad view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.adjustment.bundle import Corners, Fit, Model, adjust, normals, prior, solvable, stacked
from calibration.adjustment.initialisation import posed
from calibration.boards.view import BoardView
from calibration.foundation.arrays import Bools, Floats

LEAST_GROUP, LEAST_VIEWS = 3, 6
"""Views of each group, and in all: with fewer, one bad view is a camera."""

CERTAIN, A_VIEW = 18.0, 0.9
"""Gain over the variance that two cameras must bring, and more for each view: there are 2^(n - 1) ways to cut n views.
One camera's views bring 7 to 23 (8 to 25 views, 12 sets); 10 of 15 views of a camera whose principal point is 4 px off
bring 35."""

EXPLAINED = 0.8
"""Share of what cameras of their own for all views would explain, beyond chance."""

ONE_VIEW, ALIKE_PX = 0.6, 1.0
"""Share of the gain that one view brings alone, and how far principal points and focal lengths (at the edge of the
picture) of the two groups are apart at most, for that view to be the cause. Of 40 mixtures of two cameras 36 have a
share under 0.5 (equal groups of n views: 2 / n), and the principal points of a type scatter by 2 to 20 px."""

SAME_PX = 0.3
"""Groups that are less apart than this are one camera: a lens sits no firmer in its mount, and what corner finders and
lens models leave (a hundredth of a pixel, the same in like views) makes such differences certain but not real."""

TURNED_PX = 3.0
"""How near the principal points of two groups are to mirroring each other where photos were turned by 180 degrees."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoCameras:
    """Two groups of views and the intrinsics (4,) fx, fy, cx, cy of each.

    gain       over the variance; of the other three: what was needed
    explained  share of what separate cameras for all views would explain
    turned     one group's principal point is the other's, turned by 180 degrees
    bad_view   the view that explains the difference by itself: one camera after all; None where two took the views
    """

    first: Bools
    intrinsics: tuple[Floats, Floats]
    gain: float
    explained: float
    turned: bool
    bad_view: int | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parts:
    """S^-1 (f, f) of the free unknowns, and of each view B (v, f, p), D (v, p, p), g (v, p)."""

    inverse: Floats
    B: Floats
    D: Floats
    g: Floats


def like_cameras(model: Model, fit: Fit, views: Sequence[BoardView]) -> TwoCameras | None:
    """The two cameras that took `views`, or None where one did, as far as they tell. `fit` is that of all together."""
    corners = stacked(views)
    if corners.views < LEAST_VIEWS:
        return None
    fit = adjust(model, fit, corners, max_iterations=15)
    parts = _parts(model, fit, corners)
    best = _best_cut(parts)
    if best is None:
        return None
    own, count = parts.g.shape[1], corners.views
    free = _gain_of_all(model, fit, corners, parts)
    unknowns = int(solvable(model).sum()) + model.own * count + own * (count - 1)
    variance = (float(np.sum(fit.residual_px**2)) - free) / max(1, corners.xy.size - unknowns)
    if variance <= 0:
        return None
    gain = _gain(parts, best) / variance
    explained = (gain - own) / max(free / variance - own * (count - 1), 1e-9)
    if gain < CERTAIN + A_VIEW * count or explained < EXPLAINED:
        return None
    each = tuple(_intrinsics(model, fit, views, mask) for mask in (best, ~best))
    apart_px = _apart_px(each[0], each[1], views[0].image_size)
    if apart_px < SAME_PX:
        return None
    return TwoCameras(
        first=best,
        intrinsics=(each[0], each[1]),
        gain=gain,
        explained=explained,
        turned=_turned(each[0], each[1], views[0].image_size),
        bad_view=_bad_view(parts, best) if apart_px < ALIKE_PX else None,
    )


def _parts(model: Model, fit: Fit, corners: Corners) -> _Parts:
    equations = normals(model, fit, corners)
    information, _ = prior(model, fit, 1.0)
    free = np.flatnonzero(solvable(model))
    S = (equations.S + np.diag(information))[np.ix_(free, free)]
    own = np.flatnonzero(solvable(model)[:4])
    return _Parts(
        inverse=np.asarray(np.linalg.pinv(S, rcond=1e-13, hermitian=True), float),
        B=equations.S_v[:, free][:, :, own],
        D=equations.S_v[:, own][:, :, own],
        g=equations.g_v[:, own],
    )


def _gain(parts: _Parts, group: Bools) -> float:
    """By how much the sum of squares would fall if the views of `group` had p of their own."""
    B, D, g = parts.B[group].sum(axis=0), parts.D[group].sum(axis=0), parts.g[group].sum(axis=0)
    left = D - B.T @ parts.inverse @ B
    values, vectors = np.linalg.eigh((left + left.T) / 2)
    known = values > 1e-9 * max(values[-1], 1e-300)
    return float(np.sum((vectors.T @ g)[known] ** 2 / values[known]))


def _apart_px(one: Floats, other: Floats, size: tuple[int, int]) -> float:
    """How far two cameras (4,) are apart: by principal point, or by focal length at the edge of the picture."""
    edge = np.hypot(*size) / 2 * np.abs(one[:2] / other[:2] - 1)
    return float(np.concatenate([edge, np.abs(one[2:] - other[2:])]).max())


def _bad_view(parts: _Parts, group: Bools) -> int | None:
    """The view that explains the cut alone."""
    count = len(group)
    alone = [_gain(parts, np.arange(count) == view) for view in range(count)]
    worst = int(np.argmax(alone))
    return worst if alone[worst] > ONE_VIEW * _gain(parts, group) else None


def _gain_of_all(model: Model, fit: Fit, corners: Corners, parts: _Parts) -> float:
    """The same if every view had p of its own: p is eliminated view by view, and what stays shared moves once more."""
    equations = normals(model, fit, corners)
    free = np.flatnonzero(solvable(model))
    rest = free[~np.isin(free, np.flatnonzero(solvable(model)[:4]))]
    total = 0.0
    S, pull = np.zeros((len(rest), len(rest))), np.zeros(len(rest))
    for v in range(corners.views):
        inverse = np.linalg.pinv(parts.D[v], rcond=1e-9, hermitian=True)
        across = equations.S_v[v][np.ix_(rest, np.flatnonzero(solvable(model)[:4]))]
        total += float(parts.g[v] @ inverse @ parts.g[v])
        S += equations.S_v[v][np.ix_(rest, rest)] - across @ inverse @ across.T
        pull += equations.g_v[v][rest] - across @ inverse @ parts.g[v]
    return total + float(pull @ np.linalg.pinv(S, rcond=1e-9, hermitian=True) @ pull) if len(rest) else total


def _best_cut(parts: _Parts) -> Bools | None:
    """The group of the largest gain: cuts along each of p, then views moved one by one while that gains."""
    count, starts = len(parts.g), []
    scale = np.sqrt(np.maximum(np.einsum("vpp->vp", parts.D), 1e-300))
    for axis in range(parts.g.shape[1]):
        order = np.argsort(parts.g[:, axis] / scale[:, axis])
        for cut in range(LEAST_GROUP, count - LEAST_GROUP + 1):
            group = np.zeros(count, bool)
            group[order[:cut]] = True
            starts.append((_gain(parts, group), group))
    starts.sort(key=lambda start: -start[0])
    climbed = [_climbed(parts, gain, group) for gain, group in starts[:STARTS]]
    return max(climbed, key=lambda end: end[0])[1] if climbed else None


STARTS, MOST_MOVES = 6, 200
"""Cuts that are improved, and views moved at most."""


def _climbed(parts: _Parts, gain: float, group: Bools) -> tuple[float, Bools]:
    for _ in range(MOST_MOVES):
        tried = []
        for v in range(len(group)):
            other = group.copy()
            other[v] = ~other[v]
            if LEAST_GROUP <= other.sum() <= len(group) - LEAST_GROUP:
                tried.append((_gain(parts, other), v))
        if not tried or max(tried)[0] <= gain * (1 + 1e-9):
            break
        gain, v = max(tried)
        group = group.copy()
        group[v] = ~group[v]
    return gain, group


def _intrinsics(model: Model, fit: Fit, views: Sequence[BoardView], mask: Bools) -> Floats:
    """(4,) focal lengths and principal point of a group, the distortion held."""
    corners = stacked([view for view, inside in zip(views, mask, strict=True) if inside])
    few = replace(model, free=model.free & (np.arange(len(model.free)) < 4), board_sigma_m=None)
    return adjust(few, posed(few, corners, fit.intrinsics), corners, max_iterations=30).intrinsics[:4]


def _turned(one: Floats, other: Floats, size: tuple[int, int]) -> bool:
    """Whether one principal point is the other's, turned by 180 degrees, and they are not one point."""
    mirrored = np.array(size) - 1 - other[2:]
    apart = float(np.abs(one[2:] - other[2:]).max())
    return float(np.abs(one[2:] - mirrored).max()) < min(TURNED_PX, 0.3 * apart)
