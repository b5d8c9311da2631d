"""What the solver answers, with its uncertainty and with what it could not know."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle
from pipeline.records.landmarks import GroundFit, Landmark
from pipeline.records.motion import Motion
from pipeline.records.poses import PoseTrack
from pipeline.records.verdict import Correction, DepthRange, Verdict

SolveStatus = Literal["converged", "iteration-limit", "stalled"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Clock:
    """Clock of one camera: common time t = tau * nominal_rate / frame_rate + offset_s + deviation (paper eq. 2).

    tau is video time, so tau * nominal_rate is the frame number where the container's times are even.
    sigma zero: held (the reference camera, or a setting). `deviation_s` (k,) at `deviation_frame` (k,), linear in
    between, only where a clock drifts.
    """

    camera: str
    offset_s: float
    frame_rate: float
    nominal_rate: float
    offset_sigma_s: float
    frame_rate_sigma: float
    deviation_frame: Floats | None = None
    deviation_s: Floats | None = None
    deviation_sigma_s: Floats | None = None

    def common_time_s(self, video_time_s: Floats) -> Floats:
        """Common time (n,) of video times (n,)."""
        frames = np.asarray(video_time_s, float) * self.nominal_rate
        time = frames / self.frame_rate + self.offset_s
        if self.deviation_frame is not None and self.deviation_s is not None:
            time = time + np.interp(frames, self.deviation_frame, self.deviation_s)
        return np.asarray(time)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bias:
    """Constant error of one camera's poses that the adjustment found.

    rotation_rad  (3,) in camera axes: cam_from_enu (true) = exp(rotation) * cam_from_enu (measured)
    position_m    (3,) ENU: true minus measured
    focal_scale   true focal length over the calibrated one
    start_s       true log time of frame 0 minus the given one
    readout_s     of the rolling shutter, the whole of it: as given, or as refined
    *_sigma       one standard deviation each
    """

    camera: str
    rotation_rad: Floats
    rotation_sigma_rad: Floats
    position_m: Floats
    position_sigma_m: Floats
    focal_scale: float = 1.0
    focal_scale_sigma: float = 0.0
    start_s: float = 0.0
    start_sigma_s: float = 0.0
    readout_s: float = 0.0
    readout_sigma_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rotation_rad", "rotation_sigma_rad", "position_m", "position_sigma_m"):
            settle(self, **{name: frozen(getattr(self, name), (3,), name)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Sightings:
    """Every observation after the adjustment, (m,) rows ordered by camera, frame, target.

    time_s         common time
    residual_px    (m, 2) observed minus predicted pixel
    residual_sigma (m,) length of the residual in sigmas
    weight         (m,) that the robust loss gave it, 0 to 1
    position_enu_m (m, 3) of the target then
    """

    camera: tuple[str, ...]
    target: tuple[str, ...]
    frame: Ints
    time_s: Floats
    residual_px: Floats
    residual_sigma: Floats
    weight: Floats
    position_enu_m: Floats

    def __post_init__(self) -> None:
        m = len(self.frame)
        settle(
            self,
            frame=frozen(self.frame, (m,), "frame", np.int64),
            time_s=frozen(self.time_s, (m,), "time_s"),
            residual_px=frozen(self.residual_px, (m, 2), "residual_px"),
            residual_sigma=frozen(self.residual_sigma, (m,), "residual_sigma"),
            weight=frozen(self.weight, (m,), "weight"),
            position_enu_m=frozen(self.position_enu_m, (m, 3), "position_enu_m"),
        )


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something the observations cannot determine, or a reader should know, in words.

    kind        short name, for example "time-gauge", "coplanar-rays", "ambiguous-offset"
    subject     camera, target or "" for the whole problem
    words       one sentence a person understands
    carried_by  the prior or setting that decides instead, "" where nothing does
    """

    kind: str
    subject: str
    words: str
    carried_by: str = ""


