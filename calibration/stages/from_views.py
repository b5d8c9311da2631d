"""Views of a board become a camera: robust fit, outlier views out, lens model chosen, uncertainty, verdict.

The mathematics is in `adjustment`, what is thought of it in `judgement`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.adjustment.bundle import Corners, Fit, Model, adjust, stacked
from calibration.adjustment.covariance import believed, corner_noise_px, projection_sigma_px
from calibration.adjustment.initialisation import normalised, view_rms_px
from calibration.adjustment.model_selection import (
    CHOICES,
    LEAST_NOISE_PX,
    Candidate,
    automatic,
    fitted,
    judged,
    model_named,
)
from calibration.boards.board import Board
from calibration.boards.view import BoardView
from calibration.camera import CameraModel
from calibration.foundation.arrays import Bools, Floats
from calibration.foundation.errors import CalibrationError, InputFileError, UsageError
from calibration.judgement.coverage import LATTICE_COLUMNS, LATTICE_ROWS, Coverage, coverage, grid_of, lattice, reached
from calibration.judgement.duplicates import without_copies
from calibration.judgement.outliers import agreeing, contradicting, kept, two_cameras, what_differs
from calibration.judgement.result import CalibratedView, Calibration, DirectionSigma, RejectedView
from calibration.judgement.two_cameras import like_cameras
from calibration.judgement.verdict import Diagnosis, advice, judge, refuse_undetermined
from calibration.photos.metadata import RESIZED_KEY

LEAST_VIEWS = 3
ROUNDS = 3

ODD_VIEW = "contradicts the other views as another focal length or principal point would; did the board or camera move?"
"""Of a view that alone explains what would otherwise be a second camera."""

BOARD_SIGMA = (0.001, 0.001, 0.005)
"""Prior of the board's shape over its longer side: printers and paper in the plane, boards that bend out of it."""


def calibrate(
    views: Sequence[BoardView],
    board: Board,
    *,
    terms: str = "auto",
    rejected: Sequence[RejectedView] = (),
) -> Calibration:
    """The camera that took `views` of `board`.

    terms     "auto", or one of `model_selection.CHOICES`: "focal", "1", "2", "4", "5", "8" distortion terms, "fisheye"
    rejected  photos already set aside, to be carried into the result
    Raises InputFileError for mixed image sizes, CalibrationError where the views cannot determine the camera (fewer
    than 3, all fronto-parallel, all in one corner, two cameras mixed), UsageError for unknown `terms`.
    """
    views, copies = without_copies(views)
    rejected = [*rejected, *(_copy(view, first) for view, first in copies)]
    _check(views, terms)
    board_m = board.points_m - board.points_m.mean(axis=0)
    noise = corner_noise_px([grid_of(v, board.cols, board.rows) for v in views])
    views, outliers, start = _without_outliers(views, board_m, terms, noise)
    corners = stacked(views)
    best = _best(corners, views, board_m, terms, noise, start)
    while (odd := _odd_view(best, views)) is not None:
        outliers.append(RejectedView(name=views[odd].name, reason=ODD_VIEW))
        others = np.arange(len(views)) != odd
        start = (start[0], kept(start[1], corners, others))
        views = [view for view, other in zip(views, others, strict=True) if other]
        corners = stacked(views)
        best = _best(corners, views, board_m, terms, noise, start)
    best, diagnosis = _diagnosed(best, corners, noise, board)
    best, corners = _settled(best, corners)
    reach = coverage(views, best.fit.rotation, best.fit.translation_m)
    refuse_undetermined(best, reach, views)
    return _calibration(best, views, board, corners, noise, diagnosis, reach, (*rejected, *outliers))


def _copy(view: BoardView, first: BoardView) -> RejectedView:
    return RejectedView(name=view.name, reason=f"the same picture as {first.name}, which counts once", harmless=True)


def _check(views: Sequence[BoardView], terms: str) -> None:
    if terms not in CHOICES:
        raise UsageError(
            where="distortion terms", seen=repr(terms), expected=f"one of {', '.join(CHOICES)}", advice="leave it out"
        )
    if len(views) < LEAST_VIEWS:
        raise CalibrationError(
            where="photos with the board in them",
            seen=f"{len(views)}" + (f" ({', '.join(v.name for v in views)})" if views else ""),
            expected=f"at least {LEAST_VIEWS}, better 15 or more",
            advice="take more photos of the board, tilted 20 to 45 degrees, all over the image",
        )
    refuse_mixed_sizes([(v.name, v.image_size) for v in views])


