"""One flight log as the later stages see it, whatever format it came in.

Every series is on log time: seconds since the vehicle's boot. Rows are in time order, one for every message of the
source, with NaN where the message itself says nothing valid: nothing is dropped and nothing is invented.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints, frozen, settle
from pipeline.telemetry.log.receiver import ReceiverSeries

LogFormat = Literal["tlog", "mavlink", "dataflash", "dataflash text", "ulog", "dji srt", "misb klv", "flight record"]
EARTH, HEADING, BODY = 0, 1, 2
Datum = Literal["ellipsoid", "mean sea level", "home"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionSeries:
    """Where the vehicle was.

    source    the messages it came from
    datum     what `height_m` counts from; "ellipsoid" is what the world uses, the others mean that the log could not
              be brought to it
    height_from  in words: how the height got its datum
    time_s    (n,) log time, non-decreasing
    lat_rad, lon_rad, height_m  (n,); NaN where the message has no valid fix
    velocity_ned_mps  (n, 3); NaN where unknown
    above_home_m      (n,) above the take-off place where the log says it too; NaN where not
    repeated          (n,) true where a message only repeats the position before it, which is no sample of its own
    """

    source: str
    datum: Datum
    height_from: str
    time_s: Floats
    lat_rad: Floats
    lon_rad: Floats
    height_m: Floats
    velocity_ned_mps: Floats
    above_home_m: Floats = field(default_factory=lambda: np.empty(0))
    repeated: Bools = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def __post_init__(self) -> None:
        n = len(self.time_s)
        for name in ("time_s", "lat_rad", "lon_rad", "height_m"):
            settle(self, **{name: frozen(getattr(self, name), (n,), name)})
        settle(self, velocity_ned_mps=frozen(self.velocity_ned_mps, (n, 3), "velocity_ned_mps"))
        above_home = self.above_home_m if len(self.above_home_m) else np.full(n, np.nan)
        settle(self, above_home_m=frozen(above_home, (n,), "above_home_m"))
        repeated = self.repeated if len(self.repeated) else np.zeros(n, dtype=np.bool_)
        settle(self, repeated=frozen(repeated, (n,), "repeated", np.bool_))

    @property
    def valid(self) -> Bools:
        """(n,) true where there is a fix and a time, and not only a repetition."""
        return np.asarray(self.told & ~self.repeated)

    @property
    def told(self) -> Bools:
        """(n,) true where there is a fix and a time."""
        return np.asarray(np.isfinite(self.time_s + self.lat_rad + self.lon_rad + self.height_m))


@dataclass(frozen=True, kw_only=True, eq=False)
class AttitudeSeries:
    """How the vehicle's FRD body was turned: `time_s` (n,) log time, `ned_from_body` (n, 4), NaN where invalid."""

    source: str
    time_s: Floats
    ned_from_body: Floats

    def __post_init__(self) -> None:
        n = len(self.time_s)
        settle(
            self,
            time_s=frozen(self.time_s, (n,), "time_s"),
            ned_from_body=frozen(self.ned_from_body, (n, 4), "ned_from_body"),
        )

    @property
    def valid(self) -> Bools:
        """(n,) true where there is an attitude and a time."""
        return np.asarray(np.isfinite(self.time_s + self.ned_from_body.sum(axis=1)))


@dataclass(frozen=True, kw_only=True, eq=False)
class TruthSeries:
    """What a simulator says of its vehicle: places (n,), heights from where the position's count, NaN where unknown."""

    source: str
    time_s: Floats
    lat_rad: Floats
    lon_rad: Floats
    height_m: Floats
    attitude: AttitudeSeries

    def __post_init__(self) -> None:
        n = len(self.time_s)
        for name in ("time_s", "lat_rad", "lon_rad", "height_m"):
            settle(self, **{name: frozen(getattr(self, name), (n,), name)})


