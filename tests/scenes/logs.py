"""Logs that the tests write: MAVLink by pymavlink's own packer, DataFlash by struct, both with known content."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.telemetry import AttitudeSeries, FlightLog, GimbalSeries, PositionSeries
from pipeline.telemetry.dataflash.messages.layout import LETTERS

RECORD_EPOCH_S = 1_700_000_000.0
BOOT_UTC_S = 1_699_999_000.0
UNDULATION_M = -20.0
PLACE = Geodetic.from_degrees(28.2, 112.9, 100.0)


class Link:
    """A link being recorded: packets of any sender, each after the recorder's time."""

    def __init__(self, *, version: int = 2, signed: bool = False, stamped: bool = True) -> None:
        self.bytes = bytearray()
        self.packets: list[bytes] = []
        self.version, self.signed, self.stamped = version, signed, stamped
        self.senders: dict[tuple[int, int], Any] = {}

    def send(self, message: Any, *, record_s: float, system: int = 1, component: int = 1) -> None:
        if (system, component) not in self.senders:
            sender = mav.MAVLink(None, srcSystem=system, srcComponent=component)
            if self.signed:
                sender.signing.secret_key = b"k" * 32
                sender.signing.sign_outgoing = True
            self.senders[system, component] = sender
        sender = self.senders[system, component]
        packet = bytes(message.pack(sender, force_mavlink1=self.version == 1))
        sender.seq = (sender.seq + 1) % 256
        stamp = struct.pack(">Q", round(record_s * 1e6) & ~3) if self.stamped else b""
        self.packets.append(stamp + packet)
        self.bytes += stamp + packet

    def save(self, path: Path) -> Path:
        path.write_bytes(self.bytes)
        return path


def fly(
    link: Link,
    *,
    seconds: float = 10.0,
    boot_s: float = 100.0,
    record_s: float = RECORD_EPOCH_S,
    system: int = 1,
    heading_deg: Callable[[float], float] = lambda t: 90.0 + 3 * t,
    own_undulation: bool = True,
    utc: bool = True,
    boot_utc_s: float = BOOT_UTC_S,
) -> None:
    """East at 10 m/s from PLACE at 10 Hz, with the chatter of a link and a ground station."""
    for i in range(round(seconds * 10) + 1):
        t, now, ms = i / 10, record_s + i / 10 + 0.03, round((boot_s + i / 10) * 1000)
        lon = round((np.degrees(PLACE.lon_rad) + np.degrees(10 * t / (6.38302e6 * np.cos(PLACE.lat_rad)))) * 1e7)
        lat, alt = round(np.degrees(PLACE.lat_rad) * 1e7), round((PLACE.height_m - UNDULATION_M) * 1000)
        yaw = np.radians((heading_deg(t) + 180) % 360 - 180)
        say = lambda m: link.send(m, record_s=now, system=system)  # noqa: B023, E731
        say(mav.MAVLink_attitude_message(ms, 0.01, -0.02, yaw, 0, 0, 0.05))
        say(mav.MAVLink_global_position_int_message(ms, lat, lon, alt, 50000, 0, 1000, 0, 9000))
        if i % 5 == 0:
            unix = round((boot_utc_s + ms / 1000) * 1e6) if utc else 0
            say(mav.MAVLink_system_time_message(unix, ms))
            over = round(PLACE.height_m * 1000) if own_undulation else 0
            say(
                mav.MAVLink_gps_raw_int_message(
                    ms * 1000, 3, lat, lon, alt, 80, 90, 1000, 9000, 14, over, 900, 1500, 300, 0, 0
                )
            )
            say(mav.MAVLink_statustext_message(6, b"all is well"))
        if i % 10 == 0:
            say(mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3))
            link.send(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), record_s=now, system=255, component=190)
            link.send(mav.MAVLink_system_time_message(1, 5), record_s=now, system=255, component=190)


def tlog(path: Path, **how: Any) -> Path:
    link = Link()
    fly(link, **how)
    return link.save(path)


