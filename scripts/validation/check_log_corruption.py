#!/usr/bin/env python
"""Breaks logs in a thousand ways and reads them; beside pymavlink. With --fuzz MINUTES: every reader, any damage.

A message is wrong when it is not one of the whole log's. A DataFlash log has no checksum: a bit flipped inside a
message's own bytes cannot be seen by any reader, so there a message that stands where one stood, hit in place, is
counted as "hit", not as wrong.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
from pymavlink import DFReader, mavutil

from calibration.foundation.errors import InputFileError
from pipeline.synthetic.dataflash_log import dataflash_bytes
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.synthetic.instruments import LogClock, record
from pipeline.synthetic.mavlink_log import tlog_bytes
from pipeline.synthetic.simulate import DEMO
from pipeline.telemetry import inspect_log, read_log, read_pose_table
from pipeline.telemetry.dataflash.messages.layout import layouts_of
from pipeline.telemetry.dataflash.messages.read import read_dataflash
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from scripts.validation.figures import tell

KINDS = ("bit flips", "inserted garbage", "dropped bytes", "cut frames", "truncation")
HANG_S, MEMORY_BYTES = 30, 3 << 30
SEED = [77]
SRT = "1\n00:00:0{i},000 --> 00:00:0{i},900\n[latitude: 41.5] [longitude: 2.25] [rel_alt: 5.4 abs_alt: 117.0]\n\n"


def broken(content: bytes, rng: np.random.Generator, kind: str, spans: list[tuple[int, int]], first: int) -> bytes:
    """`content` damaged from byte `first` on, up to 20 times in one way; `spans` are its messages."""
    data, times = bytearray(content), int(rng.integers(1, 21))
    if kind == "truncation":
        return bytes(data[: int(rng.integers(first, len(data)))])
    if kind == "cut frames":  # as a radio link or a full card does it; from the back, so that places stay true
        for start, size in sorted({spans[int(i)] for i in rng.integers(len(spans), size=times)}, reverse=True):
            if start >= first:
                del data[start + int(rng.integers(1, size)) : start + size]
        return bytes(data)
    for _ in range(times):
        at = int(rng.integers(first, len(data) - 200))
        if kind == "bit flips":
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == "inserted garbage":
            data[at:at] = rng.integers(0, 256, int(rng.integers(1, 300)), dtype=np.uint8).tobytes()
        else:
            del data[at : at + int(rng.integers(1, 4))]
    return bytes(data)


@contextmanager
def silence() -> Iterator[None]:
    """Nothing reaches standard output and error: DFReader speaks from C too."""
    kept = os.dup(1), os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    sys.stdout.flush()
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        sys.stdout.flush()
        for one, to in zip(kept, (1, 2), strict=True):
            os.dup2(one, to)
            os.close(one)
        os.close(nothing)


# --- what each reader finds ----------------------------------------------------------------------------------------


def tlog_names() -> tuple[str, ...]:
    """Every message of the dialect."""
    return tuple(message.msgname for message in mavutil.mavlink.mavlink_map.values())


def our_tlog(path: Path, names: tuple[str, ...]) -> Counter[bytes]:
    """Every message that ours finds, by its values and sender."""
    found: Counter[bytes] = Counter()
    for name, table in read_mavlink_fast(path, wanted=names).tables.items():
        sender = np.stack([table.system, table.component], axis=1).astype(np.uint8)
        columns = [np.ascontiguousarray(c).reshape(len(table), -1).view(np.uint8).reshape(len(table), -1)
                   for c in table.columns.values()]  # fmt: skip
        rows = np.concatenate([sender, *columns], axis=1)
        found.update(name.encode() + row.tobytes() for row in rows)
    return found


def their_tlog(path: Path) -> Counter[bytes]:
    """Every packet that pymavlink's own log reader finds, by its bytes."""
    link = mavutil.mavlink_connection(str(path), robust_parsing=True)
    found: Counter[bytes] = Counter()
    while (message := link.recv_msg()) is not None:
        if message.get_type() != "BAD_DATA":
            found[bytes(message.get_msgbuf())] += 1
    return found