@dataclass(frozen=True, kw_only=True)
class OffsetCandidate:
    """One answer of the global search: an offset per camera and the cost (half chi-square) it reaches.

    frame_rate  alpha per camera, Hz, that goes with the offsets: a start from one without the other is far off
    """

    offset_s: Mapping[str, float]
    cost: float
    frame_rate: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Redundancy:
    """What is left over of one camera's or one target's sightings to check them with.

    equations   two a sighting
    redundancy  equations less what they spend on unknowns; what `chi_square` is on average if all sigmas are true
    chi_square  its sum of squared residuals in sigmas
    """

    kind: Literal["camera", "target"]
    subject: str
    equations: int
    redundancy: float
    chi_square: float


@dataclass(frozen=True, kw_only=True)
class UnitWeight:
    """The two-sided chi-square test of unit weight: are residuals as large as their sigmas promise?

    variance_factor  chi-square over degrees of freedom
    low, high        between which it falls in 95 of 100 flights whose sigmas are true
    p_value          of a factor at least as far from one
    """

    variance_factor: float
    low: float
    high: float
    p_value: float

    @property
    def passed(self) -> bool:
        """Whether it is between them."""
        return self.low <= self.variance_factor <= self.high


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """The adjusted flight.

    cost             half the sum of squared residuals (robust loss where there is one)
    chi_square, degrees_of_freedom  without the robust loss' reweighting of outliers; priors count as observations
    shared_names     names of the shared parameters ("uav2.offset_s", "uav2.frame_rate", ...)
    shared_covariance (s, s) of them; `shared_covariance_robust` is the cluster-robust (sandwich) version
    redundancies     of every camera, then of every target; empty where no covariance was determined
    motions_robust   the same motions with the sandwich covariance in place of the plain one
    expected_chi_square  what `chi_square` is on average if all claims are true: the true redundancy; NaN where unknown
    verdict          whether to use it, and what speaks against it
    corrections      of every parameter of a camera that is free and has a prior; `map` only has priors
    landmarks        still points: surveyed, unknown, and check points
    ground           what the ground is off by, of targets on it
    depths           of targets whose distance is so unsure that a sigma would mislead
    seconds          of the numerical solve alone (kernels warm), never written to a file
    settings         in force, as plain values
    """

    method: str
    status: SolveStatus
    message: str
    iterations: int
    cost: float
    chi_square: float
    degrees_of_freedom: int
    clocks: tuple[Clock, ...]
    poses: tuple[PoseTrack, ...]
    motions: tuple[Motion, ...]
    sightings: Sightings
    biases: tuple[Bias, ...] = ()
    findings: tuple[Finding, ...] = ()
    offset_candidates: tuple[OffsetCandidate, ...] = ()
    shared_names: tuple[str, ...] = ()
    shared_covariance: Floats | None = None
    shared_covariance_robust: Floats | None = None
    motions_robust: tuple[Motion, ...] = ()
    redundancies: tuple[Redundancy, ...] = ()
    expected_chi_square: float = math.nan
    verdict: Verdict = field(default_factory=Verdict)
    corrections: tuple[Correction, ...] = ()
    depths: tuple[DepthRange, ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    ground: tuple[GroundFit, ...] = ()
    seconds: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def unit_weight(self) -> UnitWeight | None:
        """The test of unit weight; None where nothing is left over or residuals have no sigma (the paper's methods)."""
        if self.method != "map" or self.degrees_of_freedom < 1:
            return None
        from scipy.special import chdtr, chdtrc, chdtri  # slow to import, and scipy.stats three times as slow

        free = self.expected_chi_square if self.expected_chi_square > 0 else float(self.degrees_of_freedom)
        low, high = (float(chdtri(free, above)) / free for above in (0.975, 0.025))
        tails = chdtr(free, self.chi_square), chdtrc(free, self.chi_square)
        return UnitWeight(
            variance_factor=self.chi_square / free,
            low=low,
            high=high,
            p_value=float(min(1.0, 2 * min(tails))),
        )

    def clock(self, camera: str) -> Clock:
        """The clock of one camera."""
        return next(c for c in self.clocks if c.camera == camera)

    def motion(self, target: str) -> Motion:
        """The motion of one target."""
        return next(m for m in self.motions if m.target == target)
