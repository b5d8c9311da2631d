"""A UAV's `.tlog` as a ground station writes it: MAVLink 2 packets, each after 8 bytes of the station's own clock.

Beside position, attitude, gimbal and camera event there is the chatter of a real link: heartbeats of autopilot and
ground station, radio status, parameters, texts. Packed by pymavlink.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.synthetic.instruments import UNDULATION_M, Recording

GROUND_STATION = (255, 190)
RADIO = (51, 68)
LATENCY_S, JITTER_S = 0.018, 0.006
LINK_BITS = 3
"""The low bits of a stamp are the link's number: 0."""
Event = tuple[float, tuple[int, int], Any]


def tlog_bytes(recording: Recording, *, system: int, seed: int) -> bytes:
    """The whole log of the vehicle `system`; the same seed gives the same bytes."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    rng = np.random.default_rng([seed, 5])
    events = sorted(_events(recording, system, dialect, rng), key=lambda event: event[0])
    packers: dict[tuple[int, int], Any] = {}
    clock, latest, out = recording.clock, 0, []
    for boot_s, who, message in events:
        packer = packers.setdefault(who, dialect.MAVLink(None, srcSystem=who[0], srcComponent=who[1]))
        arrived = boot_s + (0.0 if who == GROUND_STATION else LATENCY_S + rng.exponential(JITTER_S))
        latest = max(latest, round((arrived - clock.boot_zero_s + clock.recorder_zero_s) * 1e6) & ~LINK_BITS)
        out.append(struct.pack(">Q", latest) + message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
    return b"".join(out)


def _events(log: Recording, system: int, dialect: Any, rng: np.random.Generator) -> Iterator[Event]:
    """(time since boot, (system, component), message), in no order."""
    me = (system, 1)
    for boot_s, message in _flight(log, dialect):
        yield boot_s, me, message
    for boot_s, message in _instruments(log, dialect):
        yield boot_s, me, message
    for boot_s, message in _chatter(log, dialect, rng):
        yield boot_s, me, message
    for boot_s, who, message in _others(log, dialect):
        yield boot_s, who, message


def _every(log: Recording, period_s: float, phase_s: float) -> Floats:
    """Whole milliseconds of a message sent every `period_s` during the log."""
    start, end = log.attitude_boot_s[[0, -1]]
    return np.asarray(np.round(np.arange(start + phase_s, end, period_s), 3))


def _ms(boot_s: float) -> int:
    return round(boot_s * 1000)


def _degrees(lat_lon_height: Floats) -> tuple[int, int, int, int]:
    """Latitude and longitude in 1e-7 degrees, heights above mean sea level and the ellipsoid in mm."""
    lat, lon, height = lat_lon_height
    return (
        round(float(np.degrees(lat)) * 1e7),
        round(float(np.degrees(lon)) * 1e7),
        round((height - UNDULATION_M) * 1000),
        round(height * 1000),
    )


def _flight(log: Recording, dialect: Any) -> Iterator[tuple[float, Any]]:
    """Where the UAV is and how it is turned."""
    ground_mm = round(1000 * 60.0)
    for k, boot_s in enumerate(log.position_boot_s):
        lat, lon, sea_mm, ellipsoid_mm = _degrees(log.lat_lon_height[k])
        north, east, down = log.velocity_ned_mps[k]
        course = round(float(np.degrees(np.arctan2(east, north)) % 360) * 100) % 36000
        speed = [round(100 * v) for v in (north, east, down)]
        yield (
            boot_s,
            dialect.MAVLink_global_position_int_message(
                _ms(boot_s), lat, lon, sea_mm, ellipsoid_mm - ground_mm, *speed, course
            ),
        )
        if k % 2 == 0:
            yield boot_s + 0.003, _gps(log, boot_s, (lat, lon, sea_mm, ellipsoid_mm), speed, course, dialect)
    angles = rotation.yaw_pitch_roll(log.ned_from_body)
    for boot_s, (yaw, pitch, roll), rate in zip(log.attitude_boot_s, angles, log.body_rate_radps, strict=True):
        yield boot_s, dialect.MAVLink_attitude_message(_ms(boot_s), roll, pitch, yaw, *rate)


def _gps(
    log: Recording, boot_s: float, place: tuple[int, int, int, int], speed: list[int], course: int, dialect: Any
) -> Any:
    lat, lon, sea_mm, ellipsoid_mm = place
    accuracy_mm = round(1000 * max(log.noise.position_bias_m, 0.01))
    return dialect.MAVLink_gps_raw_int_message(
        time_usec=round(boot_s * 1e6),
        fix_type=3,
        lat=lat,
        lon=lon,
        alt=sea_mm,
        eph=72,
        epv=118,
        vel=round(math.hypot(speed[0], speed[1])),
        cog=course,
        satellites_visible=17,
        alt_ellipsoid=ellipsoid_mm,
        h_acc=accuracy_mm,
        v_acc=accuracy_mm,
        vel_acc=180,
    )


def _instruments(log: Recording, dialect: Any) -> Iterator[tuple[float, Any]]:
    """Gimbal, UTC and the exposure of the video's first frame."""
    yield from _gimbal(log, dialect)
    clock = log.clock
    for boot_s in _every(log, 0.5, 0.011):
        unix_us = 0 if clock.utc_zero_s is None else round((boot_s - clock.boot_zero_s + clock.utc_zero_s) * 1e6)
        yield boot_s, dialect.MAVLink_system_time_message(unix_us, _ms(boot_s))
    first = log.first_frame_s
    k = int(np.argmin(np.abs(log.position_boot_s - first)))
    lat, lon, sea_mm, ellipsoid_mm = _degrees(log.lat_lon_height[k])
    unix_us = 0 if clock.utc_zero_s is None else round((first - clock.boot_zero_s + clock.utc_zero_s) * 1e6)
    shown = log.ned_from_body if log.ned_from_gimbal is None else log.ned_from_gimbal
    q = shown[int(np.argmin(np.abs(log.attitude_boot_s - first)))]
    yield (
        first + 0.004,
        dialect.MAVLink_camera_image_captured_message(
            _ms(first), unix_us, 1, lat, lon, sea_mm, ellipsoid_mm - 60000, list(q), 0, 1, b"DCIM/VIDEO_0001.MP4"
        ),
    )


