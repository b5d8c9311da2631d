#!/usr/bin/env python
"""Log readers beside pymavlink's, in one run: warm and in fresh processes, with the values compared; and a 1 GB log.

python -m scripts.validation.bench_telemetry            # 20-minute .tlog and 30 MB DataFlash, warm, cold, identity
python -m scripts.validation.bench_telemetry --large    # position, attitude and gimbal out of 1 GB, and two minutes
"""

from __future__ import annotations

import argparse
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

os.environ["MAVLINK20"] = "1"
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from scripts.validation.figures import tell

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[2]
SECONDS = 1200.0


# --- the logs ------------------------------------------------------------------------------------------------------


def write_logs(folder: Path) -> tuple[Path, Path]:
    """A 20-minute flight as a `.tlog`, and as DataFlash with the gyros that make most of a real one."""
    from pipeline.synthetic.dataflash_log import dataflash_bytes
    from pipeline.synthetic.demo_scenes import small_scene
    from pipeline.synthetic.instruments import LogClock, record
    from pipeline.synthetic.mavlink_log import tlog_bytes
    from pipeline.synthetic.scene import Path as Way
    from pipeline.synthetic.simulate import DEMO

    scene = small_scene()
    camera, at = scene.cameras[0], np.arange(-10.0, SECONDS + 10.0, 0.1)
    short = camera.platform
    inside = 4.0 + 4.0 * np.sin(at / 4.0)  # the small flight again and again, smoothly
    assert short.gimbal_rad is not None
    platform = replace(
        short,
        position_enu_m=Way(time_s=at, value=short.position_enu_m(inside)),
        yaw_pitch_roll_rad=Way(time_s=at, value=short.yaw_pitch_roll_rad(inside)),
        gimbal_rad=Way(time_s=at, value=short.gimbal_rad(inside)),
    )
    camera = replace(camera, platform=platform, frames=int((SECONDS - 7.0) * 25))
    clock = LogClock(boot_zero_s=100.0, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0)
    seen = record(camera, scene.origin, clock, noise=DEMO, rng=np.random.default_rng(1))
    tlog, binary = folder / "flight.tlog", folder / "flight.bin"
    tlog.write_bytes(tlog_bytes(seen, system=1, seed=1))
    binary.write_bytes(with_gyros(dataflash_bytes(seen)))
    return tlog, binary


def with_gyros(content: bytes) -> bytes:
    """IMU at 400 Hz between a DataFlash log's own messages."""
    from pipeline.telemetry.dataflash.messages.layout import layouts_of

    kinds = layouts_of(content, upto=len(content))
    form = struct.Struct("<QBfffffffBBHH")
    head = b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 200, form.size + 3, b"IMU", b"QBfffffffBBHH",
                                         b"TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T,EG,EA,GH,AH")  # fmt: skip
    out, at, rng = [head], 0, np.random.default_rng(2)
    shake = rng.normal(size=(1000, 7))
    count = 0
    while at < len(content):
        layout = kinds[content[at + 2]]
        out.append(content[at : at + layout.length])
        if layout.name == "ATT":
            us = struct.unpack_from("<Q", content, at + 3)[0]
            for i in range(8):
                out.append(b"\xa3\x95\xc8" + form.pack(us + 2500 * i, 0, *shake[count % 1000], 0, 0, 1, 1))
                count += 1
        at += layout.length
    return b"".join(out)


# --- readers -------------------------------------------------------------------------------------------------------


def ours_tlog(path: Path) -> object:
    """Wanted messages as columns."""
    from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast

    return read_mavlink_fast(path)


def ours_tlog_poses(path: Path) -> object:
    """The whole FlightLog."""
    from pipeline.telemetry import read_log

    return read_log(path)


def ours_bin(path: Path) -> object:
    """Wanted messages as columns."""
    from pipeline.telemetry.dataflash.messages.read import read_dataflash

    return read_dataflash(path)


def theirs_tlog(path: Path) -> list[object]:
    """The same messages by pymavlink."""
    from pymavlink import mavutil

    from pipeline.telemetry.mavlink.packets.names import WANTED

    link, found = mavutil.mavlink_connection(str(path)), []
    while (message := link.recv_match(type=list(WANTED))) is not None:
        found.append(message)
    return found


