"""The MAVLink messages that camera poses are made of, and how a log of them is told from a raw capture."""

from __future__ import annotations

from pathlib import Path

from pipeline.telemetry.log.mapped_file import Bytes

MARKERS = (0xFE, 0xFD)
WANTED = (
    "HEARTBEAT",
    "SYSTEM_TIME",
    "GLOBAL_POSITION_INT",
    "GPS_RAW_INT",
    "GPS2_RAW",
    "AHRS2",
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "MOUNT_ORIENTATION",
    "MOUNT_STATUS",
    "CAMERA_IMAGE_CAPTURED",
    "CAMERA_FEEDBACK",
    "CAMERA_TRIGGER",
    "ESTIMATOR_STATUS",
    "PARAM_VALUE",
    "SIMSTATE",
)

FIELDS = {
    "HEARTBEAT": ("autopilot", "type"),
    "SYSTEM_TIME": ("time_unix_usec", "time_boot_ms"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "lat", "lon", "alt", "relative_alt", "vx", "vy", "vz"),
    "GPS_RAW_INT": ("time_usec", "fix_type", "lat", "lon", "alt", "alt_ellipsoid", "h_acc", "v_acc", "hdg_acc", "yaw"),
    "GPS2_RAW": ("time_usec", "fix_type", "lat", "lon", "alt", "alt_ellipsoid", "h_acc", "v_acc", "hdg_acc", "yaw"),
    "AHRS2": ("lat", "lng", "altitude", "roll", "pitch", "yaw"),
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw"),
    "ATTITUDE_QUATERNION": ("time_boot_ms", "q1", "q2", "q3", "q4"),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": ("time_boot_ms", "flags", "q", "failure_flags", "delta_yaw", "gimbal_device_id"),
}
"""Of the messages that come often: the fields that poses are made of. Of others, all."""


def has_stamps(data: Bytes, path: Path) -> bool:
    """Whether the recorder's time stands before every packet: a marker then is at 8, not at 0."""
    if len(data) > 8 and (data[0] in MARKERS) != (data[8] in MARKERS):
        return data[8] in MARKERS
    return path.suffix.lower() == ".tlog"
