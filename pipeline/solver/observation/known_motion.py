"""What is known of motions apart from sightings: the places of still points, and that targets stay on the ground.

A known place is three rows, axis i of the target at any time:

    (X_i - P_i) / sigma = 0

A target on the ground is a row for every time at which it is held against it, linear in the slope where it is:

    (X_up - mean of h(X_east + e_j, X_north + n_j) - above - b_common - b_own - b_rough) / sigma = 0

The places (e_j, n_j) lie along the way of the target, before and after: a motion is smooth, and a ground whose bumps
it had to follow would bend it, shrink it, or draw it to where the ground is even. What the mean takes away counts as
roughness.

b_common and b_own are unknowns with priors: what the whole ground is off by, and what it is off by along one target's
stretch. b_rough are unknowns, too, at knots along the way, between which they are linear: what the model's cells do not
show is alike within a cell. Were it new in every row, a motion could follow each wiggle of the attitude up and down,
which is cheaper the nearer it is to the camera. sigma is what remains from row to row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.records.ground import GroundAt
from pipeline.solver.observation.motion_basis import MotionBasis

EAST_NORTH, UP = slice(0, 2), 2
NO_SHARED: Ints = np.full(4, -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMotion:
    """K rows; see the head of this file.

    target (K,), time_s (K,) common time, sigma_m (K,)
    axis     (K,) 0 to 2 of a known place; -1: a row on the ground
    level_m  (K,) coordinate of the place, or height above the ground
    around_m (K, J, 2) places along the way, from the target's own, over which heights are averaged; weight (J,) of them
    shared   (K, S) which of the ground's errors act, -1 none; share (K, S) how much; shared_sigma_m (G,) their priors
    ground   heights and slopes; None where no row is on the ground
    """

    target: Ints
    time_s: Floats
    sigma_m: Floats
    axis: Ints
    level_m: Floats
    around_m: Floats
    weight: Floats
    shared: Ints
    share: Floats
    shared_sigma_m: Floats
    ground: GroundAt | None = None

    @property
    def count(self) -> int:
        """Errors of the ground that are unknowns."""
        return len(self.shared_sigma_m)

    def of(self, target: int) -> Ints:
        """Rows of one target."""
        return np.flatnonzero(self.target == target)

    def residual(self, positions_m: Floats, rows: Ints, errors_m: Floats) -> tuple[Floats, Floats]:
        """Residuals (k,) in sigmas of `rows` with the target at (k, 3), and their derivatives (k, 3) by the place."""
        on_ground = self.axis[rows] < 0
        axis = np.where(on_ground, UP, self.axis[rows])
        normal = np.eye(3)[axis]
        off = positions_m[np.arange(len(rows)), axis] - self.level_m[rows]
        if on_ground.any():
            assert self.ground is not None
            places = positions_m[on_ground, None, EAST_NORTH] + self.around_m[rows[on_ground]]
            found = self.ground(places.reshape(-1, 2))
            off[on_ground] -= found.up_m.reshape(places.shape[:2]) @ self.weight
            normal[on_ground, EAST_NORTH] = -np.einsum("kjx,j->kx", found.slope.reshape(places.shape), self.weight)
            padded = np.append(errors_m, 0.0)  # -1: none
            off -= (padded[self.shared[rows]] * self.share[rows]).sum(axis=1)
        return off / self.sigma_m[rows], normal / self.sigma_m[rows, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownRows:
    """Rows of one target linearised: residual (k,), columns (k, a), and the places (k, a) of the unknowns, -1 held."""

    residual: Floats
    columns: Floats
    places: Ints


def linearised_rows(
    known: KnownMotion, basis: MotionBasis, coefficients: Floats, errors_m: Floats, places: Ints, shared_places: Ints
) -> list[KnownRows]:
    """The rows at a point, target by target; places (P, 3) of the coefficients and (G,) of the ground's errors."""
    out = []
    for n in np.unique(known.target):
        rows, t = known.of(int(n)), basis.targets[int(n)]
        span = basis.span(known.time_s[rows])
        u = (known.time_s[rows] - basis.mid_s[span]) / basis.half_s[span]
        value = np.einsum("ki,kij->kj", u[:, None] ** np.arange(basis.degree + 1), t.transform[span])
        acting = t.active[span][:, None] + np.arange(t.degree + 1)
        position = np.einsum("kj,kjx->kx", value, coefficients[acting])
        residual, normal = known.residual(position, rows, errors_m)
        columns = (value[:, :, None] * normal[:, None, :]).reshape(len(rows), -1)
        at = places[acting].reshape(len(rows), -1)
        if known.count:
            own = known.shared[rows]
            by_errors = np.where(own >= 0, -known.share[rows] / known.sigma_m[rows, None], 0.0)
            columns = np.concatenate([columns, by_errors], axis=1)
            at = np.concatenate([at, np.where(own >= 0, np.append(shared_places, -1)[own], -1)], axis=1)
        out.append(KnownRows(residual=residual, columns=columns, places=at))
    return out
