"""Figures become words: what is wrong with a calibration, and what to photograph next.

The principle of the verdict: a calibration is for directions, and they are judged where they were measured.

* "poor" - do not use it: the views contradict the model (a moving camera, a rolling shutter), there are too few to
  tell, or one sigma of a direction exceeds what one sighting in a video is worth (1 px, 0.1 % of the image's width),
  typically, within the part of the image that boards reached.
* "usable" - know what you do: a region that no board reached, where the sigma is told but is not held against the
  part that was measured; few or bad views; a bent board; a sigma above half of that, or above all of it somewhere.
* "good" - nothing to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.adjustment.model_selection import Candidate
from calibration.boards.view import BoardView
from calibration.foundation.arrays import Floats
from calibration.foundation.errors import CalibrationError
from calibration.judgement.coverage import FEW_BOARDS, Coverage, corner_named, lattice, missing_regions, thin_regions
from calibration.judgement.result import CalibratedView, DirectionSigma, RejectedView, Verdict

LEAST_TILT_DEG = 5.0
ENOUGH_TILT_DEG = 15.0
LEAST_AREA = 0.12
ENOUGH_AREA = 0.4
ADVISED_AREA = 0.7
"""Share of the image within the hull of all corners below which more is advised; the verdict is content with 0.4."""
ENOUGH_VIEWS = 8
WORST_FOCAL_SIGMA = 0.02


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What explains residuals that the lens model leaves (sigma0 per coordinate under each explanation).

    turn_deg    by how much the camera would have turned while an image was read out (median)
    bend_share  how far the board would be from flat, over its longer side
    bent        the board's shape was taken into the model
    """

    sigma0_px: float
    turning_px: float = float("nan")
    turn_deg: float = float("nan")
    bending_px: float = float("nan")
    bend_share: float = float("nan")
    bent: bool = False


def refuse_undetermined(best: Candidate, reach: Coverage, views: Sequence[BoardView]) -> None:
    """Raises CalibrationError where the views cannot tell the focal length, saying why not."""
    focal = best.fit.intrinsics[0]
    relative = float(np.sqrt(best.uncertainty.covariance[0, 0])) / focal
    tilt = float(reach.tilt_deg.max())
    if tilt < LEAST_TILT_DEG or (relative > WORST_FOCAL_SIGMA and tilt < ENOUGH_TILT_DEG):
        raise CalibrationError(
            where=f"{len(views)} views",
            seen=f"all boards face the camera (largest tilt {tilt:.0f} degrees)",
            expected="some boards tilted by 20 to 45 degrees: else focal length and distance cannot be told apart",
            advice="add photos with the board tilted to the left, right, up and down",
        )
    if reach.area < LEAST_AREA:
        raise CalibrationError(
            where=f"{len(views)} views",
            seen=f"the board covers only {reach.area:.0%} of the image ({_where(views)})",
            expected="corners all over the image: nothing is known of the lens elsewhere",
            advice="add photos with the board in every corner of the image, or closer to the camera",
        )
    if relative > WORST_FOCAL_SIGMA or not best.uncertainty.determined:
        raise CalibrationError(
            where=f"{len(views)} views",
            seen=f"a focal length known only to {100 * relative:.1f} %" if relative > 0 else "an undetermined camera",
            expected=f"views that determine it to {100 * WORST_FOCAL_SIGMA:.0f} % or better",
            advice="add photos, tilted 20 to 45 degrees, near and far, all over the image",
        )


def _where(views: Sequence[BoardView]) -> str:
    every = np.concatenate([v.corners for v in views])
    x, y = every.mean(axis=0) / np.array(views[0].image_size)
    row = "upper" if y < 0.4 else "lower" if y > 0.6 else "middle"
    column = "left" if x < 0.4 else "right" if x > 0.6 else "middle"
    return "its middle" if row == column == "middle" else f"{row} {column}"