def theirs_bin(path: Path) -> list[object]:
    """The same messages by DFReader."""
    from pymavlink import DFReader

    from pipeline.telemetry.dataflash.messages.read import WANTED

    reader, found = DFReader.DFReader_binary(str(path)), []
    while (message := reader.recv_match(type=list(WANTED))) is not None:
        found.append(message)
    return found


def warm(path: Path, readers: dict[str, Callable[[Path], object]], rounds: int) -> dict[str, float]:
    """CPU seconds of each reader, the median of interleaved rounds; the slow last one is read in fewer.

    Warm: every reader has been through the log once or twice, and the compiled loops are loaded.
    """
    for read in readers.values():
        read(path)
    seconds: dict[str, list[float]] = {name: [] for name in readers}
    for _ in range(rounds):
        for name, read in readers.items():
            for _ in range(1 if name == "pymavlink" else 3):
                begin = time.process_time()
                read(path)
                seconds[name].append(time.process_time() - begin)
    return {name: statistics.median(many) for name, many in seconds.items()}


COLD = {
    "ours, whole log to poses": "from pathlib import Path\nfrom pipeline.telemetry import read_log\n"
    "read_log(Path({path!r}))",
    "pymavlink": "from pathlib import Path\nfrom scripts.validation import bench_telemetry as b\n"
    "b.theirs_{kind}(Path({path!r}))",
}


def cold(path: Path, kind: str, rounds: int) -> dict[str, float]:
    """CPU seconds of a fresh process that reads the log, compiled code cached, Python's own too, for both."""
    seconds: dict[str, list[float]] = {name: [] for name in COLD}
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    kept["PYTHONPYCACHEPREFIX"] = str(path.parent / "bytecode")
    for turn in range(rounds + 1):
        for name, code in COLD.items():
            before = os.times()
            source = code.format(path=str(path), kind=kind)
            subprocess.run([sys.executable, "-c", source], check=True, cwd=ROOT, env=kept)
            after = os.times()
            if turn:  # the first one fills the caches
                seconds[name].append(
                    after.children_user + after.children_system - before.children_user - before.children_system
                )
    return {name: statistics.median(many) for name, many in seconds.items()}


# --- identity ------------------------------------------------------------------------------------------------------


def differing(ours: object, theirs: list[object]) -> tuple[int, int]:
    """Values compared, and values that differ, over every field of every message."""
    by_name: dict[str, list[object]] = {}
    for message in theirs:
        by_name.setdefault(message.get_type(), []).append(message)
    compared = wrong = 0
    for name, found in by_name.items():
        table = ours.tables[name]
        if len(table) != len(found):
            return compared, max(1, wrong)
        for column, mine in table.columns.items():
            its = [getattr(m, column) for m in found]
            if mine.dtype.kind == "S":
                texts = [v if isinstance(v, bytes) else v.encode("utf-8", "replace") for v in its]
                pairs = zip(mine.tolist(), texts, strict=True)
                same = np.array([a.split(b"\0")[0] == b.split(b"\0")[0] for a, b in pairs])
            else:
                array = np.array([list(v) if hasattr(v, "__len__") else v for v in its])
                same = (mine == array) | ((mine != mine) & (array != array))
            compared, wrong = compared + same.size, wrong + int((~same).sum())
    return compared, wrong


def compare(folder: Path, rounds: int) -> bool:
    """The table of the two logs."""
    tlog, binary = write_logs(folder)
    fine = True
    print(f"{'log':<12}{'reader':<28}{'CPU s':>9}{'times':>8}")
    for path, kind, readers in (
        (tlog, "tlog", {"ours": ours_tlog, "ours, whole log to poses": ours_tlog_poses, "pymavlink": theirs_tlog}),
        (binary, "bin", {"ours": ours_bin, "ours, whole log to poses": ours_tlog_poses, "pymavlink": theirs_bin}),
    ):
        ours, theirs = readers["ours"](path), readers["pymavlink"](path)
        compared, wrong = differing(ours, theirs)
        label = f"{path.suffix} {path.stat().st_size / 1e6:.0f} MB"
        for how, seconds in (("warm", warm(path, readers, rounds)), ("cold", cold(path, kind, rounds))):
            for name, value in seconds.items():
                print(f"{label:<12}{how + ', ' + name:<28}{value:>9.3f}{seconds['pymavlink'] / value:>8.1f}")
            first = next(iter(seconds.values()))
            tell({f"{kind} {how} {name}": seconds["pymavlink"] / value for name, value in seconds.items()})
            fine &= seconds["pymavlink"] / first >= (50 if how == "warm" else 5)
        print(f"{label:<12}{len(theirs)} messages, {compared} values compared, {wrong} differ\n", flush=True)
        tell({f"{kind} messages": len(theirs), f"{kind} values_compared": compared, f"{kind} values_differ": wrong})
        fine &= wrong == 0
    return fine


