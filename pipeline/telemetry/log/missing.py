"""What to say when a log lacks what a camera pose needs: which message, and how to get it."""

from __future__ import annotations

from calibration.foundation.errors import InputFileError
from pipeline.telemetry.log.flight_log import FlightLog, LogFormat

POSITION_SOURCES: dict[LogFormat, str] = {
    "tlog": "GLOBAL_POSITION_INT, or GPS_RAW_INT with a 3D fix",
    "dataflash": "POS, or GPS with a 3D fix",
    "ulog": "vehicle_global_position, vehicle_gps_position, or vehicle_local_position with a global reference",
    "dji srt": "GPS or latitude and longitude in every subtitle",
    "flight record": "latitude, longitude and a height in its columns",
    "misb klv": "sensor latitude, longitude and a height (items 13, 14 and 15, 75 or 104)",
}
ATTITUDE_SOURCES: dict[LogFormat, str] = {
    "tlog": "ATTITUDE_QUATERNION or ATTITUDE",
    "dataflash": "ATT or XKQ",
    "ulog": "vehicle_attitude",
    "dji srt": "F.PRY (flight attitude) in every subtitle",
    "flight record": "compass_heading, pitch, roll, or OSD.yaw, OSD.pitch, OSD.roll",
    "misb klv": "platform heading, pitch and roll (items 5, 6 or 90, 7 or 91)",
}
GIMBAL_SOURCES: dict[LogFormat, str] = {
    "tlog": "GIMBAL_DEVICE_ATTITUDE_STATUS, MOUNT_ORIENTATION or MOUNT_STATUS",
    "dataflash": "MNT",
    "ulog": "gimbal_device_attitude_status or mount_orientation",
    "dji srt": "gb_yaw, gb_pitch, gb_roll or G.PRY in every subtitle",
    "flight record": "gimbal_heading and gimbal_pitch, or GIMBAL.yaw and GIMBAL.pitch",
    "misb klv": "sensor relative azimuth and elevation (items 18, 19)",
}
LIKE: dict[LogFormat, LogFormat] = {"mavlink": "tlog", "dataflash text": "dataflash"}


def missing_position(log: FlightLog, where: str) -> InputFileError:
    """No usable position."""
    return _missing(log, where, "position", POSITION_SOURCES, "record the log with GPS lock, or give poses as a .csv")


def missing_attitude(log: FlightLog, where: str) -> InputFileError:
    """No usable attitude of the vehicle."""
    return _missing(
        log, where, "attitude of the vehicle", ATTITUDE_SOURCES, "raise its stream rate, or use the log stored on board"
    )


def missing_gimbal(log: FlightLog, where: str) -> InputFileError:
    """No usable attitude of the gimbal."""
    return _missing(
        log, where, "attitude of a gimbal", GIMBAL_SOURCES, 'give the camera\'s angles as `mount` instead of "gimbal"'
    )


def _missing(log: FlightLog, where: str, what: str, sources: dict[LogFormat, str], advice: str) -> InputFileError:
    names = sources[LIKE.get(log.format, log.format)]
    there = ", ".join(list(log.counts)[:8]) + (" ..." if len(log.counts) > 8 else "")
    said = "; ".join(note for note in log.notes if "not used" in note)
    return InputFileError(
        where=where,
        seen=f"{log.path.name} has no valid {what} (messages in it: {there or 'none'}{'; ' + said if said else ''})",
        expected=names,
        advice=advice,
    )
