"""Which lens model: the usual 5 terms, unless another one predicts unseen views clearly better.

Every candidate is fitted, and judged by its held-out error: each view in turn against the intrinsics of all others.
Two candidates are compared view by view, by the logarithm of their errors' ratio; its mean over the views has a
standard error, and the usual terms are left only for a difference of `CLEARLY` of those. A term dropped because it
does not help is not known to be zero: left out at 1.4 sigma of its own it moves its neighbours by 5 of theirs.

Among other models that predict equally well (within one standard error), Schwarz' criterion decides, which weighs
what the residuals gain against the number of terms:

    (n / inflation) ln(sum of squares) + terms ln(n / inflation),    n coordinates
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.adjustment.bundle import Corners, Fit, Model, adjust
from calibration.adjustment.covariance import Uncertainty, held_out_px, uncertainty
from calibration.adjustment.initialisation import first_fit
from calibration.camera import Lens
from calibration.foundation.arrays import Floats

CLEARLY = 2.0
"""Standard errors of the held-out difference by which another model must be better than the usual 5 terms."""

EQUALLY = 1.0
"""Standard errors within which two models predict equally well."""

LEAST_NOISE_PX = 0.003
LONG_LENS, WIDE_LENS = 3.0, 0.5
"""Focal length over the image's longer side from which a lens is long, up to which it is wide."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A lens model with its fit."""

    name: str
    model: Model
    fit: Fit
    uncertainty: Uncertainty
    held_out_view_px: Floats

    @property
    def held_out_px(self) -> float:
        """RMS over the views, each predicted from all the others."""
        return float(np.sqrt(np.mean(self.held_out_view_px**2)))

    @property
    def terms(self) -> int:
        """Number of free intrinsics."""
        return int(self.model.free.sum())


LADDER: tuple[tuple[str, tuple[int, ...], int], ...] = (
    ("focal length only", (0, 1), 4),
    ("k1", (0, 1, 2, 3, 4), 5),
    ("k1 k2", (0, 1, 2, 3, 4, 5), 5),
    ("k1 k2 p1 p2", (0, 1, 2, 3, 4, 5, 6, 7), 5),
    ("k1 k2 p1 p2 k3", tuple(range(9)), 5),
    ("8 terms", tuple(range(12)), 8),
)
CHOICES = ("auto", "focal", "1", "2", "4", "5", "8", "fisheye")
BY_CHOICE = dict(zip(("focal", "1", "2", "4", "5", "8"), LADDER, strict=True))


def model_named(choice: str, board_m: Floats) -> tuple[str, Model]:
    """The model of one of `CHOICES` other than "auto"."""
    if choice == "fisheye":
        return "fisheye", Model(lens="fisheye", free=np.ones(8, bool), board_m=board_m)
    name, free, distortion = BY_CHOICE[choice]
    return name, _model("pinhole", free, 4 + (0 if choice == "focal" else distortion), board_m, choice == "focal")


def _model(lens: Lens, free: Sequence[int], terms: int, board_m: Floats, one_focal: bool = False) -> Model:
    mask = np.zeros(terms, bool)
    mask[list(free)] = True
    return Model(lens=lens, free=mask, board_m=board_m, one_focal=one_focal)


def fitted(
    choice: str, corners: Corners, image_size: tuple[int, int], board_m: Floats, start: Fit | None = None
) -> Candidate:
    """One model fitted and judged; `start` may be the fit of another one of the same kind of lens."""
    name, model = model_named(choice, board_m)
    if start is None or choice == "focal":
        first = first_fit(model, corners, image_size)
    else:
        first = _widened(start, len(model.free))
    return judged(name, model, adjust(model, first, corners), corners)


def judged(name: str, model: Model, fit: Fit, corners: Corners) -> Candidate:
    """A fit with what it is worth."""
    worth = uncertainty(model, fit, corners, LEAST_NOISE_PX)
    held = held_out_px(model, fit, corners, worth.without_view)
    return Candidate(name=name, model=model, fit=fit, uncertainty=worth, held_out_view_px=held)


