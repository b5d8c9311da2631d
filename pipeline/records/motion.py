"""How a target moves: a B-spline in common time. A polynomial is a spline without inner knots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats, frozen, settle
from pipeline.geometry.splines import acting, interval_of, spline

MotionKind = Literal["polynomial", "spline"]
MotionAsked = Literal["auto", "polynomial", "spline"]
"""What a user may ask for; "auto" lets the data say."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The path of one target, X(t) = sum of B_i(t) c_i (paper eq. 7 and 10 in another basis).

    A polynomial of order K over [a, b] is the spline of degree K with knots a (K + 1 times), b (K + 1 times): the
    same functions as the powers of t, but well conditioned.

    degree        K for a polynomial
    knots_s       (p + degree + 1,) common time
    coefficients  (p, 3) ENU metres
    covariance_band  (p, degree + 1, 3, 3): element [i, j] is the covariance of c_i with c_(i + j), zero past the
                  end; all of it for a polynomial, all that a position needs for a spline. None: not determined
    start_s, end_s  common time in which the target was seen
    """

    target: str
    kind: MotionKind
    degree: int
    knots_s: Floats
    coefficients: Floats
    covariance_band: Floats | None = None
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        p = len(self.coefficients)
        settle(
            self,
            knots_s=frozen(self.knots_s, (p + self.degree + 1,), "knots_s"),
            coefficients=frozen(self.coefficients, (p, 3), "coefficients"),
        )
        if self.covariance_band is not None:
            settle(self, covariance_band=frozen(self.covariance_band, (p, self.degree + 1, 3, 3), "covariance_band"))

    def position_enu_m(self, time_s: Floats, derivative: int = 0) -> Floats:
        """Position (n, 3), or its time derivative (m/s, m/s^2, ...), at common times (n,)."""
        return spline(self.knots_s, self.coefficients, self.degree, np.asarray(time_s, float), derivative)

    def position_covariance(self, time_s: Floats) -> Floats:
        """Covariance (n, 3, 3) of the position at common times (n,), m^2; NaN where none was determined."""
        time = np.asarray(time_s, float)
        if self.covariance_band is None:
            return np.full((len(time), 3, 3), np.nan)
        k = self.degree
        interval = interval_of(self.knots_s, k, time)
        first, weight = interval - k, acting(self.knots_s, k, interval, time)
        total = np.zeros((len(time), 3, 3))
        for i in range(k + 1):
            for j in range(k + 1 - i):
                block = self.covariance_band[first + i, j] * (weight[:, i] * weight[:, i + j])[:, None, None]
                total += block if j == 0 else block + np.swapaxes(block, 1, 2)
        return total

    def power_coefficients(self, epoch_s: float = 0.0) -> Floats:
        """The paper's a_k, b_k, c_k (K + 1, 3): position = sum of row k times (t - epoch)^k. Polynomials only."""
        if self.kind != "polynomial":
            raise ValueError("a spline has no single polynomial")
        at = np.array([epoch_s])
        factorial = np.cumprod([1.0, *range(1, self.degree + 1)])
        return np.array([self.position_enu_m(at, k)[0] / factorial[k] for k in range(self.degree + 1)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A target's motion sampled evenly over the time in which it was seen.

    time_s          (n,) common time
    position_enu_m  (n, 3)
    velocity_mps    (n, 3) ENU
    covariance      (n, 3, 3) of the position, m^2
    """

    target: str
    time_s: Floats
    position_enu_m: Floats
    velocity_mps: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        n = len(self.time_s)
        settle(
            self,
            time_s=frozen(self.time_s, (n,), "time_s"),
            position_enu_m=frozen(self.position_enu_m, (n, 3), "position_enu_m"),
            velocity_mps=frozen(self.velocity_mps, (n, 3), "velocity_mps"),
            covariance=frozen(self.covariance, (n, 3, 3), "covariance"),
        )

    @property
    def sigma_m(self) -> Floats:
        """(n,) root of the covariance's trace: the one-sigma of the 3D position."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))
