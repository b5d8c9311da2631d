"""Positions and heights out of PX4's topics.

vehicle_global_position and the receiver's topics give degrees (or 1e-7 degrees) and heights above mean sea level and
above the ellipsoid (metres, or millimetres in old firmware). Where only vehicle_local_position is there, its reference
turns it into places: azimuthal equidistant around (ref_lat, ref_lon) on a sphere, which is what PX4 itself does.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.telemetry.heights.undulation import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.log.flight_log import (
    AttitudeSeries,
    PositionSeries,
    TruthSeries,
)
from pipeline.telemetry.log.receiver import ReceiverSeries, at_times, receiver_series
from pipeline.telemetry.log.series import position_series
from pipeline.telemetry.ulog.columns import GPS_TOPICS, Topic, degrees, floats, metres, topic_time

TRUE_PLACE = "vehicle_global_position_groundtruth"
"""What PX4's simulators say of the vehicle, in the estimator's own message; its attitude is a topic beside it."""
PX4_EARTH_RADIUS_M = 6371000.0
RECEIVER_PLACE = (("latitude_deg", "lat"), ("longitude_deg", "lon"))
"""Fields in degrees, and their predecessors in 1e-7 degrees."""


def vehicle_position(topics: dict[str, Topic]) -> tuple[PositionSeries | None, tuple[str, ...]]:
    """The vehicle's positions by the best topic that has two valid ones, None where none has; and notes."""
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
                notes = () if undulation is None else undulation.notes
                return series, (*notes, *_reckoned(name, topics[name]))
    return None, ()


def _reckoned(name: str, topic: Topic) -> tuple[str, ...]:
    """A note where PX4 itself says that a position goes on without a receiver: its errors grow meanwhile."""
    alone = np.flatnonzero(floats(topic, "dead_reckoning") == 1)
    if not len(alone):
        return ()
    time = topic_time(topic)
    return (
        f"{len(alone)} of {len(time)} positions in {name} are dead reckoning, by PX4's own flag, the first at log time"
        f" {time[alone[0]]:.1f} s, the last at {time[alone[-1]]:.1f} s: nothing holds it then",
    )


def _undulation(topics: dict[str, Topic]) -> Undulation | None:
    topic = topics.get("vehicle_global_position")
    if topic is not None and "alt_ellipsoid" in topic:
        above, sea = floats(topic, "alt_ellipsoid"), floats(topic, "alt")
        told = np.isfinite(above) & (above != 0) & _flagged(topic, "lat_lon_valid", "alt_valid")
        lat, lon = floats(topic, "lat"), floats(topic, "lon")
        found = undulation_of("vehicle_global_position", (above - sea)[told], lat[told], lon[told])
        if found is not None:
            return found
    for name in GPS_TOPICS:
        if name in topics:
            above, sea = _receiver_heights(topics[name])
            fixed = (floats(topics[name], "fix_type") >= 3) & (above != 0)
            lat, lon = (degrees(topics[name], new, old) for new, old in RECEIVER_PLACE)
            found = undulation_of(name, (above - sea)[fixed], lat[fixed], lon[fixed])
            if found is not None:
                return found
    return None


def _flagged(topic: Topic, *names: str) -> Bools:
    """True (n,) where none of the flags that are there calls the row invalid."""
    return np.asarray(np.all([floats(topic, name) != 0 for name in names], axis=0))


def _receiver_heights(topic: Topic) -> tuple[Floats, Floats]:
    """Above the ellipsoid, above mean sea level."""
    above = metres(topic, "altitude_ellipsoid_m", "alt_ellipsoid")
    return above, metres(topic, "altitude_msl_m", "alt")


