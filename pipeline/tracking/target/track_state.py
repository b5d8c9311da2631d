"""What is known of a target between two frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.scene.background import Scene, moved
from pipeline.tracking.target.coarse import Coarse
from pipeline.tracking.target.kinematics import Course
from pipeline.tracking.target.template import Template, scale_of

FixKind = Literal["surface", "box"]
WARM_FIXES, WARM_SIZES = 15, 1.5  # a target is new until it has this many fixes and has moved this many own sizes
# a find moves over the ground at this share of the velocity it had, at least and at most, where that can be told
SLOWER, FASTER, LEAST_TOLD_PX = 0.3, 2.5, 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Fix:
    """A target found in one frame; `linear` (2, 2) is how its first box is turned, scaled and sheared since.

    kind  "surface": a point of the target's surface, to a fraction of a pixel; "box": the middle of its box
    """

    frame: int
    xy_px: tuple[float, float]
    linear: Floats
    sigma_px: float
    score: float
    kind: FixKind = "surface"


@dataclass(frozen=True, kw_only=True, eq=False)
class Doubt:
    """A find that waits for confirmation.

    otherwise    the target as it is if the find is a mistake: still hidden, its course as it was, carried along
    frames       that must agree with it
    anchor_px    the ground where it was found, as the background carried it since
    velocity     (2,) that the target had over the ground when it was lost, px/s as seen now
    near         whether it was found about where it was expected
    expected_px  (2,) how far it would have gone over the ground since
    """

    otherwise: TrackState
    frames: int
    anchor_px: Floats
    velocity: Floats
    near: bool = True
    expected_px: Floats = field(default_factory=lambda: np.zeros(2))

    def later(self, scene: Scene) -> Doubt:
        """The same one frame later."""
        anchor, jacobian = moved(scene.cur_from_prev, self.anchor_px)
        velocity = jacobian @ self.velocity
        expected = jacobian @ self.expected_px + velocity * scene.dt_s
        return replace(self, anchor_px=anchor, velocity=velocity, expected_px=expected)

    @property
    def told(self) -> bool:
        """Whether the target would have gone far enough for its motion to tell it from the ground."""
        return float(np.hypot(*self.expected_px)) > LEAST_TOLD_PX

    def goes_otherwise(self, now_px: Floats) -> bool:
        """Whether what was found does not move as the target did, as far as that can be told: stands, flees, turned."""
        if not self.told:
            return False
        along = float((now_px - self.anchor_px) @ self.expected_px) / float(self.expected_px @ self.expected_px)
        return not SLOWER <= along <= FASTER


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackState:
    """A target between two frames.

    usual    (score, share agreeing) of this target when all of it is seen
    pending  fixes after a loss that wait for confirmation; None while not in doubt
    doubt    how much must agree before they count
    lost_s   how long it has been hidden
    scale_when_lost  image pixels for one of the first box's frame, when it was last seen
    hidden, gone  not seen now; not looked for any more
    spin     how fast it turns against the scene, rad/s
    fixes, travelled_px  so far; the way is over the ground
    sigma_px  of the last fix
    """

    template: Template
    linear: Floats
    course: Course
    coarse: Coarse | None
    spin: float = 0.0
    usual: Floats = field(default_factory=lambda: np.array([0.95, 0.9]))
    lost_s: float = 0.0
    scale_when_lost: float = 1.0
    doubt: Doubt | None = None
    hidden: bool = False
    gone: bool = False
    pending: tuple[Fix, ...] = ()
    fixes: int = 0
    travelled_px: float = 0.0
    sigma_px: float = 0.0

    @property
    def scale(self) -> float:
        """Image pixels for one of the first box's frame."""
        return scale_of(self.linear)

    @property
    def new(self) -> bool:
        """Whether it has not yet moved enough over the ground to tell it from what is around it in its box."""
        return self.fixes < WARM_FIXES or self.travelled_px < WARM_SIZES * self.template.size