@dataclass(frozen=True, kw_only=True, eq=False)
class GimbalSeries:
    """How the camera's mount was turned, as FRD axes (x along the optical axis, z the image's down).

    time_s    (n,) log time
    attitude  (n, 4) frame_from_mount, NaN where invalid
    frame     (n,) what it counts from: EARTH (it is ned_from_mount), HEADING (roll and pitch against the horizon, yaw
              against the vehicle's heading: ned_from_mount = turn about down by the heading * attitude) or BODY (all
              three against the vehicle's body: ned_from_mount = ned_from_body * attitude)
    """

    source: str
    time_s: Floats
    attitude: Floats
    frame: Ints

    def __post_init__(self) -> None:
        n = len(self.time_s)
        settle(
            self,
            time_s=frozen(self.time_s, (n,), "time_s"),
            attitude=frozen(self.attitude, (n, 4), "attitude"),
            frame=frozen(self.frame, (n,), "frame", np.int64),
        )

    @property
    def valid(self) -> Bools:
        """(n,) true where there is an attitude and a time."""
        return np.asarray(np.isfinite(self.time_s + self.attitude.sum(axis=1)))


@dataclass(frozen=True, kw_only=True)
class ClockStep:
    """Log times over which another clock read `ahead_s` more than after it was set."""

    begin_s: float
    end_s: float
    ahead_s: float


@dataclass(frozen=True, kw_only=True)
class ClockModel:
    """Another clock against log time: other = epoch_s + rate * (log time - log_epoch_s).

    sigma_s   of one reading, from the scatter of the pairs and the source's known faults
    pairs, outliers  how many readings it rests on, and how many disagreed
    steps     what it read before it was set, each time
    """

    source: str
    epoch_s: float
    log_epoch_s: float
    rate: float
    sigma_s: float
    pairs: int
    outliers: int
    steps: tuple[ClockStep, ...] = ()

    def other_s(self, log_time_s: float) -> float:
        """The other clock's reading at a log time."""
        return self.epoch_s + self.rate * (log_time_s - self.log_epoch_s)

    def log_s(self, other_s: float) -> float:
        """Log time of a reading of the other clock."""
        return self.log_epoch_s + (other_s - self.epoch_s) / self.rate


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """What the log itself says its instruments are worth (medians, one sigma per axis); NaN where it does not say."""

    horizontal_m: float = float("nan")
    vertical_m: float = float("nan")
    heading_rad: float = float("nan")
    source: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightLog:
    """One vehicle's flight log.

    system, component   of the chosen autopilot; None where the format, or the log, does not say it
    systems             every vehicle in it that gives positions; empty where the format carries one only
    gimbals             every gimbal in it, as the flight file's key `gimbal` names them, where their attitudes differ
    counts              message name -> how many whole messages, of every sender
    corrupt_packets     packets that failed their checksum or broke off, and segments of bytes that are no packet
    camera_event_s      (k,) log times of exposures, which message says so, and how well
    receiver            what the receiver of the positions said of itself over time; None where the format does not tell
    truth               a simulator's own poses, where the log has them
    utc, record_clock   UTC, and the recording ground station's clock, against log time; None where unknown
    video_start_s, video_start_sigma_s  log time of frame 0 of the video that the log lies in; NaN where it lies in none
    takeoff_given       whether heights are those above home, raised by a take-off height that a person gave
    notes               one sentence each: what a careful reader should know
    excerpt_s           the log time that was read whole, where the rest was only sampled (`counts` and series hold what
                        was read); None where all of it was
    bytes_read          how many of the file's bytes were looked at for an excerpt; 0 for the whole log
    """

    path: Path
    format: LogFormat
    system: int | None = None
    component: int | None = None
    systems: tuple[int, ...] = ()
    gimbals: tuple[int, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    corrupt_packets: int = 0
    position: PositionSeries | None = None
    attitude: AttitudeSeries | None = None
    gimbal: GimbalSeries | None = None
    camera_event_s: Floats = field(default_factory=lambda: np.empty(0))
    camera_event_source: str = ""
    camera_event_sigma_s: float = 0.0
    utc: ClockModel | None = None
    record_clock: ClockModel | None = None
    accuracy: Accuracy = field(default_factory=Accuracy)
    receiver: ReceiverSeries | None = None
    truth: TruthSeries | None = None
    video_start_s: float = float("nan")
    video_start_sigma_s: float = float("nan")
    takeoff_given: bool = False
    notes: tuple[str, ...] = ()
    excerpt_s: tuple[float, float] | None = None
    bytes_read: int = 0

    def __post_init__(self) -> None:
        settle(
            self,
            counts=MappingProxyType(dict(sorted(self.counts.items()))),
            camera_event_s=frozen(self.camera_event_s, (None,), "camera_event_s"),
        )