def better_by(one: Candidate, other: Candidate) -> float:
    """How much better `one` predicts unseen views than `other`, in standard errors of the difference."""
    ratio = np.log(np.maximum(other.held_out_view_px, 1e-9) / np.maximum(one.held_out_view_px, 1e-9))
    spread = float(ratio.std(ddof=1)) / np.sqrt(len(ratio)) if len(ratio) > 1 else float("inf")
    return float(ratio.mean()) / max(spread, 1e-9)


def schwarz(candidate: Candidate, inflation: float) -> float:
    """Schwarz' criterion up to a constant of the data; the smaller, the more likely the model."""
    coordinates = candidate.fit.residual_px.size / max(1.0, inflation)
    square = float(np.sum(candidate.fit.residual_px**2))
    return coordinates * float(np.log(max(square, 1e-300))) + candidate.terms * float(np.log(coordinates))


def chosen(five: Candidate, others: Sequence[Candidate]) -> Candidate:
    """The usual five terms, or the likeliest of those that predict clearly better and equally well."""
    determined = five.uncertainty.determined
    clear = [c for c in others if (better_by(c, five) > CLEARLY and c.held_out_px < five.held_out_px) or not determined]
    if not clear:
        return five
    best = min(clear, key=lambda c: c.held_out_px)
    equal = [c for c in clear if better_by(best, c) <= EQUALLY]
    return min(equal, key=lambda c: schwarz(c, best.uncertainty.inflation))


def automatic(
    corners: Corners, image_size: tuple[int, int], board_m: Floats, base: Candidate, noise_px: float
) -> Candidate:
    """The best pinhole model, or a fisheye where no pinhole describes the lens. `base` is the 5-term fit."""
    others = []
    long = base.fit.intrinsics[0] > LONG_LENS * max(image_size)
    for choice in ("focal", "1", "2", "4") if long else ("1", "2", "4"):
        others.append(fitted(choice, corners, image_size, board_m, _truncated(base.fit, choice)))
    if corners.views >= 10:
        eight = fitted("8", corners, image_size, board_m, base.fit)
        others += [eight] if _worth_eight(eight, base) else []
    best = chosen(base, others)
    if corners.views >= 5 and (best.name == "8 terms" or _strange(best, image_size, noise_px)):
        return chosen(base, [*others, fitted("fisheye", corners, image_size, board_m)])
    return best


def _worth_eight(eight: Candidate, five: Candidate) -> bool:
    """Rational terms extrapolate wildly, so they must clearly earn their place."""
    return eight.held_out_px < 0.95 * five.held_out_px and eight.uncertainty.determined


def _strange(candidate: Candidate, image_size: tuple[int, int], noise_px: float) -> bool:
    """A very wide lens, or the pinhole leaves more than corners scatter by themselves."""
    wide = candidate.fit.intrinsics[0] < WIDE_LENS * max(image_size)
    left = candidate.uncertainty.sigma0_px > max(2 * noise_px, 0.02) if noise_px == noise_px else True
    return wide or left or not candidate.uncertainty.determined


def _widened(fit: Fit, terms: int) -> Fit:
    have = len(fit.intrinsics)
    if terms <= have:
        return replace(fit, intrinsics=fit.intrinsics[:terms])
    return replace(fit, intrinsics=np.concatenate([fit.intrinsics, np.zeros(terms - have)]))


def _truncated(fit: Fit, choice: str) -> Fit:
    """The fit with the distortion terms that `choice` holds set to zero."""
    free = BY_CHOICE[choice][1]
    keep = np.isin(np.arange(len(fit.intrinsics)), [*free, 0, 1, 2, 3])
    return replace(fit, intrinsics=np.where(keep, fit.intrinsics, 0.0))