def refuse_mixed_sizes(photos: Sequence[tuple[str, tuple[int, int]]]) -> None:
    """Raises InputFileError where not all photos (name, (width, height)) are of one size."""
    sizes = Counter(size for _, size in photos)
    if len(sizes) < 2:
        return
    usual = sizes.most_common(1)[0][0]
    odd = [f"{name} ({w}x{h})" for name, (w, h) in photos if (w, h) != usual]
    raise InputFileError(
        where="photos",
        seen=f"{len(sizes)} image sizes: {sizes[usual]} photos are {usual[0]}x{usual[1]}, but {_some(odd)}",
        expected="photos of one camera at one resolution",
        advice="leave out the others, or calibrate them on their own",
    )


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _without_outliers(
    views: Sequence[BoardView], board_m: Floats, terms: str, noise_px: float
) -> tuple[list[BoardView], list[RejectedView], tuple[Model, Fit]]:
    """The views that agree, the others with the reason, a first fit; raises where two cameras are mixed."""
    model, (fit, agree, rms) = _agreeing(views, board_m, terms, noise_px)
    if agree.mean() < 0.8 or float(np.median(rms)) > _expected_rms(noise_px):
        _refuse_two_cameras(model, views, fit)
    if agree.sum() < max(LEAST_VIEWS, 0.5 * len(views)):
        agree = np.ones(len(views), bool)
    typical = float(np.median(rms[agree]))
    bad = [
        RejectedView(name=v.name, reason=f"off by {e:.2f} px where the other views are off by {typical:.2f} px")
        for v, e, good in zip(views, rms, agree, strict=True)
        if not good
    ]
    used = [v for v, good in zip(views, agree, strict=True) if good]
    used, against, fit = contradicting(model, kept(fit, stacked(views), agree), used, LEAST_NOISE_PX)
    bad += [
        RejectedView(
            name=v.name, reason=f"contradicts the other views ({pull:.0f} sigma): {what_differs(model, fit, v)}"
        )
        for v, pull in against
    ]
    return used, bad, (model, fit)


def _agreeing(
    views: Sequence[BoardView], board_m: Floats, terms: str, noise_px: float
) -> tuple[Model, tuple[Fit, Bools, Floats]]:
    """The model under which most views agree best, its robust fit, who agrees, and every view's RMS."""
    choice = terms if terms != "auto" else "1" if len(views) < 5 else "5"
    _, model = model_named(choice, board_m)
    found = agreeing(model, views)
    if terms == "auto" and float(np.median(found[2])) > _expected_rms(noise_px):
        _, fisheye = model_named("fisheye", board_m)
        other = agreeing(fisheye, views)
        if float(np.median(other[2])) < 0.7 * float(np.median(found[2])):
            return fisheye, other
    return model, found


def _expected_rms(noise_px: float) -> float:
    """More than corners of this scatter should leave."""
    return max(2.5 * noise_px, 0.05) if noise_px == noise_px else 0.3


def _refuse_two_cameras(model: Model, views: Sequence[BoardView], fit: Fit) -> None:
    found = two_cameras(model, views, fit)
    if found is None:
        return
    first, one, other = found
    names = (
        [v.name for v, m in zip(views, first, strict=True) if m],
        [v.name for v, m in zip(views, first, strict=True) if not m],
    )
    raise CalibrationError(
        where="photos",
        seen=f"two cameras, or two zoom settings: {_some(names[0])} fit a focal length of {one:.0f} px, "
        f"{_some(names[1])} one of {other:.0f} px",
        expected="photos of one camera with one zoom and focus",
        advice="calibrate each group on its own",
    )


