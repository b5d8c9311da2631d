"""A track bound by several boxes: what was followed forwards from one and backwards from the next becomes one.

Between two boxes, at the share s of the way from the first (in frames), the two ways say x_f and x_b. Where they lie
apart by less than a part of the target,

    x = (1 - s) x_f + s x_b,   sigma^2 = (1 - s) sigma_f^2 + s sigma_b^2 + s (1 - s) |x_f - x_b|^2 / 2,

so a fix is its box's at each box, and what the two differ by, which is how far either strayed from its box, is doubted
in the middle. Where one knows the surface and the other the middle of the box, the surface is taken. Where they lie
further apart one of them is on something else, and nobody knows which: no fix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.records import Box
from pipeline.tracking.settings import LABELS


@dataclass(frozen=True, kw_only=True, eq=False)
class Fixes:
    """Every fix of one target, in order of time.

    frame (k,), xy_px (k, 2), sigma_px (k,), linear (k, 2, 2) as in `Fix`; box (k,) whether it is the middle of a box
    label  (k,) which of the target's boxes it was followed from
    """

    frame: Ints
    xy_px: Floats
    sigma_px: Floats
    linear: Floats
    box: Bools
    label: Ints

    def __getitem__(self, rows: Ints | Bools) -> Fixes:
        """Those of some rows."""
        return Fixes(**{name: values[rows] for name, values in vars(self).items()})

    def and_(self, other: Fixes) -> Fixes:
        """These and others, on other frames, in order of time."""
        both = {name: np.concatenate([values, getattr(other, name)]) for name, values in vars(self).items()}
        return Fixes(**both)[np.argsort(both["frame"], kind="stable")]


def bound(forwards: Fixes, backwards: Fixes, boxes: tuple[Box, ...]) -> Fixes:
    """One set of fixes of both ways."""
    backwards = backwards[~np.isin(backwards.frame, [box.frame for box in boxes]) | ~_in(backwards, forwards)]
    shared = np.intersect1d(forwards.frame, backwards.frame)
    alone = forwards[~np.isin(forwards.frame, shared)].and_(backwards[~np.isin(backwards.frame, shared)])
    if not len(shared):
        return alone
    f, b = forwards[np.isin(forwards.frame, shared)], backwards[np.isin(backwards.frame, shared)]
    return alone.and_(_mean(f, b, boxes))


def _in(one: Fixes, other: Fixes) -> Bools:
    return np.isin(one.frame, other.frame)


def _mean(f: Fixes, b: Fixes, boxes: tuple[Box, ...]) -> Fixes:
    """What two ways say together of the same frames; without those on which they contradict each other."""
    frames = np.array([box.frame for box in boxes])
    share = (f.frame - frames[f.label]) / (frames[b.label] - frames[f.label])
    share = np.where(f.box == b.box, share, np.where(f.box, 1.0, 0.0))
    apart = b.xy_px - f.xy_px
    spread = share * (1 - share) * (apart**2).sum(axis=1) / 2
    sigma = np.sqrt((1 - share) * f.sigma_px**2 + share * b.sigma_px**2 + spread)
    nearer = share > 0.5
    mean = Fixes(
        frame=f.frame,
        xy_px=f.xy_px + share[:, None] * apart,
        sigma_px=sigma,
        linear=np.where(nearer[:, None, None], b.linear, f.linear),
        box=f.box & b.box,
        label=np.where(nearer, b.label, f.label),
    )
    size = np.array([np.sqrt(box.width * box.height) for box in boxes])[f.label]
    size = size * np.sqrt(np.abs(np.linalg.det(f.linear)))
    return mean[np.hypot(*apart.T) < LABELS.apart_sizes * size]
