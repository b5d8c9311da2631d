"""Where a camera was and how it was turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseTrack:
    """Poses of one camera, one for each of its frames.

    frame           (n,) strictly increasing
    time_s          (n,) log time where the pose came from a log, else video time
    position_enu_m  (n, 3) of the optical centre
    enu_from_cam    (n, 4) unit quaternions; the paper's R_c(f) is the conjugate
    """

    camera: str
    frame: Ints
    time_s: Floats
    position_enu_m: Floats
    enu_from_cam: Floats

    def __post_init__(self) -> None:
        n = len(self.frame)
        frame = frozen(self.frame, (n,), "frame", np.int64)
        if np.any(np.diff(frame) <= 0):
            raise ValueError(f"poses of {self.camera}: frames must increase")
        settle(
            self,
            frame=frame,
            time_s=frozen(self.time_s, (n,), "time_s"),
            position_enu_m=frozen(self.position_enu_m, (n, 3), "position_enu_m"),
            enu_from_cam=frozen(self.enu_from_cam, (n, 4), "enu_from_cam"),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LogPaths:
    """What a flight log says, as curves; NaN breaks one.

    place_s, east_north_height_m      (n,), (n, 3) metres from the first position, height as the log's datum has it
    body_s, body_ypr_rad              (m,), (m, 3) yaw, pitch, roll of the vehicle
    gimbal_s, gimbal_ypr_rad          (k,), (k, 3) of the gimbal, in whatever frame its messages use
    event_s                           (e,) camera events
    """

    place_s: Floats
    east_north_height_m: Floats
    body_s: Floats
    body_ypr_rad: Floats
    gimbal_s: Floats
    gimbal_ypr_rad: Floats
    event_s: Floats

    def __post_init__(self) -> None:
        for time, value in (
            ("place_s", "east_north_height_m"), ("body_s", "body_ypr_rad"), ("gimbal_s", "gimbal_ypr_rad")
        ):  # fmt: skip
            stamp = frozen(getattr(self, time), (None,), time)
            settle(self, **{time: stamp, value: frozen(getattr(self, value), (len(stamp), 3), value)})
        settle(self, event_s=frozen(self.event_s, (None,), "event_s"))


@dataclass(frozen=True, kw_only=True)
class InstrumentSigma:
    """What a camera's instruments are worth: one sigma per axis, zero holds the value.

    attitude_bias_rad, position_bias_m  constant over the flight
    attitude_rad, position_m            moving: new in every frame, or lasting
    attitude_tau_s, position_tau_s      e-folding time of the moving part; 0: new in every frame, None: let the data say
    pixel_px                            where a track says nothing
    offset_s                            of the first guess of the time offset; None: nothing is known, no prior
    frame_rate, focal                   relative
    start_s                             of the time between video and log
    readout_s                           of the rolling shutter's readout
    """

    attitude_bias_rad: float = float(np.radians(0.5))
    attitude_rad: float = float(np.radians(0.5))
    position_bias_m: float = 3.0
    position_m: float = 1.0
    pixel_px: float = 1.0
    offset_s: float | None = None
    frame_rate: float = 0.01
    focal: float = 0.0
    start_s: float = 0.0
    attitude_tau_s: float | None = None
    position_tau_s: float | None = None
    readout_s: float = 0.0
