"""Broken logs: nothing that comes out was not in the whole log, nothing crashes, little is lost."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.foundation.errors import InputFileError
from pipeline.telemetry import read_log
from pipeline.telemetry.dataflash.messages.read import read_dataflash, read_dataflash_text
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from pipeline.telemetry.mavlink.packets.plain import read_mavlink_plain
from tests.scenes.logs import Link, dataflash_records, fly

KINDS = ("flip", "insert", "drop", "cut", "end")
MESSAGES = ("ATTITUDE", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "SYSTEM_TIME", "HEARTBEAT")


def broken(content: bytes, rng: np.random.Generator, kind: str, times: int) -> bytes:
    """`content` damaged in one way, `times` times."""
    data = bytearray(content)
    for _ in range(times):
        at = int(rng.integers(200, len(data) - 60))
        if kind == "flip":
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == "insert":
            data[at:at] = rng.integers(0, 256, int(rng.integers(1, 60)), dtype=np.uint8).tobytes()
        elif kind == "drop":
            del data[at : at + 1]
        elif kind == "cut":
            del data[at : at + int(rng.integers(2, 50))]
    return bytes(data[: -int(rng.integers(1, 40))] if kind == "end" else data)


def contents(log) -> dict[str, set[bytes]]:
    return {
        name: {
            b"".join(np.asarray(column[i]).tobytes() for column in table.columns.values()) for i in range(len(table))
        }
        for name, table in log.tables.items()
    }


@pytest.fixture(scope="module")
def whole_tlog():
    link = Link()
    fly(link, seconds=15)
    return bytes(link.bytes)


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_tlog_gives_no_wrong_message_and_no_fewer_than_pymavlink(tmp_path, whole_tlog, kind):
    path = tmp_path / "a.tlog"
    path.write_bytes(whole_tlog)
    true = contents(read_mavlink_fast(path, wanted=MESSAGES))
    for seed in range(6):
        path.write_bytes(broken(whole_tlog, np.random.default_rng(seed), kind, 12))
        ours = read_mavlink_fast(path, wanted=MESSAGES)
        for name, found in contents(ours).items():
            assert found <= true[name], (name, seed)
        assert sum(ours.counts.values()) >= sum(n for m, n in read_mavlink_plain(path).counts.items() if m in true)
        assert ours.corrupt_packets >= 1


@pytest.mark.parametrize("kind", ["insert", "drop", "cut", "end"])
def test_a_broken_dataflash_log_loses_only_what_was_hit(tmp_path, kind):
    records = dataflash_records(seconds=10)
    head = b"".join(records[:8])
    body = b"".join(records[8:])
    path = tmp_path / "a.bin"
    path.write_bytes(head + body)
    true = read_dataflash(path, wanted=("ATT", "POS", "GPS"))
    good = contents(true)
    for seed in range(6):
        path.write_bytes(head + broken(body, np.random.default_rng(seed), kind, 12))
        ours = read_dataflash(path, wanted=("ATT", "POS", "GPS"))
        wrong = sum(len(found - good[name]) for name, found in contents(ours).items())
        assert wrong <= (2 if kind == "cut" else 0), seed  # there is no checksum: a splice can fit
        assert sum(ours.counts.values()) >= sum(true.counts.values()) - 24
        assert ours.corrupt_packets >= 1


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(noise=st.binary(max_size=400), name=st.sampled_from(["a.tlog", "a.mavlink", "a.bin", "a.log", "a.ulg", "a.srt"]))
def test_any_bytes_are_read_or_refused_in_words(tmp_path, noise, name):
    path = tmp_path / name
    path.write_bytes(noise)
    with pytest.raises(InputFileError) as error:
        read_log(path)
    assert name in str(error.value)


def test_a_message_that_a_cut_filled_up_exactly_is_not_believed(tmp_path):
    """The first 13 bytes of an IMU, then a whole message as long as what the IMU lacks."""
    records = dataflash_records(seconds=3)
    lengths = {record[2]: len(record) for record in records}
    path, cut = tmp_path / "a.bin", lengths[133] - lengths[131]
    at = next(i for i in range(60, len(records)) if records[i][2] == 133 and records[i + 1][2] == 131)
    path.write_bytes(b"".join([*records[:at], records[at][:cut], *records[at + 1 :]]))
    ours = read_dataflash(path, wanted=("ATT", "IMU"))
    assert ours.counts["IMU"] == sum(r[2] == 133 for r in records) - 1
    assert ours.counts["ATT"] == sum(r[2] == 131 for r in records)


def test_a_message_before_a_parted_header_is_kept(tmp_path):
    records = dataflash_records(seconds=3)
    path = tmp_path / "a.bin"
    for inside in (1, 2):
        broken_one = records[80][:inside] + b"garbage in a header" + records[80][inside:]
        path.write_bytes(b"".join([*records[:80], broken_one, *records[81:]]))
        assert sum(read_dataflash(path).counts.values()) == len(records) - 1


def test_definitions_that_contradict_themselves_are_left_out(tmp_path):
    """Found by fuzzing: a nameless field. A later definition in a text log holds for later lines."""
    records = dataflash_records(seconds=1)
    nameless = records[2].replace(b"TimeUS,DesRoll,", b"TimeUS,,DesRol,")
    (tmp_path / "a.bin").write_bytes(b"".join([*records[:2], nameless, *records[3:]]))
    assert "ATT" not in read_dataflash(tmp_path / "a.bin").counts
    lines = [
        "FMT, 131, 30, ATT, Qff, TimeUS,Roll,Pitch",
        "ATT, 1, 2, 3",
        "FMT, 131, 30, ATT, Qf, TimeUS,Roll",
        "ATT, 1, 2",
    ]
    (tmp_path / "a.log").write_text("\n".join(lines))
    found = read_dataflash_text(tmp_path / "a.log")
    assert (found.counts["ATT"], found.corrupt_packets) == (2, 0)
    np.testing.assert_array_equal(found.tables["ATT"].floats("Roll"), [2, 2])
    np.testing.assert_array_equal(found.tables["ATT"].floats("Pitch"), [3, np.nan])


def test_numbers_that_a_text_log_calls_text_are_missing(tmp_path):
    """Found by fuzzing: a definition with a wrong letter, and letters that are not ASCII where text is expected."""
    lines = [
        "FMT, 131, 30, ATT, QNff, TimeUS,Roll,Pitch,Yaw",
        *(f"ATT, {1000000 + i}, \u00b0{i}, 2, 3" for i in range(5)),
    ]
    (tmp_path / "a.log").write_text("\n".join(lines), encoding="utf-8")
    found = read_dataflash_text(tmp_path / "a.log").tables["ATT"]
    assert np.isnan(found.floats("Roll")).all()
    np.testing.assert_array_equal(found.floats("Pitch"), 2.0)
    read_log(tmp_path / "a.log")


@pytest.mark.parametrize("inside", [0, 20])
def test_garbage_behind_a_message_leaves_it_and_garbage_inside_takes_it(tmp_path, inside):
    """There is no checksum: what stands around tells one from the other."""
    records = dataflash_records(seconds=8)
    path, rng = tmp_path / "a.bin", np.random.default_rng(5)
    path.write_bytes(b"".join(records))
    true = contents(read_dataflash(path, wanted=("ATT", "POS")))
    hit = [i for i in range(100, len(records) - 100, 37) if records[i][2] in (131, 133)]
    assert len(hit) > 5
    for i in hit:
        cut = len(records[i]) - inside
        noise = rng.integers(0, 256, int(rng.integers(20, 200)), dtype=np.uint8).tobytes()
        records[i] = records[i][:cut] + noise + records[i][cut:]
    path.write_bytes(b"".join(records))
    ours = read_dataflash(path, wanted=("ATT", "POS", "IMU"))
    assert all(found <= true[name] for name, found in contents(ours).items() if name in true)
    assert sum(ours.counts.values()) == len(records) - (len(hit) if inside else 0)


@pytest.mark.parametrize("kind", [None, *KINDS])
@pytest.mark.parametrize("version", [1, 2])
def test_the_walk_finds_what_the_scan_finds(tmp_path, monkeypatch, kind, version):
    """Small logs are read without the compiled loops as far as they are undamaged: the same tables, to the byte."""
    from pipeline.telemetry.mavlink.packets import fast as mavlink_fast
    from pipeline.telemetry.mavlink.packets import scan as mavlink_scan

    link = Link(version=version)
    fly(link, seconds=5)
    path, content = tmp_path / "a.tlog", bytes(link.bytes)
    path.write_bytes(content if kind is None else broken(content, np.random.default_rng(3), kind, 1))
    by_scan = read_mavlink_fast(path)
    assert mavlink_scan.__name__ in sys.modules
    monkeypatch.delitem(sys.modules, mavlink_scan.__name__)
    calls = []
    walk = mavlink_fast.walk_packets
    monkeypatch.setattr(mavlink_fast, "walk_packets", lambda *a: calls.append(1) or walk(*a))
    by_walk = read_mavlink_fast(path)
    assert calls
    assert (by_walk.counts, by_walk.corrupt_packets) == (by_scan.counts, by_scan.corrupt_packets)
    for name, table in by_scan.tables.items():
        twin = by_walk.tables[name]
        for field in ("place", "record_time_s", "system", "component"):
            assert getattr(twin, field).tobytes() == getattr(table, field).tobytes()
        for field, column in table.columns.items():
            assert twin.columns[field].tobytes() == column.tobytes()