KINDS: dict[str, tuple[int, str, str]] = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "GPS": (130, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "ATT": (131, "QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "POS": (132, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "IMU": (133, "QBfffffffBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T,EG,EA,GH,AH"),
    "CAM": (134, "QBH", "TimeUS,I,Img"),
    "MSG": (135, "QZ", "TimeUS,Message"),
    "ARR": (136, "Qag", "TimeUS,Samples,Half"),
}


def record(name: str, *values: Any) -> bytes:
    kind, letters, _ = KINDS[name]
    form = np.dtype([(str(i), LETTERS[letter]) for i, letter in enumerate(letters)])
    row = np.zeros(1, form)
    for i, value in enumerate(values):
        row[str(i)] = value
    return b"\xa3\x95" + bytes([kind]) + row.tobytes()


def definitions() -> list[bytes]:
    found = []
    for name, (kind, letters, columns) in KINDS.items():
        form = np.dtype([(str(i), LETTERS[letter]) for i, letter in enumerate(letters)])
        found.append(record("FMT", kind, form.itemsize + 3, name.encode(), letters.encode(), columns.encode()))
    return found


def dataflash_records(
    seconds: float = 10.0, boot_s: float = 100.0, gyro_hz: int = 50, week_s: float = 100.0
) -> list[bytes]:
    """East at 10 m/s from PLACE; GPS at 5 Hz, POS and ATT at 10 Hz, gyro as chatter."""
    found = definitions()
    for i in range(round(seconds * gyro_hz) + 1):
        t = i / gyro_hz
        us = round((boot_s + t) * 1e6)
        lon = round((np.degrees(PLACE.lon_rad) + np.degrees(10 * t / (6.38302e6 * np.cos(PLACE.lat_rad)))) * 1e7)
        lat = round(np.degrees(PLACE.lat_rad) * 1e7)
        found.append(record("IMU", us, 0, 0.01 * i, 0.0, 0.1, 0.0, 0.0, -9.81))
        if i % (gyro_hz // 10) == 0:
            found.append(record("ATT", us, 0, 57, 0, -115, 0, round((90 + 3 * t) * 100) % 36000, 0, 0))
            found.append(record("POS", us, lat, lon, PLACE.height_m, 0.0, 0.0))
        if i % (gyro_hz // 5) == 0:
            found.append(
                record("GPS", us, 0, 4, round((week_s + t) * 1000), 2300, 14, 80, lat, lon, 10000, 10, 90, 0, 0, 1)
            )
        if i % gyro_hz == 0:
            found.append(record("MSG", us, b"all is well"))
            found.append(record("ARR", us, np.arange(32) - 16, 1.5))
            found.append(record("CAM", us, 0, i // gyro_hz))
    return found


def dataflash(path: Path, **how: Any) -> Path:
    path.write_bytes(b"".join(dataflash_records(**how)))
    return path


def log_of(
    *,
    time_s: Sequence[float] = (0.0, 1.0, 2.0),
    places: Sequence[Geodetic] = (PLACE,) * 3,
    ned_from_body: Any = None,
    gimbal: Any = None,
    frame: int = 0,
) -> FlightLog:
    """A log made by hand: positions, body attitudes and gimbal attitudes at `time_s`."""
    time = np.array(time_s)
    n = len(time)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    mount = None if gimbal is None else np.broadcast_to(np.asarray(gimbal, float), (n, 4))
    return FlightLog(
        path=Path("hand.tlog"),
        format="tlog",
        position=PositionSeries(
            source="GLOBAL_POSITION_INT", datum="ellipsoid", height_from="by hand", time_s=time,
            lat_rad=np.array([p.lat_rad for p in places]), lon_rad=np.array([p.lon_rad for p in places]),
            height_m=np.array([p.height_m for p in places]), velocity_ned_mps=np.full((n, 3), np.nan),
        ),
        attitude=AttitudeSeries(
            source="ATTITUDE", time_s=time,
            ned_from_body=level if ned_from_body is None else np.broadcast_to(np.asarray(ned_from_body, float), (n, 4)),
        ),
        gimbal=None if mount is None else GimbalSeries(
            source="GIMBAL_DEVICE_ATTITUDE_STATUS", time_s=time, attitude=mount, frame=np.full(n, frame)
        ),
    )  # fmt: skip


def turned(yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Any:
    return rotation.ned_from_frd(*np.radians([yaw_deg, pitch_deg, roll_deg]))


ULOG_TYPES = {"u64": "uint64_t", "f4": "float", "f8": "double", "i1": "int8_t", "i4": "int32_t", "u1": "uint8_t",
              "u2": "uint16_t", "u4": "uint32_t", "b": "bool"}  # fmt: skip
ULOG_PACK = {"u64": "Q", "f4": "f", "f8": "d", "i1": "b", "i4": "i", "u1": "B", "u2": "H", "u4": "I", "b": "?"}


def ulog(
    path: Path,
    topics: dict[str, tuple[dict[str, str], list[dict[str, float]]]],
    *,
    info: dict[str, int] | None = None,
    parameters: dict[str, int] | None = None,
) -> Path:
    """A PX4 log packed by hand (ULog 1.0): each topic "name" or "name.instance" has fields (name -> type) and
    rows; "q" is four floats."""
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))

    def put(kind: str, body: bytes) -> None:
        out.extend(struct.pack("<HB", len(body), ord(kind)) + body)

    for key, value in (info or {}).items():
        name = f"uint64_t {key}".encode()
        put("I", bytes([len(name)]) + name + struct.pack("<Q", value))
    for key, value in (parameters or {}).items():
        name = f"int32_t {key}".encode()
        put("P", bytes([len(name)]) + name + struct.pack("<i", value))
    bare = {name.split(".")[0]: fields for name, (fields, _) in topics.items()}
    for name, fields in bare.items():
        members = {"timestamp": "u64", **fields}
        declared = (f"float[4] {f[:-3]};" if t == "q" else f"{ULOG_TYPES[t]} {f};" for f, t in members.items())
        put("F", (name + ":" + "".join(declared)).encode())
    rows = []
    for number, (name, (fields, found)) in enumerate(topics.items()):
        base, _, instance = name.partition(".")
        put("A", struct.pack("<BH", int(instance or 0), number) + base.encode())
        form = "<HQ" + "".join("4f" if t == "q" else ULOG_PACK[t] for t in fields.values())
        for row in found:
            values = [v for f, t in fields.items() for v in (row[f] if t == "q" else [row[f]])]
            rows.append((row["t"], struct.pack(form, number, round(row["t"] * 1e6), *values)))
    for _, body in sorted(rows, key=lambda r: r[0]) if not (info or {}).get("unsorted") else rows:
        put("D", body)
    path.write_bytes(out)
    return path