def _gimbal(log: Recording, dialect: Any) -> Iterator[tuple[float, Any]]:
    """The mount against the horizon and the vehicle's heading: q_earth = q_delta_yaw * q_vehicle."""
    if log.ned_from_gimbal is None:
        return
    flags = (
        dialect.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
        | dialect.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
        | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    )
    heading = rotation.yaw_pitch_roll(log.ned_from_body)[:, 0]
    zero = np.zeros_like(heading)
    level_from_ned = rotation.exp(np.stack([zero, zero, -heading], axis=1))
    level_from_gimbal = rotation.multiply(level_from_ned, log.ned_from_gimbal)
    for boot_s, q, yaw in zip(log.attitude_boot_s, level_from_gimbal, heading, strict=True):
        yield (
            boot_s + 0.001,
            dialect.MAVLink_gimbal_device_attitude_status_message(
                0, 0, _ms(boot_s), flags, list(q), 0.0, 0.0, 0.0, 0, float(yaw), float("nan"), 1
            ),
        )


def _chatter(log: Recording, dialect: Any, rng: np.random.Generator) -> Iterator[tuple[float, Any]]:
    """What an autopilot sends besides."""
    for t in _every(log, 1.0, 0.207):
        yield t, dialect.MAVLink_heartbeat_message(2, 3, 217, 4, 4, 3)
        cells = [*rng.integers(3780, 3860, 6).tolist(), *[65535] * 4]
        yield t + 0.1, dialect.MAVLink_battery_status_message(0, 1, 1, 3120, cells, 1830, 2210, 1700, 71)
    for t in _every(log, 0.5, 0.061):
        yield t, dialect.MAVLink_sys_status_message(0x1FF0, 0x1FF0, 0x1FF0, 312, 22850, 1830, 71, 0, 0, 0, 0, 0, 0)
        yield t + 0.004, dialect.MAVLink_power_status_message(5012, 4987, 3)
        yield t + 0.008, dialect.MAVLink_meminfo_message(0, 65535, 131072)
        yield t + 0.012, dialect.MAVLink_vibration_message(round(t * 1e6), *rng.uniform(3, 14, 3).tolist(), 0, 0, 0)
        yield t + 0.016, dialect.MAVLink_nav_controller_output_message(-3.1, -4.2, 74, 74, 120, 0.3, 0.0, 0.4)
        yield t + 0.020, dialect.MAVLink_mission_current_message(3)
    for t in _every(log, 0.25, 0.033):
        yield t, dialect.MAVLink_vfr_hud_message(6.1, 6.2, 74, 46, 271.5, 0.1)
        sticks = rng.integers(1490, 1511, 8).tolist()
        yield t + 0.002, dialect.MAVLink_rc_channels_message(_ms(t), 8, *sticks, *[0] * 10, 212)
        yield (
            t + 0.006,
            dialect.MAVLink_servo_output_raw_message(round(t * 1e6), 0, *rng.integers(1380, 1620, 8).tolist()),
        )
        shake = rng.integers(-60, 60, 6).tolist()
        yield t + 0.009, dialect.MAVLink_scaled_imu2_message(_ms(t), *shake, 210, -40, 420)
    start = float(log.attitude_boot_s[0])
    for k, (name, value) in enumerate(_PARAMETERS):
        yield start + 0.05 + 0.03 * k, dialect.MAVLink_param_value_message(name, value, 9, 1187, 301 + k)
    for after_s, text in _TEXTS:
        yield start + after_s, dialect.MAVLink_statustext_message(6, text)


_PARAMETERS = ((b"SYSID_THISMAV", 1.0), (b"AHRS_GPS_GAIN", 1.0), (b"EK3_SRC1_POSXY", 3.0), (b"MNT1_TYPE", 8.0),
               (b"CAM1_TYPE", 5.0), (b"SR0_POSITION", 10.0), (b"SR0_EXTRA1", 50.0))  # fmt: skip
_TEXTS = ((0.4, b"EKF3 IMU0 is using GPS"), (2.1, b"Mission: 3 WP"), (5.6, b"Reached command #3"))


def _others(log: Recording, dialect: Any) -> Iterator[Event]:
    """The ground station and its radio, which are in the same log."""
    for t in _every(log, 1.0, 0.55):
        yield t, GROUND_STATION, dialect.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3)
        yield t + 0.05, RADIO, dialect.MAVLink_radio_status_message(182, 176, 96, 43, 41, 0, 0)
    for t in _every(log, 10.0, 3.3):
        yield t, GROUND_STATION, dialect.MAVLink_timesync_message(0, round(t * 1e9))
