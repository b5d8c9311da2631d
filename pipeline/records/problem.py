"""What the solver is asked: sight rays, measured poses, clocks' first guesses, priors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from calibration.foundation.arrays import Floats
from pipeline.records.ground import Ground
from pipeline.records.motion import MotionAsked
from pipeline.records.poses import InstrumentSigma, PoseTrack
from pipeline.records.rays import SightRays

ClockKind = Literal["auto", "affine", "drift"]
Method = Literal["triangulation", "intersection", "li", "algorithm-1", "algorithm-2", "map"]
Robust = Literal["none", "huber", "cauchy"]
METHODS: tuple[Method, ...] = ("triangulation", "intersection", "li", "algorithm-1", "algorithm-2", "map")

PoseAt = Callable[[Floats], PoseTrack]
"""Video-to-log shift (n,) seconds, one per frame of the PoseTrack, -> the poses at the moved times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraInput:
    """One camera as the solver gets it.

    rays        all its sightings
    poses       a measured pose for every frame that `rays` names (and only those)
    frame_rate  alpha as given, Hz; frame-equivalent of a video time tau is tau * frame_rate
    offset_s    first guess of beta; None: searched for
    sigma       priors
    clock       which clock model
    still       the pose is one constant pose (a tripod)
    mount_ypr_rad  yaw, pitch, roll of a fixed mount, as the flight file has it, where the poses rest on one; else None
    poses_at    the measured poses at moved log times, where they came from a log; else None
    readout_s   from the exposure of the first row to that of the last; a frame's time and pose are its middle row's
    pose_rate   (n, 6) how the measured poses go on: rotation vector (camera axes, of cam_from_enu) and velocity, per
                second; None: the camera stands still, or nothing asks for it
    """

    camera: str
    rays: SightRays
    poses: PoseTrack
    frame_rate: float
    offset_s: float | None = None
    sigma: InstrumentSigma = field(default_factory=InstrumentSigma)
    clock: ClockKind = "auto"
    still: bool = False
    mount_ypr_rad: tuple[float, float, float] | None = None
    poses_at: PoseAt | None = None
    readout_s: float = 0.0
    pose_rate: Floats | None = None


@dataclass(frozen=True, kw_only=True)
class SurveyedPlace:
    """Where a landmark is, ENU metres, and one sigma per axis."""

    position_enu_m: tuple[float, float, float]
    sigma_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class TargetInput:
    """One target: its name and how it may move; "auto" lets the data say. An `order` given means a polynomial.

    on_ground, above_ground_m  it stays so high above the problem's ground
    landmark   a still point, of order 0, that is marked or tracked like a target
    surveyed   where a landmark is; None: unknown
    check      a surveyed landmark that takes no part in the adjustment, which is held against it
    """

    target: str
    motion: MotionAsked = "auto"
    order: int | Literal["auto"] = "auto"
    on_ground: bool = False
    above_ground_m: float = 0.0
    landmark: bool = False
    surveyed: SurveyedPlace | None = None
    check: bool = False

    @property
    def is_asked(self) -> bool:
        """Whether the data shall say how it moves, or of which order."""
        return self.motion != "spline" and self.order == "auto"


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Everything stage 4 needs. The reference camera's clock is common time: its offset and frame rate are held."""

    cameras: tuple[CameraInput, ...]
    targets: tuple[TargetInput, ...]
    reference_camera: str
    ground: Ground | None = None


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """How to solve.

    refine_frame_rate  false holds every frame rate at its given value
    robust             loss of `map`
    search_s           how far offsets are searched, plus and minus, where nothing is known
    """

    method: Method = "map"
    refine_frame_rate: bool = True
    robust: Robust = "huber"
    max_iterations: int = 100
    search_s: float = 120.0