# --- the large log -------------------------------------------------------------------------------------------------


OWN = ("ATTITUDE", "GLOBAL_POSITION_INT", "GIMBAL_DEVICE_ATTITUDE_STATUS", "GPS_RAW_INT", "SYSTEM_TIME", "AHRS2")
REST = ("POWER_STATUS", "SYS_STATUS", "MEMINFO", "MISSION_CURRENT", "FENCE_STATUS", "NAV_CONTROLLER_OUTPUT", "RAW_IMU",
        "SCALED_PRESSURE", "SCALED_IMU2", "RC_CHANNELS", "RC_CHANNELS_RAW", "SERVO_OUTPUT_RAW", "VFR_HUD", "AHRS",
        "HWSTATUS", "WIND", "SENSOR_OFFSETS", "TERRAIN_REPORT", "LOCAL_POSITION_NED", "BATTERY_STATUS")  # fmt: skip


def write_large(path: Path, size: int) -> int:
    """A `.tlog` of `size` bytes: the messages of a real link, each once in a cycle of 0.1 s; returns the cycles."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    from pipeline.telemetry.mavlink.packets.fast import layout

    by_name = {m.msgname: m for m in dialect.mavlink_map.values()}
    parts = [(by_name[name], layout(by_name[name])) for name in (*OWN, *REST)]
    cycle = sum(8 + 12 + form.itemsize for _, form in parts)
    cycles, step, rng = size // cycle, 20000, np.random.default_rng(1)
    with path.open("wb") as file:
        for first in range(0, cycles, step):
            k = np.arange(first, min(first + step, cycles))
            out, at = np.zeros((len(k), cycle), np.uint8), 0
            for number, (message, form) in enumerate(parts):
                at = packed(out, at, number, message, form, k, rng)
            file.write(out.tobytes())
    return cycles


def packed(out: np.ndarray, at: int, number: int, message, form: np.dtype, k: np.ndarray, rng) -> int:
    """One message of every cycle k into columns of `out` from `at` on; where the next begins."""
    from pipeline.telemetry.mavlink.packets.scan import CRC_TABLE

    time_s = 100.0 + 0.1 * k
    stamp = ((1748770200.0 + time_s) * 1e6 + number * 100).astype(">u8")
    out[:, at : at + 8] = stamp.view(np.uint8).reshape(-1, 8)
    body = np.zeros(len(k), form)
    body.view(np.uint8)[:] = rng.integers(1, 200, body.nbytes, dtype=np.uint8)
    says = {
        "time_boot_ms": (time_s * 1000).astype(np.uint32), "time_usec": (time_s * 1e6).astype(np.uint64),
        "time_unix_usec": ((1748770100.0 + time_s) * 1e6).astype(np.uint64), "lat": 282000000 + k % 10000,
        "lng": 1129000000, "lon": 1129000000 + k % 10000, "alt": 80000, "alt_ellipsoid": 63000, "fix_type": 3,
        "roll": 0.01, "pitch": 0.02, "yaw": np.sin(0.01 * time_s), "vx": 10, "vy": 10, "vz": 0, "altitude": 80.0,
        "h_acc": 900, "v_acc": 1500, "flags": 32, "gimbal_device_id": 1,
    }  # fmt: skip
    for name, value in says.items():
        if name in form.names:
            body[name] = value
    if "q" in form.names:
        body["q"] = [1.0, 0.0, 0.0, 0.0]
    head = np.array([0xFD, form.itemsize, 0, 0, 0, 1, 1, message.id & 255, message.id >> 8 & 255, 0], np.uint8)
    frame = np.concatenate([np.tile(head, (len(k), 1)), body.view(np.uint8).reshape(len(k), -1)], axis=1)
    frame[:, 4] = (k + number) & 255
    crc = np.full(len(k), 0xFFFF, np.uint16)
    for column in (*frame[:, 1:].T, np.full(len(k), message.crc_extra, np.uint8)):
        crc = (crc >> 8) ^ CRC_TABLE[0, (crc ^ column) & 0xFF].astype(np.uint16)
    end = at + 8 + frame.shape[1]
    out[:, at + 8 : end], out[:, end], out[:, end + 1] = frame, crc & 0xFF, crc >> 8
    return end + 2


def anonymous_mb() -> float:
    """Memory of this process that is no mapped file."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1]) / 1024


