"""Views that do not belong: single bad ones, and two cameras in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.adjustment.bundle import Corners, Fit, Model, adjust, stacked
from calibration.adjustment.covariance import uncertainty
from calibration.adjustment.initialisation import first_fit, posed, view_rms_px
from calibration.boards.view import BoardView
from calibration.foundation.arrays import Bools, Floats

TIMES_MEDIAN = 3.0
LEAST_EXCESS_PX = 0.1
TRIALS = 10
REGROUPED = 5
LEAST_GROUP = 3
APART = 0.6
"""Two cameras: each group's RMS is at most this share of what they leave together ..."""
LEAST_FOCAL_CHANGE = 0.005
"""... and the focal lengths differ by this, relative."""
HARD_PULL = 8.0
"""Variance of a view's pull on the camera, over the typical view's: beyond it the view contradicts the others."""


def agreeing(model: Model, views: Sequence[BoardView]) -> tuple[Fit, Bools, Floats]:
    """A robust fit of all views, which views agree with it, and the RMS of each."""
    corners = stacked(views)
    fit = first_fit(model, corners, views[0].image_size)
    for _ in range(2):
        limit = float(np.clip(3 * np.median(view_rms_px(fit, corners)), 0.1, 20))
        fit = adjust(model, fit, corners, huber_px=limit, max_iterations=30)
    rms = view_rms_px(fit, corners)
    typical = float(np.median(rms))
    return fit, np.asarray(rms <= max(TIMES_MEDIAN * typical, typical + LEAST_EXCESS_PX)), rms


def kept(fit: Fit, corners: Corners, which: Bools) -> Fit:
    """The part of a fit that belongs to the views `which`."""
    rows = which[corners.view]
    return replace(
        fit,
        rotation=fit.rotation[which],
        translation_m=fit.translation_m[which],
        turn_rad=fit.turn_rad[which],
        residual_px=fit.residual_px[rows],
        weight=fit.weight[rows],
    )


def contradicting(
    model: Model, fit: Fit, views: Sequence[BoardView], least_px: float
) -> tuple[list[BoardView], list[tuple[BoardView, float]], Fit]:
    """The views without those that fit well by themselves but want another camera, those with the pull, the new fit.

    A photo of a slightly other zoom or focus leaves hardly a residual, since the board's distance takes it up. One
    view at a time, the hardest first, and at most a fifth of them.
    """
    left, gone = list(views), []
    fit = adjust(model, fit, stacked(left), max_iterations=30)
    while len(left) > max(5, 0.8 * len(views)):
        pull = uncertainty(model, fit, stacked(left), least_px).pull
        worst = int(np.argmax(pull))
        if not pull[worst] > HARD_PULL * max(1.0, float(np.median(pull))):
            break
        stays = np.arange(len(left)) != worst
        fit = adjust(model, kept(fit, stacked(left), stays), stacked([*left[:worst], *left[worst + 1 :]]))
        gone.append((left.pop(worst), float(np.sqrt(pull[worst]))))
    return left, gone, fit


LEAST_ZOOM_PERCENT = 0.1
"""Change of the focal length from which a view is said to be of another zoom."""
MOST_OF_IT = 0.8
"""Share of a view's contradiction that focal lengths or the principal point alone must explain to be named for it."""


def what_differs(model: Model, others: Fit, view: BoardView) -> str:
    """What a view wants otherwise than all the `others`, in words: its zoom, its crop, or neither."""
    corners = stacked([view])
    start = posed(model, corners, others.intrinsics)

    def left(*free: int) -> tuple[float, Floats]:
        only = replace(model, free=model.free & np.isin(np.arange(len(model.free)), free), board_sigma_m=None)
        fit = adjust(only, start, corners, max_iterations=30)
        return float(np.sum(fit.residual_px**2)), fit.intrinsics

    nothing, _ = left()
    (focal, zoomed), (centre, moved), (both, _) = left(0, 1), left(2, 3), left(0, 1, 2, 3)
    explained = max(nothing - both, 1e-12)
    change = 100 * (float(zoomed[0] / others.intrinsics[0]) - 1)
    if nothing - focal >= MOST_OF_IT * explained and focal <= centre and abs(change) >= LEAST_ZOOM_PERCENT:
        return f"another zoom or focus? Its focal length would be {change:+.1f} %"
    if nothing - centre >= MOST_OF_IT * explained:
        shift = moved[2:4] - others.intrinsics[2:4]
        by = f"{shift[0]:+.1f}, {shift[1]:+.1f} px"
        return f"another part of the sensor (crop, stabiliser)? Its principal point would be off by {by}"
    return "not by its zoom; did the board or the camera move?"


def two_cameras(model: Model, views: Sequence[BoardView], fit: Fit, seed: int = 0) -> tuple[Bools, float, float] | None:
    """Whether the views fall into two groups that each fit well, with different focal lengths, and badly together.

    Returns (which views are of the first group, both focal lengths), or None.
    """
    corners = stacked(views)
    if corners.views < 6:
        return None
    random = np.random.default_rng(seed)
    small = Model(lens=model.lens, free=_few(model.free), board_m=model.board_m)
    errors = []
    for _ in range(TRIALS):
        picked = np.sort(random.choice(corners.views, 4 if corners.views > 9 else 3, replace=False))
        alone = _fit_of(small, [views[i] for i in picked], fit)
        errors.append(view_rms_px(posed(small, corners, alone.intrinsics), corners))
    half = corners.views // 2
    best = min(errors, key=lambda e: float(np.sort(e)[:half].mean()))
    first = best <= np.sort(best)[half - 1]
    for _ in range(REGROUPED):
        if not LEAST_GROUP <= first.sum() <= corners.views - LEAST_GROUP:
            return None
        fits = [_fit_of(model, [v for v, m in zip(views, mask, strict=True) if m], fit) for mask in (first, ~first)]
        one, other = (view_rms_px(posed(model, corners, f.intrinsics), corners) for f in fits)
        if np.array_equal(one <= other, first):
            break
        first = one <= other
    together = adjust(model, fit, corners, max_iterations=30).rms_px
    apart = [float(f.intrinsics[0]) for f in fits]
    if max(f.rms_px for f in fits) > APART * together or abs(np.log(apart[0] / apart[1])) < LEAST_FOCAL_CHANGE:
        return None
    return np.asarray(first), apart[0], apart[1]


def _few(free: Bools) -> Bools:
    """Focal length and principal point: what a few views can tell when the distortion is roughly known."""
    few = np.zeros_like(free)
    few[:4] = True
    return few & free


def _fit_of(model: Model, views: Sequence[BoardView], fit: Fit) -> Fit:
    corners: Corners = stacked(views)
    start = posed(model, corners, fit.intrinsics)
    loose = float(np.clip(2 * np.median(view_rms_px(start, corners)), 0.5, 50))
    return adjust(model, adjust(model, start, corners, huber_px=loose, max_iterations=15), corners, max_iterations=20)