def our_bin(content: bytes, path: Path) -> Counter[bytes]:
    """Every message that ours finds, by its bytes."""
    kinds = {layout.name: layout for layout in layouts_of(content, upto=len(content)).values()}
    found: Counter[bytes] = Counter()
    for name, table in read_dataflash(path, wanted=tuple(kinds)).tables.items():
        length = kinds[name].length
        found.update(content[at : at + length] for at in table.place.tolist())
    return found


def their_bin(content: bytes, path: Path) -> Counter[bytes]:
    """Every message that DFReader finds, by its bytes."""
    found: Counter[bytes] = Counter()
    with silence():
        reader = DFReader.DFReader_binary(str(path))
        reader.rewind()
        while (message := reader.recv_msg()) is not None:
            found[content[reader.offset - message.fmt.len : reader.offset]] += 1
        reader.close()
    return found


def good(found: Counter[bytes], true: Counter[bytes]) -> int:
    """How many of the found are true."""
    return (found & true).total()


def bin_hit(found: Counter[bytes], true: Counter[bytes], content: bytes, whole: bytes, kind: str) -> int:
    """Messages in `found` that are no message of the whole log but stand where one stood, with bits changed."""
    if kind != "bit flips":
        return 0
    return sum(many for message, many in (found - true).items() if hit_in_place(message, content, whole))


def hit_in_place(message: bytes, content: bytes, whole: bytes) -> bool:
    """Whether a message stands where one of its kind stood."""
    at = content.find(message)
    return at >= 0 and whole[at : at + 3] == message[:3]


# --- the two checks ------------------------------------------------------------------------------------------------


def check_corruptions(folder: Path, runs: int, only: str) -> bool:
    """The table of corruptions; `only` names logs or kinds of damage, or is empty."""
    tlog, binary = written_logs()
    fine = True
    print(f"{'log':<10}{'damage':<18}{'runs':>6}{'crashes':>9}{'wrong':>7}{'hit':>6}{'fewer than pymavlink':>22}"
          f"{'ours good':>11}{'theirs':>9}{'theirs wrong':>14}")  # fmt: skip
    for what, whole in (("tlog", tlog), ("dataflash", binary)):
        for k, kind in enumerate(KINDS):
            if only and only not in (what, kind):
                continue
            tally: Counter[str] = Counter()
            for run in range(k, runs, len(KINDS)):
                one_corruption(folder, what, whole, kind, run, tally)
            tell({f"{what}, {kind}": dict(tally)})
            fine &= not (tally["crash"] or tally["wrong"] or tally["fewer"])
            print(f"{what:<10}{kind:<18}{tally['runs']:>6}{tally['crash']:>9}{tally['wrong']:>7}{tally['hit']:>6}"
                  f"{tally['fewer']:>22}{tally['ours']:>11}{tally['theirs']:>9}"
                  f"{tally['theirs wrong']:>14}", flush=True)  # fmt: skip
    return fine


_WHOLE: dict[str, tuple[Counter[bytes], Counter[bytes], list[tuple[int, int]], int]] = {}


def one_corruption(folder: Path, what: str, whole: bytes, kind: str, run: int, tally: Counter[str]) -> None:
    """Damages once, reads with both, and counts."""
    path = folder / ("a.tlog" if what == "tlog" else "a.bin")
    if what not in _WHOLE:
        path.write_bytes(whole)
        _WHOLE[what] = whole_log(path, what, whole)
    ours_true, theirs_true, spans, first = _WHOLE[what]
    content = broken(whole, np.random.default_rng([run, SEED[0]]), kind, spans, first)
    path.write_bytes(content)
    tally["runs"] += 1
    try:
        ours = our_tlog(path, tlog_names()) if what == "tlog" else our_bin(content, path)
    except Exception as error:
        print(f"crash: {what}, {kind}, run {run}: {error!r}")
        tally["crash"] += 1
        return
    theirs = their_tlog(path) if what == "tlog" else their_bin(content, path)
    hit = 0 if what == "tlog" else bin_hit(ours, ours_true, content, whole, kind)
    tally["hit"] += hit
    wrong = (ours - ours_true).total() - hit
    if wrong and len(sys.argv) > 1 and "--show" in sys.argv:
        print(f"wrong: {what}, {kind}, run {run}: {(ours - ours_true).most_common(3)}")
    tally["wrong"] += wrong
    mine, its = good(ours, ours_true) + hit, good(theirs, theirs_true)
    if what != "tlog":
        its += bin_hit(theirs, theirs_true, content, whole, kind)
    if mine < its and "--show" in sys.argv:
        print(f"fewer: {what}, {kind}, run {run}: {mine} < {its}")
    tally["fewer"] += mine < its
    tally["ours"] += mine
    tally["theirs"] += its
    tally["theirs wrong"] += (theirs - theirs_true).total() - (
        0 if what == "tlog" else bin_hit(theirs, theirs_true, content, whole, kind)
    )


