"""PX4 logs (.ulg), read by pyulog (the extra `ulog`).

Times are microseconds since boot. vehicle_attitude is ned_from_body as w, x, y, z; vehicle_global_position and the
receiver's topics give degrees (or 1e-7 degrees) and heights above mean sea level and above the ellipsoid (metres, or
millimetres in old firmware). Where only vehicle_local_position is there, its reference turns it into places:
azimuthal equidistant around (ref_lat, ref_lon) on a sphere, which is what PX4 itself does.
"""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.telemetry.clocks import fit_clock, plausible_utc
from pipeline.telemetry.flight_log import (
    HEADING,
    Accuracy,
    AttitudeSeries,
    ClockFit,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.gimbal_frames import frame_of_flags
from pipeline.telemetry.heights import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.series import attitude_series, gimbal_series, median_of, position_series
from pipeline.telemetry.tables import Progress

GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
PX4_EARTH_RADIUS_M = 6371000.0
UTC_FLOOR_S = 0.2
ROUNDS = 8
"""pyulog reads a whole log once, in pieces of three bytes and more."""
Topic = dict[str, Any]


def read_ulog(path: Path, *, progress: Progress = None) -> FlightLog:
    """The flight log in a `.ulg` file.

    Raises InputFileError where pyulog is not installed or cannot read the file.
    """
    topics, counts, dropouts, complaints = _load(path)
    if progress is not None:
        progress(1.0)
    slow = (f"{dropouts} dropouts: the card was too slow for the log",) if dropouts else ()
    return FlightLog(
        path=path,
        format="ulog",
        counts=counts,
        corrupt_packets=len(complaints),
        position=_position(topics),
        attitude=_attitude(topics),
        gimbal=_gimbal(topics),
        camera_event_s=_camera_events(topics),
        camera_event_source="camera_capture" if "camera_capture" in topics else "camera_trigger",
        utc=_utc(topics),
        accuracy=_accuracy(topics),
        notes=(*slow, *(f"pyulog: {line}" for line in dict.fromkeys(complaints))),
    )


class _Onwards(io.BufferedReader):
    """A file that is read through once or a few times, not for ever: a wrong length sends pyulog back in circles."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._left = 1000 + ROUNDS * path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file; raises ValueError where more was asked for than the file holds ROUNDS times."""
        found = super().read(size)
        self._left -= 1 + len(found)
        if self._left < 0:
            raise ValueError("a wrong length leads back to where it was read before")
        return found


def _load(path: Path) -> tuple[dict[str, Topic], dict[str, int], int, list[str]]:
    """First instance of each topic, messages per topic, dropouts, and what pyulog complains of."""
    try:
        import pyulog
    except ImportError:
        raise InputFileError(
            where=str(path),
            seen="a PX4 log, and pyulog is not installed",
            expected="the extra `ulog`",
            advice="pip install 'runningfix[ulog]'",
        ) from None
    said = io.StringIO()
    try:
        with _Onwards(path) as file, redirect_stdout(said):  # pyulog prints; standard output is for results
            log = pyulog.ULog(file)
    except Exception as error:  # whatever pyulog trips over in a broken file
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read as a PX4 log ({type(error).__name__}: {error})",
            expected="a whole .ulg file",
            advice="download the log again",
        ) from None
    topics: dict[str, Topic] = {}
    counts: dict[str, int] = {}
    whole = (d for d in log.data_list if "timestamp" in d.data)  # a topic without times is a broken one
    for data in sorted(whole, key=lambda d: d.multi_id):
        counts[data.name] = counts.get(data.name, 0) + len(data.data["timestamp"])
        topics.setdefault(data.name, data.data)
    return topics, counts, len(log.dropouts), said.getvalue().splitlines()


def _time(topic: Topic) -> Floats:
    """Log time (n,); the moment of the sample where the topic tells it from the moment of publishing."""
    name = "timestamp_sample" if np.any(topic.get("timestamp_sample", 0)) else "timestamp"
    return _numbers(topic[name]) / 1e6