def _global(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    good = _flagged(topic, "lat_lon_valid", "alt_valid")
    lat, lon = (np.where(good, floats(topic, axis), np.nan) for axis in ("lat", "lon"))
    words, height = on_ellipsoid(floats(topic, "alt"), undulation, lat, lon)
    velocity = np.stack([floats(topic, axis) for axis in ("vel_n", "vel_e", "vel_d")], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=topic_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip


def _receiver(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    above, sea = _receiver_heights(topic)
    bad = floats(topic, "fix_type") < 3
    lat, lon = (np.where(bad, np.nan, degrees(topic, new, old)) for new, old in RECEIVER_PLACE)
    words, height = on_ellipsoid(sea, undulation, lat, lon)
    if undulation is not None and undulation.believed:
        height = np.where(np.isfinite(above) & (above != 0), above, height)
    velocity = np.stack([floats(topic, f"vel_{axis}_m_s") for axis in "ned"], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=topic_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip


def receiver_of(topics: dict[str, Topic], accuracy_source: str) -> ReceiverSeries | None:
    """The receiver's fix and height over time, with the accuracy that `accuracy_source` states then."""
    name = next((t for t in GPS_TOPICS if t in topics), "")
    if not name:
        return None
    topic = topics[name]
    time, nothing = topic_time(topic), np.full(len(topic["timestamp"]), np.nan)
    stated = topics.get(accuracy_source)
    fields = ("pos_horiz_accuracy", "pos_vert_accuracy") if accuracy_source == "estimator_status" else ("eph", "epv")
    across, up = (
        nothing if stated is None else at_times(time, topic_time(stated), floats(stated, field)) for field in fields
    )
    lat, lon = (degrees(topic, new, old) for new, old in RECEIVER_PLACE)
    return receiver_series(
        source=name, time_s=time, fix=floats(topic, "fix_type"), horizontal_m=across, vertical_m=up,
        height_m=on_ellipsoid(_receiver_heights(topic)[1], _undulation(topics), lat, lon)[1],
    )  # fmt: skip


def simulated(topics: dict[str, Topic], attitude: AttitudeSeries | None) -> TruthSeries | None:
    """The simulator's truth, heights above mean sea level; `attitude` is its attitudes."""
    topic = topics.get(TRUE_PLACE)
    if topic is None or attitude is None:
        return None
    lat, lon = floats(topic, "lat"), floats(topic, "lon")
    return TruthSeries(
        source=TRUE_PLACE, time_s=topic_time(topic), lat_rad=np.radians(lat), lon_rad=np.radians(lon),
        height_m=on_ellipsoid(floats(topic, "alt"), _undulation(topics), lat, lon)[1], attitude=attitude,
    )  # fmt: skip


def _local(name: str, topic: Topic, undulation: Undulation | None) -> PositionSeries:
    good = (floats(topic, "xy_global") == 1) & (floats(topic, "z_global") == 1) & _flagged(topic, "xy_valid", "z_valid")
    x, y = floats(topic, "x") / PX4_EARTH_RADIUS_M, floats(topic, "y") / PX4_EARTH_RADIUS_M
    lat0, lon0 = np.radians(floats(topic, "ref_lat")), np.radians(floats(topic, "ref_lon"))
    arc = np.hypot(x, y)
    share = np.sinc(arc / np.pi)
    lat = np.arcsin(np.clip(np.cos(arc) * np.sin(lat0) + x * share * np.cos(lat0), -1, 1))
    lon = lon0 + np.arctan2(y * share, np.cos(lat0) * np.cos(arc) - x * share * np.sin(lat0))
    lat, lon = (np.where(good, np.degrees(angle), np.nan) for angle in (lat, lon))
    words, height = on_ellipsoid(floats(topic, "ref_alt") - floats(topic, "z"), undulation, lat, lon)
    velocity = np.stack([floats(topic, axis) for axis in ("vx", "vy", "vz")], axis=1)
    return position_series(
        source=name, datum="ellipsoid", height_from=words, time_s=topic_time(topic),
        lat_deg=lat, lon_deg=lon, height_m=height, velocity_ned_mps=velocity,
    )  # fmt: skip
