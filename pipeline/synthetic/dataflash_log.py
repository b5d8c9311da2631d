"""The same recording as an ArduPilot DataFlash `.bin`: every message is A3 95 type, then its fields without padding.

FMT messages (type 128) describe the others: type, length, name, a letter per field, labels. Letters c, C and e are
hundredths, L is 1e-7 degrees. GPA.Und is ArduPilot's: mean sea level minus ellipsoid height, the geoid's sign reversed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.geometry import rotation
from pipeline.synthetic.instruments import UNDULATION_M, Recording

HEAD = b"\xa3\x95"
FORMAT_TYPE = 128
GPS_EPOCH_S, LEAP_S, WEEK_S = 315964800, 18, 604800
GROUND_M = 60.0
PACKED = {"B": "B", "H": "H", "I": "I", "Q": "Q", "f": "f", "L": "i", "c": "h", "C": "H", "e": "i", "N": "16s",
          "n": "4s", "Z": "64s"}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Format:
    kind: int
    name: str
    letters: str
    labels: str

    @property
    def packer(self) -> struct.Struct:
        return struct.Struct("<" + "".join(PACKED[letter] for letter in self.letters))


FORMATS = {
    f.name: f
    for f in (
        _Format(kind=FORMAT_TYPE, name="FMT", letters="BBnNZ", labels="Type,Length,Name,Format,Columns"),
        _Format(kind=129, name="PARM", letters="QNff", labels="TimeUS,Name,Value,Default"),
        _Format(kind=130, name="MSG", letters="QZ", labels="TimeUS,Message"),
        _Format(
            kind=131,
            name="GPS",
            letters="QBBIHBcLLeffffB",
            labels="TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        ),
        _Format(kind=132, name="GPA", letters="QBCCCCfBIHfHH",
                labels="TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und,RTCMFU,RTCMFD"),
        _Format(kind=133, name="POS", letters="QLLfff", labels="TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
        _Format(
            kind=134,
            name="ATT",
            letters="QffffffB",
            labels="TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF",
        ),
        _Format(
            kind=135,
            name="MNT",
            letters="QBffffffff",
            labels="TimeUS,I,DesRoll,Roll,DesPitch,Pitch,DesYawB,YawB,DesYawE,YawE",
        ),
        _Format(
            kind=136,
            name="CAM",
            letters="QBHIHLLeeeccC",
            labels="TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt,R,P,Y",
        ),
    )
}  # fmt: skip


def dataflash_bytes(recording: Recording) -> bytes:
    """The whole log; messages in the order of their times."""
    out = [_described(f) for f in FORMATS.values()]
    rows = sorted(_rows(recording), key=lambda row: row[0])
    for boot_s, name, fields in rows:
        out.append(_packed(FORMATS[name], (round(boot_s * 1e6), *fields)))
    return b"".join(out)


def _packed(form: _Format, fields: tuple[object, ...]) -> bytes:
    return HEAD + bytes([form.kind]) + form.packer.pack(*fields)


def _described(form: _Format) -> bytes:
    length = form.packer.size + len(HEAD) + 1
    words = (form.kind, length, form.name.encode(), form.letters.encode(), form.labels.encode())
    return _packed(FORMATS["FMT"], words)


def _rows(log: Recording) -> Iterator[tuple[float, str, tuple[object, ...]]]:
    start = float(log.attitude_boot_s[0])
    yield start, "MSG", (b"ArduCopter V4.5.7",)
    yield start, "PARM", (b"AHRS_ORIENTATION", 0.0, 0.0)
    yield from _positions(log)
    yield from _attitudes(log)
    first = log.first_frame_s
    k = int(np.argmin(np.abs(log.position_boot_s - first)))
    lat, lon, sea_m = _place(log, k)
    week, millisecond = _gps_time(log, first)
    yaw, pitch, roll = np.degrees(rotation.yaw_pitch_roll(log.ned_from_body))[
        int(np.argmin(np.abs(log.attitude_boot_s - first)))
    ]
    above = round((log.lat_lon_height[k, 2] - GROUND_M) * 100)
    angles = (round(roll * 100), round(pitch * 100), round(yaw % 360 * 100))
    yield (
        first,
        "CAM",
        (0, 0, millisecond, week, lat, lon, round(sea_m * 100), above, round(sea_m * 100), *angles),
    )


def _positions(log: Recording) -> Iterator[tuple[float, str, tuple[object, ...]]]:
    accuracy = round(100 * max(log.noise.position_bias_m, 0.01))
    for k, boot_s in enumerate(log.position_boot_s):
        lat, lon, sea_m = _place(log, k)
        above = log.lat_lon_height[k, 2] - GROUND_M
        yield boot_s, "POS", (lat, lon, sea_m, above, above)
        if k % 2 == 0:
            north, east, down = log.velocity_ned_mps[k]
            week, millisecond = _gps_time(log, boot_s)
            course = float(np.degrees(np.arctan2(east, north)) % 360)
            motion = (float(np.hypot(north, east)), course, down, 0.0)
            yield boot_s, "GPS", (0, 3, millisecond, week, 17, 72, lat, lon, round(sea_m * 100), *motion, 1)
            yield boot_s, "GPA", (0, 118, accuracy, accuracy, 18, 0.0, 1, _ms(boot_s), 200, -UNDULATION_M, 0, 0)


def _attitudes(log: Recording) -> Iterator[tuple[float, str, tuple[object, ...]]]:
    body = np.degrees(rotation.yaw_pitch_roll(log.ned_from_body))
    for boot_s, (yaw, pitch, roll) in zip(log.attitude_boot_s, body, strict=True):
        yield boot_s, "ATT", (roll, roll, pitch, pitch, yaw % 360, yaw % 360, 3)
    if log.ned_from_gimbal is None:
        return
    mount = np.degrees(rotation.yaw_pitch_roll(log.ned_from_gimbal))
    for boot_s, heading, (yaw, pitch, roll) in zip(log.attitude_boot_s, body[:, 0], mount, strict=True):
        from_body = (yaw - heading + 180) % 360 - 180
        yield boot_s, "MNT", (0, roll, roll, pitch, pitch, from_body, from_body, yaw, yaw)


def _place(log: Recording, k: int) -> tuple[int, int, float]:
    lat, lon, height = log.lat_lon_height[k]
    return round(float(np.degrees(lat)) * 1e7), round(float(np.degrees(lon)) * 1e7), float(height - UNDULATION_M)


def _ms(boot_s: float) -> int:
    return round(boot_s * 1000)


def _gps_time(log: Recording, boot_s: float) -> tuple[int, int]:
    """Week and milliseconds; zero where the receiver never learned the time."""
    if log.clock.utc_zero_s is None:
        return 0, 0
    since = boot_s - log.clock.boot_zero_s + log.clock.utc_zero_s - GPS_EPOCH_S + LEAP_S
    return int(since // WEEK_S), round(since % WEEK_S * 1000)