def _numbers(column: Any) -> Floats:
    """As float64; a signalling NaN in a broken message is a NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(column, float)


def _floats(topic: Topic, *names: str) -> Floats:
    """The first field that is there; NaN where none is."""
    for name in names:
        if name in topic:
            return _numbers(topic[name])
    return np.full(len(topic["timestamp"]), np.nan)


def _degrees(topic: Topic, new: str, old: str) -> Floats:
    return _floats(topic, new) if new in topic else _floats(topic, old) / 1e7


def _metres(topic: Topic, new: str, old: str) -> Floats:
    return _floats(topic, new) if new in topic else _floats(topic, old) / 1e3


def _position(topics: dict[str, Topic]) -> PositionSeries | None:
    undulation = _undulation(topics)
    readers = (
        ("vehicle_global_position", _global),
        *((t, _receiver) for t in GPS_TOPICS),
        ("vehicle_local_position", _local),
    )
    for name, read in readers:
        if name in topics:
            series = read(name, topics[name], undulation)
            if series.valid.sum() >= 2:
                return series
    return None


def _undulation(topics: dict[str, Topic]) -> Undulation | None:
    topic = topics.get("vehicle_global_position")
    if topic is not None and "alt_ellipsoid" in topic:
        above, sea = _floats(topic, "alt_ellipsoid"), _floats(topic, "alt")
        found = undulation_of("vehicle_global_position", (above - sea)[np.isfinite(above) & (above != 0)])
        if found is not None:
            return found
    for name in GPS_TOPICS:
        if name in topics:
            above, sea = _receiver_heights(topics[name])
            fixed = (_floats(topics[name], "fix_type") >= 3) & (above != 0)
            found = undulation_of(name, (above - sea)[fixed])
            if found is not None:
                return found
    return None


def _receiver_heights(topic: Topic) -> tuple[Floats, Floats]:
    """Above the ellipsoid, above mean sea level."""
    above = _metres(topic, "altitude_ellipsoid_m", "alt_ellipsoid")
    return above, _metres(topic, "altitude_msl_m", "alt")


def _global(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    lat, lon = _floats(topic, "lat"), _floats(topic, "lon")
    words, height = on_ellipsoid(_floats(topic, "alt"), undulation, lat, lon)
    velocity = np.stack([_floats(topic, axis) for axis in ("vel_n", "vel_e", "vel_d")], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip


def _receiver(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    above, sea = _receiver_heights(topic)
    bad = _floats(topic, "fix_type") < 3
    lat, lon = (
        np.where(bad, np.nan, _degrees(topic, new, old))
        for new, old in (("latitude_deg", "lat"), ("longitude_deg", "lon"))
    )
    words, height = on_ellipsoid(sea, undulation, lat, lon)
    if undulation is not None:
        height = np.where(np.isfinite(above) & (above != 0), above, height)
    velocity = np.stack([_floats(topic, f"vel_{axis}_m_s") for axis in "ned"], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip


def _local(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    good = (_floats(topic, "xy_global") == 1) & (_floats(topic, "z_global") == 1)
    x, y = _floats(topic, "x") / PX4_EARTH_RADIUS_M, _floats(topic, "y") / PX4_EARTH_RADIUS_M
    lat0, lon0 = np.radians(_floats(topic, "ref_lat")), np.radians(_floats(topic, "ref_lon"))
    arc = np.hypot(x, y)
    share = np.sinc(arc / np.pi)
    lat = np.arcsin(np.clip(np.cos(arc) * np.sin(lat0) + x * share * np.cos(lat0), -1, 1))
    lon = lon0 + np.arctan2(y * share, np.cos(lat0) * np.cos(arc) - x * share * np.sin(lat0))
    lat, lon = (np.where(good, np.degrees(angle), np.nan) for angle in (lat, lon))
    words, height = on_ellipsoid(_floats(topic, "ref_alt") - _floats(topic, "z"), undulation, lat, lon)
    velocity = np.stack([_floats(topic, axis) for axis in ("vx", "vy", "vz")], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip


def _quaternion(topic: Topic, name: str = "q") -> Floats:
    return np.stack([_floats(topic, f"{name}[{i}]") for i in range(4)], axis=1)


def _attitude(topics: dict[str, Topic]) -> AttitudeSeries | None:
    topic = topics.get("vehicle_attitude")
    if topic is None:
        return None
    return attitude_series(source="vehicle_attitude", time_s=_time(topic), ned_from_body=_quaternion(topic))


def _gimbal(topics: dict[str, Topic]) -> GimbalSeries | None:
    """A gimbal device's quaternion with its flags, else mount_orientation (Euler radians, yaw against the vehicle)."""
    topic = topics.get("gimbal_device_attitude_status")
    if topic is not None:
        frame = frame_of_flags(_floats(topic, "device_flags"))
        return gimbal_series(source="gimbal_device_attitude_status", time_s=_time(topic), attitude=_quaternion(topic),
                             frame=frame)  # fmt: skip
    topic = topics.get("mount_orientation")
    if topic is None:
        return None
    roll, pitch, yaw = (_floats(topic, f"attitude_euler_angle[{i}]") for i in range(3))
    q = rotation.ned_from_frd(yaw, pitch, roll)
    frame = np.full(len(q), HEADING)
    return gimbal_series(source="mount_orientation", time_s=_time(topic), attitude=q, frame=frame)


def _camera_events(topics: dict[str, Topic]) -> Floats:
    topic = topics.get("camera_capture", topics.get("camera_trigger"))
    if topic is None:
        return np.empty(0)
    time = _time(topic)
    if "result" in topic:
        time = time[_floats(topic, "result") != 0]
    return np.unique(time)


def _utc(topics: dict[str, Topic]) -> ClockFit | None:
    for name in GPS_TOPICS:
        topic = topics.get(name)
        if topic is not None and "time_utc_usec" in topic:
            utc = _floats(topic, "time_utc_usec") / 1e6
            found = fit_clock(name, _time(topic), np.where(plausible_utc(utc), utc, np.nan), floor_s=UTC_FLOOR_S)
            if found is not None:
                return found
    return None


def _accuracy(topics: dict[str, Topic]) -> Accuracy:
    for name in ("vehicle_global_position", *GPS_TOPICS, "vehicle_local_position"):
        topic = topics.get(name)
        if topic is not None and "eph" in topic:
            return Accuracy(
                horizontal_m=median_of(_floats(topic, "eph"), 100.0),
                vertical_m=median_of(_floats(topic, "epv"), 100.0),
                source=name,
            )
    topic = topics.get("estimator_status")
    if topic is None or "pos_horiz_accuracy" not in topic:
        return Accuracy()
    horizontal, vertical = (median_of(_floats(topic, f"pos_{axis}_accuracy"), 100.0) for axis in ("horiz", "vert"))
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source="estimator_status")