def watched(read: Callable[[], T]) -> tuple[T, float, float, float, float]:
    """What `read` gives, its seconds, CPU seconds, and this process's anonymous memory before and at most, MB."""
    peak, done = [anonymous_mb()], threading.Event()

    def watch() -> None:
        while not done.wait(0.01):
            peak.append(anonymous_mb())

    watcher = threading.Thread(target=watch)
    watcher.start()
    wall, cpu = time.perf_counter(), time.process_time()
    found = read()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    done.set()
    watcher.join()
    return found, wall, cpu, peak[0], max(peak)


def large(folder: Path, size: int) -> bool:
    """Reads two minutes of the large log, then all of it, and watches the memory."""
    from pipeline.telemetry import Excerpt, read_log

    small, big = folder / "small.tlog", folder / "big.tlog"
    write_large(small, 2_000_000)
    print(f"writing {size / 1e9:.2f} GB", flush=True)
    cycles = write_large(big, size)
    read_log(small)  # compiled and imported
    with big.open("rb") as file:  # as warm as this machine's memory allows
        while file.read(1 << 24):
            pass
    middle_s = 100.0 + 0.05 * cycles
    minutes = (Excerpt(start=middle_s, before_s=0.0, after_s=120.0),)
    part, part_s, part_cpu, before, most = watched(lambda: read_log(big, excerpts=minutes))
    print(f"two minutes: {part.bytes_read / 1e6:.1f} MB of the file, {part_s:.2f} s ({part_cpu:.2f} s CPU), memory"
          f" beyond the mapped file at most {most:.0f} MB ({before:.0f} MB before)", flush=True)  # fmt: skip
    log, wall, cpu, before, most = watched(lambda: read_log(big))
    same = all(within(one, other, part.excerpt_s) for one, other in (
        (part.position, log.position), (part.attitude, log.attitude), (part.gimbal, log.gimbal)
    ))  # fmt: skip
    print(f"the two minutes are {'' if same else 'NOT '}those of the whole log; UTC differs by"
          f" {1e3 * abs(part.utc.other_s(middle_s) - log.utc.other_s(middle_s)):.3f} ms")  # fmt: skip
    counts = [len(series.time_s) for series in (log.position, log.attitude, log.gimbal) if series is not None]
    print(f"{sum(log.counts.values())} messages, {log.corrupt_packets} corrupt; positions, attitudes, gimbal: {counts}")
    print(f"{wall:.2f} s ({cpu:.2f} s CPU), memory beyond the mapped file at most {most:.0f} MB"
          f" ({before:.0f} MB before)")  # fmt: skip
    tell({
        "messages": sum(log.counts.values()), "seconds": wall, "memory_mb": most, "part_seconds": part_s,
        "part_bytes_mb": part.bytes_read / 1e6, "same_bits": same,
    })  # fmt: skip
    return counts == [cycles] * 3 and wall < 10 and most < 500 and same and part_s < 0.2 * wall


def within(one: object, other: object, span_s: tuple[float, float]) -> bool:
    """Whether two series have the same rows, bit for bit, in a span of log time."""
    rows = [(s.time_s >= span_s[0]) & (s.time_s <= span_s[1]) for s in (one, other)]
    columns = [name for name, value in vars(one).items() if isinstance(value, np.ndarray)]
    return all(
        np.array_equal(getattr(one, name)[rows[0]], getattr(other, name)[rows[1]], equal_nan=True) for name in columns
    )


def main() -> int:
    """Runs what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="interleaved rounds (default 3)")
    parser.add_argument("--large", action="store_true", help="the large log instead")
    parser.add_argument("--gigabytes", type=float, default=1.0, help="of the large log (default 1)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.large:
            fine = large(Path(folder), int(arguments.gigabytes * 1e9))
        else:
            fine = compare(Path(folder), arguments.rounds)
    print("fine" if fine else "NOT fine")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
