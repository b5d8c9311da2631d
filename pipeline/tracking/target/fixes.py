"""A fix: a target's place in one frame and how sure it is."""

from __future__ import annotations

import math

from calibration.foundation.arrays import Floats
from pipeline.tracking.target.alignment import Alignment
from pipeline.tracking.target.template import Template
from pipeline.tracking.target.track_state import Fix

SIGMA_FLOOR_PX, VIEW_SHARE = 0.05, 0.01


def fix_of(frame: int, found: Alignment, sigma_px: float) -> Fix:
    """The fix that an alignment is worth."""
    x, y = found.warp.centre_px.tolist()
    return Fix(frame=frame, xy_px=(x, y), linear=found.warp.linear, sigma_px=sigma_px, score=found.score)


def sigma_px_of(found: Alignment, template: Template) -> float:
    """Of a fix, per axis: a floor, the match's own uncertainty, and what a changed view does to a solid thing.

    The second grows where what was found differs more from the template than the target usually does.

    It is the root mean square of a single fix's error. Errors are alike from frame to frame, so that the mean of many
    fixes is not known better by the root of their number; what follows from that is the solver's (`ImageTrack`).

    The last grows with how much larger, smaller or more slanted the target looks than in its first box; it is the same
    from one frame to the next.
    """
    size_px = template.size_px
    misfit = float((template.trust * found.residual).sum()) / float((template.trust * template.spread).sum())
    variance = max(1.0, misfit) * float(found.covariance_px2[0, 0] + found.covariance_px2[1, 1]) / 2
    larger, smaller = _stretches(found.warp.linear)
    changed = abs(math.log(larger * smaller)) / 2 + math.log(larger / smaller)
    view = VIEW_SHARE * changed * math.sqrt(size_px[0] * size_px[1] * larger * smaller)
    return math.sqrt(SIGMA_FLOOR_PX**2 + variance + view**2)


def _stretches(linear: Floats) -> tuple[float, float]:
    """Singular values of (2, 2), written out: larger, smaller."""
    (a, b), (c, d) = linear.tolist()
    turned, mirrored = math.hypot(a + d, b - c), math.hypot(a - d, b + c)
    return (turned + mirrored) / 2, max(abs(turned - mirrored) / 2, 1e-9)
