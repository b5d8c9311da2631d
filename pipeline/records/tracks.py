"""Where a target was in the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats, Ints, frozen, settle

TRACKED, REACQUIRED, LOST = 0, 1, 2
STATE_NAMES = ("tracked", "reacquired", "lost")
TrackerName = Literal["kcf", "csrt"]
TRACKERS: tuple[TrackerName, ...] = ("kcf", "csrt")


@dataclass(frozen=True, kw_only=True)
class Box:
    """A box drawn by a person: left edge, top edge, width, height in pixels, on one frame.

    The left edge of pixel 0 is at 0 here, as drawing tools count it, so the box's centre in image coordinates
    (where pixel 0's centre is 0) is x + width / 2 - 0.5.
    """

    frame: int
    x: float
    y: float
    width: float
    height: float

    @property
    def centre_px(self) -> tuple[float, float]:
        """Centre in image coordinates: pixel (0, 0) is the centre of the top-left pixel."""
        return self.x + self.width / 2 - 0.5, self.y + self.height / 2 - 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageTrack:
    """One target in one camera, a row per frame from the first box on (or per detection made elsewhere).

    frame     (n,) strictly increasing
    time_s    (n,) video time: the container's timestamp, counted from frame 0
    xy_px     (n, 2) centre; NaN while lost
    sigma_px  (n,) per axis; NaN while lost
    state     (n,) TRACKED, REACQUIRED (first fix after a loss) or LOST
    box       (n,) true where a fix is the middle of the target's box, to about a tenth of its side, and not
              a point of its surface, to a fraction of a pixel; all false where not given

    `sigma_px` is what one fix is worth, not a claim that fixes err independently: a tracker's errors last. The constant
    and the slowest part are carried as place errors (`SightRays.place_sigma_px`), what lasts for some frames by the
    solver's cluster-robust covariance (`Solution.motions_robust`, `shared_covariance_robust`).
    """

    camera: str
    target: str
    frame: Ints
    time_s: Floats
    xy_px: Floats
    sigma_px: Floats
    state: npt.NDArray[np.int64]
    box: Bools | None = None

    def __post_init__(self) -> None:
        n = len(self.frame)
        frame = frozen(self.frame, (n,), "frame", np.int64)
        if np.any(np.diff(frame) <= 0):
            raise ValueError(f"track of {self.target} in {self.camera}: frames must increase")
        settle(
            self,
            frame=frame,
            time_s=frozen(self.time_s, (n,), "time_s"),
            xy_px=frozen(self.xy_px, (n, 2), "xy_px"),
            sigma_px=frozen(self.sigma_px, (n,), "sigma_px"),
            state=frozen(self.state, (n,), "state", np.int64),
            box=frozen(np.zeros(n, bool) if self.box is None else self.box, (n,), "box", np.bool_),
        )

    @property
    def by_box(self) -> Bools:
        """(n,) true where a fix is the middle of a box."""
        return np.zeros(len(self.frame), bool) if self.box is None else self.box

    @property
    def seen(self) -> Bools:
        """(n,) true where there is a fix."""
        return np.asarray((self.state != LOST) & np.isfinite(self.xy_px).all(axis=1))