def _odd_view(best: Candidate, views: Sequence[BoardView]) -> int | None:
    """The view that passes for a second camera, if one does.

    Raises CalibrationError where two cameras took the views, however alike, before a bent board is thought of.
    """
    found = like_cameras(best.model, best.fit, views)
    if found is None:
        return None
    if found.bad_view is not None:
        return found.bad_view
    names = [[v.name for v, m in zip(views, mask, strict=True) if m] for mask in (found.first, ~found.first)]
    told = [
        f"{_some(group)} fit a focal length of {fx:.1f} px and a principal point of {cx:.1f}, {cy:.1f}"
        for group, (fx, _, cx, cy) in zip(names, found.intrinsics, strict=True)
    ]
    what = "photos turned by 180 degrees among others" if found.turned else "two cameras, or two zoom or focus settings"
    raise CalibrationError(
        where="photos",
        seen=f"{what}: {told[0]}; {told[1]}",
        expected="photos of one camera with one zoom and focus, as the sensor stored them",
        advice="take the photos as they come from the camera" if found.turned else "calibrate each group on its own",
    )


def _best(
    corners: Corners,
    views: Sequence[BoardView],
    board_m: Floats,
    terms: str,
    noise: float,
    start: tuple[Model, Fit],
) -> Candidate:
    """The asked-for lens model, or the one that predicts unseen views best."""
    size = views[0].image_size
    model, fit = start
    first = fit if model.lens == "pinhole" else None
    if terms != "auto":
        return fitted(terms, corners, size, board_m, fit)
    if len(views) < 5:
        return fitted("1", corners, size, board_m, first)
    return automatic(corners, size, board_m, fitted("5", corners, size, board_m, first), noise)


def _diagnosed(best: Candidate, corners: Corners, noise: float, board: Board) -> tuple[Candidate, Diagnosis]:
    """What the lens model does not explain: a bent board (then taken in), or motion while the image was read."""
    left = best.uncertainty.sigma0_px
    if corners.views < 6 or not left > max(1.3 * noise, 0.05):
        return best, Diagnosis(sigma0_px=left)
    side = max(board.cols, board.rows) * board.square_m
    turning = replace(best.model, turning=True)
    turned = adjust(turning, best.fit, corners, max_iterations=15)
    bending = replace(best.model, board_sigma_m=(BOARD_SIGMA[0] * side, BOARD_SIGMA[1] * side, BOARD_SIGMA[2] * side))
    bent = adjust(bending, best.fit, corners, noise_px=max(noise, 0.02) if noise == noise else 0.05, max_iterations=25)
    turn_px, bend_px = (_sigma0(m, f, corners) for m, f in ((turning, turned), (bending, bent)))
    size = float(np.abs(bent.bend_m / side).max())
    angle = float(np.degrees(np.median(np.linalg.norm(turned.turn_rad, axis=1))))
    diagnosis = Diagnosis(sigma0_px=left, turning_px=turn_px, turn_deg=angle, bending_px=bend_px, bend_share=size)
    if bend_px < 0.8 * left and bend_px < 1.1 * turn_px and corners.views >= 8 and size < 4 * max(BOARD_SIGMA):
        shaped = judged(f"{best.name}, board's shape estimated", bending, bent, corners)
        if shaped.held_out_px < 0.9 * best.held_out_px:
            return shaped, replace(diagnosis, bent=True)
    return best, diagnosis


def _settled(best: Candidate, corners: Corners) -> tuple[Candidate, Corners]:
    """The same lens, with less weight on views and corners that are less exact."""
    weighed, fit = corners, best.fit
    for _ in range(ROUNDS):
        weighed = believed(fit, weighed)
        if weighed.weight.min() == 1:
            return best, corners
        fit = adjust(best.model, fit, weighed, noise_px=best.uncertainty.sigma0_px, max_iterations=10)
    return judged(best.name, best.model, fit, weighed), weighed


def _sigma0(model: Model, fit: Fit, corners: Corners) -> float:
    shape = 0 if model.board_sigma_m is None else model.board_m.size - 6
    unknowns = int(model.free.sum()) + model.own * corners.views + shape
    return float(np.sqrt(np.sum(fit.residual_px**2) / max(1, corners.xy.size - unknowns)))