def whole_log(path: Path, what: str, whole: bytes) -> tuple[Counter[bytes], Counter[bytes], list[tuple[int, int]], int]:
    """Both readers' messages of the whole log, where messages stand, and the first byte that may be damaged."""
    if what == "tlog":
        spans, at = [], 0
        while at < len(whole):
            size = 8 + 12 + whole[at + 9]
            spans.append((at + 8, size - 8))
            at += size
        return our_tlog(path, tlog_names()), their_tlog(path), spans, 0
    kinds = layouts_of(whole, upto=len(whole))
    spans, at = [], 0
    while at < len(whole):
        spans.append((at, kinds[whole[at + 2]].length))
        at += spans[-1][1]
    first = next(at for at, _ in spans if whole[at + 2] != 128)  # without its definitions no reader knows a message
    return our_bin(whole, path), their_bin(whole, path), spans, first


def written_logs() -> tuple[bytes, bytes]:
    """The small flight in both formats."""
    scene = small_scene()
    clock = LogClock(boot_zero_s=412.345, utc_zero_s=1748770200.0, recorder_zero_s=1748770200.0)
    seen = record(scene.cameras[0], scene.origin, clock, noise=DEMO, rng=np.random.default_rng(3))
    return tlog_bytes(seen, system=1, seed=1), dataflash_bytes(seen)


def ulog_bytes() -> bytes:
    """A small PX4 log: header, definition, subscription, data."""
    import struct

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    out += message(b"B", bytes(40))
    out += message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    out += message(b"F", b"vehicle_global_position:uint64_t timestamp;double lat;double lon;float alt;")
    out += message(b"A", b"\0" + struct.pack("<H", 0) + b"vehicle_attitude")
    out += message(b"A", b"\0" + struct.pack("<H", 1) + b"vehicle_global_position")
    for i in range(200):
        us = 1_000_000 + 20_000 * i
        out += message(b"D", struct.pack("<HQ4f", 0, us, 1.0, 0.0, 0.0, 0.0))
        out += message(b"D", struct.pack("<HQddf", 1, us, 28.2, 112.9, 60.0))
    return out


def seeds() -> dict[str, bytes]:
    """One whole file of each kind."""
    tlog, binary = written_logs()
    text = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 131, 30, ATT, Qfff, TimeUS,Roll,Pitch,Yaw\n"
    text += "FMT, 133, 30, POS, QLLf, TimeUS,Lat,Lng,Alt\n"
    text += "".join(f"ATT, {i * 20000}, 1.0, 2.0, {i % 360}\nPOS, {i * 20000}, 28.2, 112.9, 60\n" for i in range(200))
    table = "time_s,east_m,north_m,up_m,qw,qx,qy,qz\n" + "".join(f"{i},0,0,0,1,0,0,0\n" for i in range(50))
    raw, at = b"", 0
    while at < len(tlog):
        raw, at = raw + tlog[at + 8 : at + 20 + tlog[at + 9]], at + 20 + tlog[at + 9]
    found = {
        "a.tlog": tlog, "a.mavlink": raw, "a.bin": binary, "a.log": text.encode(), "a.ulg": ulog_bytes(),
        "a.srt": "".join(SRT.format(i=i) for i in range(9)).encode(), "a.csv": table.encode(),
    }  # fmt: skip
    try:
        import io

        import pandas as pd

        out = io.BytesIO()
        pd.read_csv(io.StringIO(table)).to_parquet(out)
        found["a.parquet"] = out.getvalue()
    except ImportError:
        print("parquet is not fuzzed: the extra `parquet` is not installed")
    return found


