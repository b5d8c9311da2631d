"""The ground as the adjustment asks for it: how high it is at a place, how steep, and how sure that is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, frozen, settle


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundHeights:
    """The ground at n places.

    up_m     (n,) ENU up; where it is not known, that of the nearest place where it is
    slope    (n, 2) its rise to the east and to the north, m / m
    rough_m  (n,) sigma of what the model's cells do not show of it
    known    (n,) false in voids and beyond the model's edge
    """

    up_m: Floats
    slope: Floats
    rough_m: Floats
    known: Bools

    def __post_init__(self) -> None:
        n = len(self.up_m)
        settle(
            self,
            up_m=frozen(self.up_m, (n,), "up_m"),
            slope=frozen(self.slope, (n, 2), "slope"),
            rough_m=frozen(self.rough_m, (n,), "rough_m"),
            known=frozen(self.known, (n,), "known", np.bool_),
        )


GroundAt = Callable[[Floats], GroundHeights]
"""Places (n, 2), ENU east and north in metres -> the ground there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ground:
    """The ground of a flight.

    at        heights
    sigma_m   of the ground's height along one target's stretch, constant there
    common_m  the part of it that is the same for all targets: root of sum of squares with each one's own is `sigma_m`
    cell_m    distance over which its roughness is alike
    source    in words, for messages and the report
    """

    at: GroundAt
    sigma_m: float
    common_m: float
    cell_m: float
    source: str

    @property
    def own_m(self) -> float:
        """What one target's stretch is off by apart from the others'."""
        return float(np.sqrt(max(self.sigma_m**2 - self.common_m**2, 0.0)))
