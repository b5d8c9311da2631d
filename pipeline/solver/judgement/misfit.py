"""Are residuals as large as their sigmas promise: of all, of each camera, target, and track of a target in a camera?

Each group's sum of squares (outliers as the robust loss counts them) is compared with its redundancy, which is what it
is on average: z = (sum - redundancy) / root(2 redundancy), a normal deviate where redundancy is large. All together,
frames' own pose errors and the cameras' constants count with what they are on average, too:

    E[u'u] = 6 - tr V of a frame        E[d^2 / P0] = 1 - P / P0 of a constant
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.solver.adjustment.known_rows import known_square
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.uncertainty.covariance import Covariance
from pipeline.solver.uncertainty.known_redundancy import known_redundancy
from pipeline.solver.uncertainty.redundancy import redundancy_table

Scope = Literal["all", "camera", "target", "track"]


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """One group of sightings against its own redundancy.

    since_frame  of a track: from where on its misfit began, where it is much worse after it than before
    """

    scope: Scope
    camera: str
    target: str
    square: float
    redundancy: float
    since_frame: int | None = None

    @property
    def z(self) -> float:
        """Normal deviate of the sum of squares."""
        return (self.square - self.redundancy) / float(np.sqrt(2 * max(self.redundancy, 1.0)))

    @property
    def factor(self) -> float:
        """Variance factor."""
        return self.square / max(self.redundancy, 1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class Misfits:
    """Of everything, of each camera, of each target, of each track, each the worst first."""

    whole: Misfit
    cameras: tuple[Misfit, ...]
    targets: tuple[Misfit, ...]
    tracks: tuple[Misfit, ...]


def misfits(model: Model, state: State, covariance: Covariance, square: Floats) -> Misfits:
    """`square` (F, N) are squared residuals in sigmas, zero where nothing is seen."""
    frames = model.frames
    counted = np.asarray(model.loss.cost(square)) * frames.seen
    table = redundancy_table(model, state, covariance, square)
    names = frames.cameras, frames.targets
    off = np.stack([counted[frames.of(c)].sum(axis=0) for c in range(len(names[0]))])
    left = np.maximum(table.left, 0)
    tracks = [
        Misfit(
            scope="track", camera=names[0][c], target=names[1][n], square=float(off[c, n]),
            redundancy=float(left[c, n]), since_frame=_since(model, counted, c, n, float(left[c, n])),
        )
        for c, n in zip(*np.nonzero(table.seen > 0), strict=True)
    ]  # fmt: skip
    return Misfits(
        whole=_whole(model, state, covariance, off, left, table.own),
        cameras=_ranked([
            Misfit(scope="camera", camera=name, target="", square=float(off[c].sum()), redundancy=float(left[c].sum()))
            for c, name in enumerate(names[0])
        ]),
        targets=_ranked([
            Misfit(
                scope="target", camera="", target=name, square=float(off[:, n].sum()),
                redundancy=float(left[:, n].sum()),
            )
            for n, name in enumerate(names[1])
        ]),
        tracks=_ranked(tracks),
    )  # fmt: skip


def _ranked(found: list[Misfit]) -> tuple[Misfit, ...]:
    return tuple(sorted(found, key=lambda m: -m.z))


def _whole(model: Model, state: State, covariance: Covariance, off: Floats, left: Floats, own: Floats) -> Misfit:
    """Sightings, frames' own errors and cameras' constants together."""
    priors, place = model.priors, model.order.camera
    known = priors.camera_free & (priors.camera_precision > 0)
    pulled = ((state.camera - priors.camera_mean) ** 2 * priors.camera_precision)[known]
    left_over = 1 - covariance.pairs(place[known], place[known]) * priors.camera_precision[known]
    errors = (model.pose.prior[model.frames.camera] * state.own**2).sum()
    beside, expected = known_square(model, state), known_redundancy(model, state, covariance)
    return Misfit(
        scope="all", camera="", target="", square=float(off.sum() + errors + pulled.sum()) + beside,
        redundancy=float(left.sum() + own.sum() + np.maximum(left_over, 0).sum()) + expected,
    )  # fmt: skip


def _since(model: Model, counted: Floats, c: int, n: int, redundancy: float) -> int | None:
    """First frame after which a track's squares are much larger than before; None where they are alike."""
    part = model.frames.of(c)
    rows = np.flatnonzero(model.frames.seen[part, n])
    if len(rows) < 20:
        return None
    square = counted[part][rows, n]
    total = np.cumsum(square)
    k = np.arange(len(rows) // 10, len(rows) - len(rows) // 10)
    before, after = total[k] / (k + 1), (total[-1] - total[k]) / (len(rows) - k - 1)
    # the likelihood of two variances in place of one, in units of the average square
    least = 1e-3 * max(float(square.mean()), 1e-9)
    gain = -(k + 1) * np.log(np.maximum(before, least)) - (len(rows) - k - 1) * np.log(np.maximum(after, least))
    best = int(gain.argmax())
    if after[best] < 4 * max(before[best], redundancy / len(rows)):
        return None
    return int(model.frames.frame[part][rows[k[best] + 1]])