def mangled(content: bytes, rng: np.random.Generator) -> bytes:
    """Any damage, any amount of it."""
    data = bytearray(content)
    for _ in range(int(2 ** rng.uniform(0, 9))):
        at, kind = int(rng.integers(len(data) + 1)), int(rng.integers(6))
        reach = int(2 ** rng.uniform(0, 9))
        if kind == 0 and at < len(data):
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[at:at] = rng.integers(0, 256, reach, dtype=np.uint8).tobytes()
        elif kind == 2:
            del data[at : at + reach]
        elif kind == 3:
            data[at : at + reach] = bytes([int(rng.choice([0, 255, 0xFD, 0xFE, 0xA3, 10, 45]))]) * reach
        elif kind == 4:
            source = int(rng.integers(len(content)))
            data[at:at] = content[source : source + reach]
        elif rng.random() < 0.1:
            del data[at:]
        if not data:
            break
    return bytes(data)


class Hang(BaseException):
    """A read that takes too long; no reader catches it."""


def fuzz(folder: Path, minutes: float) -> bool:
    """Every reader on mangled files until the time is over: read, or refused in words, never anything else."""

    def too_long(*_: object) -> None:
        raise Hang(f"more than {HANG_S} s")

    signal.signal(signal.SIGALRM, too_long)
    whole, tally, rng = seeds(), Counter(), np.random.default_rng(int(minutes * 60))
    for name, content in whole.items():  # compile before memory is measured
        (folder / name).write_bytes(content)
        read_any(folder / name)
    before_kb, end = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic() + 60 * minutes
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))
    names, slowest = list(whole), 0.0
    while time.monotonic() < end:
        name = names[int(rng.integers(len(names)))]
        content = mangled(whole[name], rng)
        (folder / name).write_bytes(content)
        begin = time.perf_counter()
        signal.alarm(HANG_S)
        try:
            read_any(folder / name)
            tally[name, "read"] += 1
        except InputFileError:
            tally[name, "refused"] += 1
        except (Exception, Hang) as error:
            tally[name, "CRASH"] += 1
            kept = Path(tempfile.gettempdir()) / f"fuzz-{sum(tally.values())}-{name}"
            kept.write_bytes(content)
            print(f"{name}: {error!r}, kept as {kept}", flush=True)
        signal.alarm(0)
        slowest = max(slowest, time.perf_counter() - begin)
    more_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024
    print(f"\n{minutes:g} minutes, slowest read {slowest:.2f} s, memory grew by {more_mb:.0f} MB")
    tell({"minutes": minutes, "slowest_s": slowest, "memory_growth_mb": more_mb, "files": sum(tally.values()),
          "crashed": sum(many for (_, what), many in tally.items() if what == "CRASH")})  # fmt: skip
    print(f"{'file':<12}{'read':>8}{'refused':>9}{'crashed':>9}")
    for name in names:
        print(f"{name:<12}{tally[name, 'read']:>8}{tally[name, 'refused']:>9}{tally[name, 'CRASH']:>9}")
    return not any(many for (_, what), many in tally.items() if what == "CRASH")


def read_any(path: Path) -> None:
    """Reads a file as its name says."""
    if path.suffix in (".csv", ".parquet"):
        read_pose_table(path)
    else:
        inspect_log(read_log(path))


def main() -> int:
    """Runs what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="corruptions of each log (default 1000)")
    parser.add_argument("--fuzz", type=float, default=0.0, metavar="MINUTES", help="instead: fuzz every reader")
    parser.add_argument("--only", default="", help="one log (tlog, dataflash) or one kind of damage ('cut frames' ...)")
    parser.add_argument("--seed", type=int, default=SEED[0], help="of the damages (default 77)")
    parser.add_argument("--show", action="store_true", help="say where a message was wrong or missed")
    arguments = parser.parse_args()
    SEED[0] = arguments.seed
    with tempfile.TemporaryDirectory() as folder:
        if arguments.fuzz:
            fine = fuzz(Path(folder), arguments.fuzz)
        else:
            fine = check_corruptions(Path(folder), arguments.runs, arguments.only)
    print("fine" if fine else "NOT fine")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