def judge(
    best: Candidate,
    views: Sequence[CalibratedView],
    rejected: Sequence[RejectedView],
    reach: Coverage,
    noise_px: float,
    diagnosis: Diagnosis,
    known: DirectionSigma,
    image_size: tuple[int, int],
    also: Sequence[str] = (),
) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict and its reasons. A reason of the first list makes it "poor", of the second (and `also`) "usable"."""
    blind, hazy = _unsure(known, image_size)
    poor = [*_misfit(best, noise_px, diagnosis), *blind]
    usable = [
        *_few_views(len(views)),
        *_bad_views(views, rejected),
        *_motion_blur(views),
        *_reach(reach, known),
        *_bent(diagnosis),
        *_stretched(best),
        *also,
        *hazy,
    ]
    if len(views) < 5:
        poor, usable = [*poor, *usable[:1]], usable[1:]
    verdict: Verdict = "poor" if poor else "usable" if usable else "good"
    return verdict, (*poor, *usable)


def _misfit(best: Candidate, noise_px: float, diagnosis: Diagnosis) -> list[str]:
    rms, words = best.fit.rms_px, []
    left = diagnosis.sigma0_px
    if rms > 0.7 or (noise_px == noise_px and left > 5 * noise_px and left > 0.15):
        words.append(
            f"the lens model leaves {rms:.2f} px RMS, though neighbouring corners agree to {noise_px:.2f} px: "
            "something other than the lens moved them"
        )
    if diagnosis.turning_px < 0.6 * left and left > 0.1 and not diagnosis.bent:
        words.append(
            f"rolling shutter: residuals drop from {left:.2f} to {diagnosis.turning_px:.2f} px (per coordinate) "
            f"if camera or board turned by about {diagnosis.turn_deg:.1f} degrees while each image was read out; "
            "hold both still"
        )
    return words


def worth_px(image_size: tuple[int, int]) -> float:
    """What one sighting in a video is worth: 1 px, in large images 0.1 % of their width."""
    return max(1.0, image_size[0] / 1000)


def _unsure(known: DirectionSigma, image_size: tuple[int, int]) -> tuple[list[str], list[str]]:
    """(reasons for "poor", reasons for "usable")."""
    limit = worth_px(image_size)
    words = [
        f"directions are uncertain by {known.typical_px:.1f} px typically and {known.worst_px:.1f} px at worst (one "
        "sigma over the part of the image that boards reached)"
    ]
    if known.typical_px > limit:
        return words, []
    return [], words if max(known.worst_px, 2 * known.typical_px) > limit else []


def _few_views(count: int) -> list[str]:
    return [f"only {count} views; 15 or more tell outliers and the lens apart"] if count < ENOUGH_VIEWS else []


def _bad_views(views: Sequence[CalibratedView], rejected: Sequence[RejectedView]) -> list[str]:
    rms = np.array([v.rms_px for v in views])
    typical = float(np.median(rms))
    far = [f"{v.name} ({v.rms_px:.2f} px)" for v in views if v.rms_px > 2 * typical and v.rms_px > typical + 0.1]
    words, rejected = [], [r for r in rejected if not r.harmless]
    if far:
        words.append(f"views that fit much worse than the others ({typical:.2f} px): {', '.join(far)}")
    if rejected:
        names = "; ".join(f"{r.name}: {r.reason}" for r in rejected[:8])
        more = f"; and {len(rejected) - 8} more" if len(rejected) > 8 else ""
        words.append(f"{len(rejected)} of {len(rejected) + len(views)} photos not used: {names}{more}")
    return words


def _motion_blur(views: Sequence[CalibratedView]) -> list[str]:
    moved = [v for v in views if v.blur_px[1] > 1.4 * v.blur_px[0] and v.blur_px[1] > 1.5]
    soft = [v for v in views if v.blur_px[0] > 2.5]
    words = []
    if moved:
        names = ", ".join(v.name for v in moved[:8]) + (f" and {len(moved) - 8} more" if len(moved) > 8 else "")
        words.append(f"{len(moved)} of {len(views)} views are blurred in one direction, so something moved: {names}")
    if soft:
        words.append(f"{len(soft)} of {len(views)} views are out of focus: {', '.join(v.name for v in soft[:8])}")
    return words


def _reach(reach: Coverage, known: DirectionSigma) -> list[str]:
    words = []
    regions = missing_regions(reach.seen)
    if reach.area < ENOUGH_AREA:
        words.append(f"the boards cover {reach.area:.0%} of the image")
    if regions:
        where = f"no board reached the image's {', '.join(regions)}"
        words.append(f"{where}: the lens is extrapolated there, {_extrapolated(known)}")
    if reach.tilt_deg.max() < ENOUGH_TILT_DEG:
        words.append(
            f"boards are hardly tilted (at most {reach.tilt_deg.max():.0f} degrees): focal length and distance "
            "are hard to tell apart"
        )
    return words


def _extrapolated(known: DirectionSigma) -> str:
    if known.beyond_px > 100:
        return "and nothing is known of directions there"
    return f"where directions are uncertain by up to {known.beyond_px:.1f} px"


STRETCHED = 0.01
"""fx / fy from 1 (in ln) that lenses and pixels do not explain: they differ by 0.002."""


def _stretched(best: Candidate) -> list[str]:
    """Photos that were resized to another shape, as their pixels are no squares any more."""
    fx, fy = best.fit.intrinsics[:2]
    c = best.uncertainty.covariance
    sigma = np.sqrt(max(c[0, 0] / fx**2 + c[1, 1] / fy**2 - 2 * c[0, 1] / (fx * fy), 0.0))
    off = float(np.log(fx / fy))
    if abs(off) < max(STRETCHED, 5 * sigma):
        return []
    return [
        f"fx / fy is {fx / fy:.3f}: pixels are not square, so the photos were resized to another shape, or recorded "
        "with pixels that are not; the camera holds for such pictures only"
    ]


def _bent(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.bent:
        return []
    return [
        f"the board is not flat or not square, by up to {100 * diagnosis.bend_share:.1f} % of its longer side; its "
        f"shape was estimated with the camera (residuals {diagnosis.sigma0_px:.2f} -> {diagnosis.bending_px:.2f} px)"
    ]


def advice(
    reach: Coverage, count: int, known: DirectionSigma, sigma_px: Floats, image_size: tuple[int, int]
) -> tuple[str, ...]:
    """What to photograph next, most useful first."""
    words = []
    if reach.tilt_deg.max() < 25:
        words.append("boards tilted by 25 to 45 degrees, about both axes")
    words += [f"a board that reaches the {region} of the image" for region in missing_regions(reach.seen)]
    if known.beyond_px > worth_px(image_size) and not missing_regions(reach.seen):
        worst = corner_named(lattice(image_size)[int(np.argmax(sigma_px))], image_size)
        words.append(f"boards nearer to the image's corners, first of all the {worst} one, {_extrapolated(known)}")
    elif reach.area < ADVISED_AREA and not missing_regions(reach.seen):
        words.append(f"boards nearer to the image's edges: so far they reach {reach.area:.0%} of it")
    if count >= FEW_BOARDS:
        words += [
            f"{FEW_BOARDS - boards} more {'board' if boards == FEW_BOARDS - 1 else 'boards'} in the {region} of the "
            f"image, where only {boards} {'was' if boards == 1 else 'were'}"
            for region, boards in thin_regions(reach.boards)
        ]
    if reach.roll_spread_deg < 8 and count >= 3:
        words.append("the board or the camera turned by 90 degrees about the line of sight")
    if reach.distance_m.max() < 1.3 * reach.distance_m.min():
        words.append("boards at other distances, half and twice as far")
    if count < 15:
        words.append(f"{15 - count} more view{'s' if count < 14 else ''}")
    return tuple(words)