def _calibration(
    best: Candidate,
    views: Sequence[BoardView],
    board: Board,
    corners: Corners,
    noise: float,
    diagnosis: Diagnosis,
    reach: Coverage,
    rejected: Sequence[RejectedView],
) -> Calibration:
    per_view = view_rms_px(best.fit, corners)
    used = tuple(
        CalibratedView(
            name=view.name,
            corners=view.corners,
            index=view.index,
            residual_px=best.fit.residual_px[corners.rows(i)],
            rms_px=float(per_view[i]),
            held_out_px=float(best.held_out_view_px[i]),
            tilt_deg=float(reach.tilt_deg[i]),
            distance_m=float(reach.distance_m[i]),
            blur_px=view.blur_px,
        )
        for i, view in enumerate(views)
    )
    sigma_px = _sigma_map_px(best, views)
    known = _direction_sigma(sigma_px, views)
    verdict, warnings = judge(
        best, used, rejected, reach, noise, diagnosis, known, views[0].image_size, _resized(views)
    )
    camera = _camera(best, views, board, rejected, verdict)
    return Calibration(
        camera=camera,
        board=board,
        lens=best.name,
        views=used,
        rejected=tuple(rejected),
        sigma=np.sqrt(np.diag(best.uncertainty.covariance)),
        held_out_px=best.held_out_px,
        corner_noise_px=noise,
        inflation=best.uncertainty.inflation,
        direction_sigma=known,
        sigma_map_px=sigma_px.reshape(LATTICE_ROWS, LATTICE_COLUMNS),
        coverage=reach,
        bend_m=best.fit.bend_m if diagnosis.bent else None,
        verdict=verdict,
        warnings=warnings,
        advice=advice(reach, len(used), known, sigma_px, views[0].image_size),
    )


def _sigma_map_px(best: Candidate, views: Sequence[BoardView]) -> Floats:
    """One sigma of a direction at each pixel of the lattice; inf where the lens model has no direction."""
    pixels = lattice(views[0].image_size)
    flat = normalised(best.model.lens, best.fit.intrinsics, pixels)
    rays = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    inside = reached(views, pixels)
    usable = np.isfinite(flat).all(axis=1) & (np.abs(flat).max(axis=1) < 50)
    sigma = np.full(len(pixels), np.inf)
    sigma[usable] = projection_sigma_px(
        best.model, best.fit.intrinsics, best.uncertainty.covariance, rays[usable], inside[usable]
    )
    return sigma


def _direction_sigma(sigma: Floats, views: Sequence[BoardView]) -> DirectionSigma:
    """Sigmas on the lattice, inside and outside of the hull of all corners."""
    inside = reached(views, lattice(views[0].image_size))
    return DirectionSigma(
        typical_px=float(np.median(sigma[inside])),
        worst_px=float(np.quantile(sigma[inside], 0.95)),
        beyond_px=float(sigma[~inside].max()) if (~inside).any() else float("nan"),
    )


def _camera(
    best: Candidate, views: Sequence[BoardView], board: Board, rejected: Sequence[RejectedView], verdict: str
) -> CameraModel:
    fx, fy, cx, cy = best.fit.intrinsics[:4]
    return CameraModel(
        model=best.model.lens,
        image_size=views[0].image_size,
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        distortion=best.fit.intrinsics[4:],
        rms_px=best.fit.rms_px,
        covariance=best.uncertainty.covariance,
        made={
            "by": "runningfix calibrate",
            "board": board.name,
            "square_m": board.square_m,
            "lens": best.name,
            "views": len(views),
            "rejected": [r.name for r in rejected],
            "held_out_px": round(best.held_out_px, 6),
            "covariance_inflation": round(best.uncertainty.inflation, 4),
            "verdict": verdict,
            "pixels": "as stored: EXIF orientation is not applied",
            **_taken(views),
        },
    )


def _resized(views: Sequence[BoardView]) -> list[str]:
    """Photos of another size than the camera wrote, as they say themselves."""
    sizes = Counter(view.taken[RESIZED_KEY] for view in views if RESIZED_KEY in view.taken)
    if not sizes:
        return []
    (width, height), said = views[0].image_size, ", ".join(sizes)
    return [
        f"{sum(sizes.values())} of {len(views)} photos are {width}x{height}, but the camera wrote {said}: they were "
        "resized or cropped, and the camera file holds for such pictures only"
    ]


def _taken(views: Sequence[BoardView]) -> dict[str, str | float]:
    """What all views say alike of the camera and of how their pictures come: held against the videos it is used for."""
    said: dict[str, str | float] = {}
    for key in ("maker", "camera", "serial", "focal_mm", RESIZED_KEY, "turned_deg", "sample_aspect"):
        values = {view.taken.get(key) for view in views}
        value = next(iter(values)) if len(values) == 1 else None
        if value is not None:
            said[key] = float(value) if key == "sample_aspect" else int(value) if key == "turned_deg" else value
    return said
