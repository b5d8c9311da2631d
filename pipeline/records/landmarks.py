"""What an adjustment found of still points and of the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats, frozen, settle

LandmarkKind = Literal["surveyed", "unknown", "check"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Landmark:
    """A still point after the adjustment.

    kind            surveyed: its coordinates took part; check: they did not, nor did its sightings
    position_enu_m, covariance  (3,), (3, 3) as adjusted; of a check point as the adjusted cameras see it
    surveyed_enu_m  (3,); None: unknown
    off_m           (3,) adjusted minus surveyed; off_covariance (3, 3) of that if all claims are true
    sightings       how many; residual_px root of their mean square, per axis
    """

    name: str
    kind: LandmarkKind
    position_enu_m: Floats
    covariance: Floats
    surveyed_enu_m: Floats | None = None
    off_m: Floats | None = None
    off_covariance: Floats | None = None
    sightings: int = 0
    residual_px: float = float("nan")

    def __post_init__(self) -> None:
        settle(
            self,
            position_enu_m=frozen(self.position_enu_m, (3,), "position_enu_m"),
            covariance=frozen(self.covariance, (3, 3), "covariance"),
        )
        for name, shape in (("surveyed_enu_m", (3,)), ("off_m", (3,)), ("off_covariance", (3, 3))):
            if getattr(self, name) is not None:
                settle(self, **{name: frozen(getattr(self, name), shape, name)})

    @property
    def sigma_m(self) -> Floats:
        """(3,) one sigma per axis of the position."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0)))

    @property
    def off_sigma_m(self) -> Floats:
        """(3,) one sigma per axis of `off_m`; NaN where unknown."""
        if self.off_covariance is None:
            return np.full(3, np.nan)
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.off_covariance), 0)))

    @property
    def statistic(self) -> float:
        """off' C^-1 off: chi-square with three degrees of freedom if all claims are true; NaN where unknown."""
        if self.off_m is None or self.off_covariance is None:
            return float("nan")
        return float(self.off_m @ np.linalg.pinv(self.off_covariance, hermitian=True) @ self.off_m)

    @property
    def error_over_sigma(self) -> float:
        """Root of the statistic per degree of freedom: about one where claims are true."""
        return float(np.sqrt(self.statistic / 3))


@dataclass(frozen=True, kw_only=True)
class GroundFit:
    """What the ground was found to be off by along one target's stretch, upwards, and its sigma; `rows` held it."""

    target: str
    off_m: float
    sigma_m: float
    rows: int
