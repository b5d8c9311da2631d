"""What a calibration answers: the camera, and how far to believe it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.boards.board import Board
from calibration.camera import CameraModel
from calibration.foundation.arrays import Floats, Ints, frozen, settle
from calibration.judgement.coverage import LATTICE_COLUMNS, LATTICE_ROWS, Coverage, missing_regions

WHOLE_AREA = 0.9
"""Share of the picture within the hull of all corners that is called all of it: boards end before its edges."""

Verdict = Literal["good", "usable", "poor"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedView:
    """One view that was used.

    corners, residual_px (n, 2)  observed, and predicted minus observed; index (n,) which corners of the board
    rms_px       root mean square of the residuals' lengths
    held_out_px  the same under the intrinsics that all the other views give
    tilt_deg     between the board's normal and the optical axis
    distance_m   of the board's middle
    blur_px      sigma of the edges: sharpest and most blurred direction
    """

    name: str
    corners: Floats
    index: Ints
    residual_px: Floats
    rms_px: float
    held_out_px: float
    tilt_deg: float
    distance_m: float
    blur_px: tuple[float, float]

    def __post_init__(self) -> None:
        n = len(self.index)
        settle(
            self,
            corners=frozen(self.corners, (n, 2), "corners"),
            index=frozen(self.index, (n,), "index", int),
            residual_px=frozen(self.residual_px, (n, 2), "residual_px"),
        )


@dataclass(frozen=True, kw_only=True)
class RejectedView:
    """One photo that was not used, and why; `harmless` where nothing is wrong with it, only nothing new in it."""

    name: str
    reason: str
    harmless: bool = False


@dataclass(frozen=True, kw_only=True)
class DirectionSigma:
    """One sigma of where the camera puts a direction, as a distance in pixels, a rotation of the camera taken off.

    typical_px, worst_px  median and 95 % over the part of the image that boards reached (the hull of all corners)
    beyond_px             the largest elsewhere, where the lens is extrapolated; NaN where nothing is left out
    """

    typical_px: float
    worst_px: float
    beyond_px: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """A calibrated camera with its quality.

    camera         carries rms_px and the covariance of (fx, fy, cx, cy, distortion)
    lens           the model that was chosen, in words
    sigma          (4 + d,) standard deviations of (fx, fy, cx, cy, distortion); zero: held
    held_out_px    RMS error of views predicted from all the others
    corner_noise_px  scatter of the corners about a smooth grid, per coordinate, whatever the lens
    inflation      by which the covariance was enlarged, because errors are shared by all corners of a view
    direction_sigma  of where the camera puts a direction: what all of this means for a sighting
    sigma_map_px   (17, 21) the same all over the image (`coverage.lattice`), row by row; inf where nothing is known
    bend_m         (m, 3) by which the board was found to differ from a flat, square one; None: taken as flat
    verdict        "good", "usable" or "poor", because of `warnings`; `advice` says what to photograph next
    """

    camera: CameraModel
    board: Board
    lens: str
    views: tuple[CalibratedView, ...]
    rejected: tuple[RejectedView, ...]
    sigma: Floats
    held_out_px: float
    corner_noise_px: float
    inflation: float
    direction_sigma: DirectionSigma
    sigma_map_px: Floats
    coverage: Coverage
    bend_m: Floats | None
    verdict: Verdict
    warnings: tuple[str, ...]
    advice: tuple[str, ...]

    def __post_init__(self) -> None:
        settle(
            self,
            sigma=frozen(self.sigma, (None,), "sigma"),
            sigma_map_px=frozen(self.sigma_map_px, (LATTICE_ROWS, LATTICE_COLUMNS), "sigma_map_px"),
        )

    @property
    def part(self) -> str:
        """Over which part of the picture the verdict holds, in words."""
        missing = missing_regions(self.coverage.seen)
        if not missing and self.coverage.area >= WHOLE_AREA:
            return "over the whole picture"
        but = f", not at its {', '.join(missing)}" if missing else ""
        return f"over the {self.coverage.area:.0%} of the picture that boards reached{but}"

    @property
    def rms_px(self) -> float:
        """RMS reprojection error over all corners of all used views."""
        every = np.concatenate([v.residual_px for v in self.views])
        return float(np.sqrt(np.mean(np.sum(every**2, axis=1))))

    @property
    def correlation(self) -> Floats:
        """(4 + d, 4 + d) correlation of the intrinsics; zero where held."""
        assert self.camera.covariance is not None
        safe = np.where(self.sigma > 0, self.sigma, 1.0)
        return np.asarray(self.camera.covariance / np.outer(safe, safe))
