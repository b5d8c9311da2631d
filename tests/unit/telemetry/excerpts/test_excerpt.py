"""Excerpts of long logs: they hold what the whole reading holds, few bytes are read, and in doubt all of them."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.telemetry import Excerpt, Mount, camera_poses, first_position, log_sigma, read_log, utc_at
from pipeline.telemetry.dataflash.messages.read import read_dataflash
from pipeline.telemetry.excerpts import excerpt
from pipeline.telemetry.excerpts.formats import dataflash_pieces, tlog_pieces
from pipeline.telemetry.log import byte_ranges as pieces
from pipeline.telemetry.log.byte_ranges import bytes_in, joined, sampled, share_read
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from tests.scenes.logs import BOOT_UTC_S, PLACE, RECORD_EPOCH_S, Link, dataflash_records, fly

SECONDS, BOOT_S = 600.0, 100.0
END_S = BOOT_S + SECONDS
SERIES = {
    "position": ("time_s", "lat_rad", "lon_rad", "height_m", "velocity_ned_mps"),
    "attitude": ("time_s", "ned_from_body"),
}
REAL = Path(__file__).resolve().parents[5] / "shared" / "real" / "logs"


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """Pieces for logs of a megabyte."""
    monkeypatch.setattr(excerpt, "HEAD_BYTES", 1 << 14)
    monkeypatch.setattr(excerpt, "STEP_BYTES", 1 << 10)
    monkeypatch.setattr(excerpt, "FINE_BYTES", 1 << 11)
    monkeypatch.setattr(pieces, "SAMPLES", 16)
    monkeypatch.setattr(pieces, "SAMPLE_BYTES", 1 << 12)


@pytest.fixture(scope="module")
def link():
    link = Link()
    fly(link, seconds=SECONDS, heading_deg=lambda t: 90.0 + 20 * np.sin(t / 7))
    return link


@pytest.fixture(scope="module")
def tlog_file(tmp_path_factory, link):
    return link.save(tmp_path_factory.mktemp("logs") / "long.tlog")


@pytest.fixture(scope="module")
def records():
    return dataflash_records(seconds=SECONDS, gyro_hz=20)


@pytest.fixture(scope="module")
def dataflash_file(tmp_path_factory, records):
    return saved(tmp_path_factory.mktemp("logs") / "long.bin", records)


def saved(path: Path, parts: list[bytes]) -> Path:
    path.write_bytes(b"".join(parts))
    return path


def with_garbage(parts: list[bytes], rng: np.random.Generator, first: int) -> list[bytes]:
    """Garbage between messages, cut messages, and flipped bits, from message `first` on."""
    found = list(parts)
    for i in rng.integers(first, len(parts), 60).tolist():
        found[i] += rng.integers(0, 256, int(rng.integers(1, 80)), dtype=np.uint8).tobytes()
    for i in rng.integers(first, len(parts), 20).tolist():
        found[i] = found[i][: int(rng.integers(1, len(found[i])))]
    return found


def part(start: float | str, seconds: float = 20.0) -> tuple[Excerpt]:
    return (Excerpt(start=start, before_s=2.0, after_s=seconds),)


def poses(log, time_s):
    return camera_poses(
        log, camera="c", frame=np.arange(len(time_s)), log_time_s=time_s, mount=Mount(), lever_arm_m=np.ones(3),
        origin=first_position(log), where="test",
    )  # fmt: skip


def assert_same_within(found, whole):
    """Every row of the excerpt, and poses between them, bit for bit."""
    begin, end = found.excerpt_s
    for name, columns in SERIES.items():
        ours, theirs = getattr(found, name), getattr(whole, name)
        mine, its = ((s.time_s >= begin) & (s.time_s <= end) for s in (ours, theirs))
        assert ours.source == theirs.source
        for column in columns:
            np.testing.assert_array_equal(getattr(ours, column)[mine], getattr(theirs, column)[its])
    known = whole.position.time_s[whole.position.valid]
    frames = np.arange(max(begin, known[0]), min(end, known[-1]), 0.04)
    if len(frames):
        ours, theirs = poses(found, frames), poses(whole, frames)
        np.testing.assert_array_equal(ours.position_enu_m, theirs.position_enu_m)
        np.testing.assert_array_equal(ours.enu_from_cam, theirs.enu_from_cam)


def assert_same_of_the_whole(found, whole):
    """What the whole log tells: the first position exactly, clocks to a tenth of their sigma."""
    assert first_position(found) == first_position(whole)
    if "own" in whole.position.height_from:
        assert found.position.height_from == whole.position.height_from
    assert log_sigma(found) == log_sigma(whole)
    for at in found.excerpt_s:
        assert abs(utc_at(found, at) - utc_at(whole, at)) < 0.1 * whole.utc.sigma_s


def starts(seed: int) -> list[float]:
    """The beginning, the end, and anywhere."""
    return [BOOT_S, END_S - 20.0, *np.random.default_rng(seed).uniform(BOOT_S, END_S, 4)]


@pytest.mark.parametrize("kind", ["tlog_file", "dataflash_file"])
def test_an_excerpt_is_the_whole_log_cut(request, kind):
    path = request.getfixturevalue(kind)
    whole = read_log(path)
    assert (whole.excerpt_s, whole.bytes_read) == (None, 0)
    for start in starts(1):
        found = read_log(path, excerpts=part(start))
        assert found.excerpt_s == (start - 2.0, start + 20.0)
        assert found.bytes_read < 0.35 * path.stat().st_size
        assert_same_within(found, whole)
        assert_same_of_the_whole(found, whole)


@pytest.mark.parametrize("kind", ["tlog", "bin"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_garbage_in_the_file_changes_nothing(tmp_path, link, records, kind, seed):
    rng = np.random.default_rng(seed)
    parts = with_garbage(link.packets if kind == "tlog" else records, rng, 20)
    path = saved(tmp_path / f"a.{kind}", parts)
    whole = read_log(path)
    assert whole.corrupt_packets > 0
    for start in starts(seed):
        found = read_log(path, excerpts=part(start))
        assert found.excerpt_s is not None
        assert_same_within(found, whole)
        assert_same_of_the_whole(found, whole)


@pytest.mark.parametrize("kind", ["tlog_file", "dataflash_file"])
def test_messages_of_pieces_are_those_of_the_file(request, kind):
    """Every field of every message that begins in a piece, but for those before the first that others follow."""
    path = request.getfixturevalue(kind)
    read = read_mavlink_fast if kind == "tlog_file" else read_dataflash
    whole, size = read(path), path.stat().st_size
    rng = np.random.default_rng(5)
    chosen = joined([(int(b), min(size, int(b) + 5000)) for b in rng.integers(0, size, 12)])
    found = read(path, pieces=chosen)
    assert found.corrupt_packets == 0
    assert found.bytes_read == bytes_in(chosen)
    for name, table in found.tables.items():
        rows = {row(whole.tables[name], i) for i in range(len(whole.tables[name]))}
        assert {row(table, i) for i in range(len(table))} <= rows
        assert np.all(np.diff(table.place) > 0)
    assert sum(found.counts.values()) > 0.98 * sum(whole.counts.values()) * bytes_in(chosen) / size


def row(table, i: int) -> bytes:
    values = (table.system[i], table.component[i], *(column[i] for column in table.columns.values()))
    return b"".join(np.asarray(value).tobytes() for value in values)


@pytest.mark.parametrize("kind", ["tlog", "dataflash"])
def test_few_bytes_are_asked_for(request, kind):
    path = request.getfixturevalue(f"{kind}_file")
    reader = tlog_pieces(path, system=None) if kind == "tlog" else dataflash_pieces(path)
    asked = []

    def counted(read):
        return lambda wanted: (asked.append(bytes_in(wanted)), read(wanted))[1]

    counting = replace(reader, read=counted(reader.read), glance=counted(reader.glance))
    found = excerpt.read_excerpts(counting, part(400.0))
    sample = bytes_in(sampled(reader.size, excerpt.HEAD_BYTES))
    minutes = found.bytes_read - sample
    assert minutes < 2 * reader.size * (22 + 2 * excerpt.EDGE_S) / SECONDS
    assert len(asked) < 20
    assert sum(asked) < 2 * sample + minutes + 20 * 4 * excerpt.STEP_BYTES


def test_the_start_may_be_any_of_the_logs_clocks(tlog_file):
    moment = datetime.fromtimestamp(BOOT_UTC_S + 350.0, UTC).isoformat()
    for start, within in ((350.0, 0.0), (RECORD_EPOCH_S + 250.03, 0.01), (moment, 0.01)):
        found = read_log(tlog_file, excerpts=part(start))
        assert found.excerpt_s == pytest.approx((348.0, 370.0), abs=within + 1e-9)
    with pytest.raises(ValueError, match="first camera event"):
        part("camera-event")


def test_several_excerpts_are_read_as_one(tlog_file):
    found = read_log(tlog_file, excerpts=(*part(300.0), *part(330.0)))
    assert found.excerpt_s == (298.0, 350.0)
    assert_same_within(found, read_log(tlog_file))


def test_a_start_that_the_log_cannot_answer_reads_it_whole(tmp_path, dataflash_file):
    link = Link()
    fly(link, seconds=60, utc=False)
    for path, start in ((link.save(tmp_path / "a.tlog"), "2023-11-14T22:00:00Z"), (dataflash_file, RECORD_EPOCH_S)):
        assert read_log(path, excerpts=part(start)).excerpt_s is None


@pytest.mark.parametrize("start", [20.0, 2000.0])
@pytest.mark.parametrize("kind", ["tlog_file", "dataflash_file"])
def test_beyond_the_logs_ends_poses_say_what_it_covers(request, kind, start):
    path = request.getfixturevalue(kind)
    found = read_log(path, excerpts=part(start))
    with pytest.raises(InputFileError, match=r"the log covers 100\.000 to 700\.000 s"):
        poses(found, np.arange(start, start + 10.0))


def test_what_was_not_read_is_said(tlog_file):
    found = read_log(tlog_file, excerpts=part(300.0))
    with pytest.raises(InputFileError, match=r"read from 298\.0 to 320\.0 s of log time\) has no sample between"):
        poses(found, np.array([340.0, 550.0]))


@pytest.mark.parametrize(
    ("again_s", "boot_s"),
    [
        (400.0, 3.0),  # the boot time falls back
        (26.0, 114.0),  # early and by little: from piece to piece the boot time grows
    ],
)
def test_a_restart_reads_the_log_whole(tmp_path, again_s, boot_s):
    link = Link()
    fly(link, seconds=again_s - 1.0)
    fly(link, seconds=500.0, boot_s=boot_s, record_s=RECORD_EPOCH_S + again_s)
    path = link.save(tmp_path / "restart.tlog")
    found, whole = read_log(path, excerpts=part(BOOT_S + 450.0)), read_log(path)
    assert found.excerpt_s is None
    assert found.notes == whole.notes
    assert any("anew" in note for note in found.notes)


def test_dataflash_times_that_fall_back_read_the_log_whole(tmp_path):
    path = saved(
        tmp_path / "two.bin", [*dataflash_records(seconds=300.0, gyro_hz=20), *dataflash_records(seconds=200.0)]
    )
    assert read_log(path, excerpts=part(150.0)).excerpt_s is None


@pytest.mark.parametrize(("week_s", "whole"), [(2000.0, True), (700.0, False)])
def test_a_later_boot_by_gps_time_reads_the_log_whole(tmp_path, week_s, whole):
    first, second = (
        dataflash_records(gyro_hz=20, seconds=300.0),
        dataflash_records(gyro_hz=20, seconds=300.0, boot_s=BOOT_S + 600.0, week_s=week_s),
    )
    path = saved(tmp_path / "two.bin", [*first, *second])
    assert (read_log(path, excerpts=part(150.0)).excerpt_s is None) == whole


def test_stamps_that_lie_read_the_log_whole(tmp_path):
    link = Link()
    for i in range(30):
        fly(
            link, seconds=10.0, boot_s=BOOT_S + 10.1 * i, record_s=RECORD_EPOCH_S + 10.1 * i + (3600.0 if i > 20 else 0)
        )
    assert read_log(link.save(tmp_path / "a.tlog"), excerpts=part(150.0)).excerpt_s is None


def test_of_two_vehicles_an_excerpt_has_the_one_that_is_named(tmp_path):
    link = Link()
    for i in range(40):
        for system in (3, 7):
            fly(link, seconds=9.9, boot_s=BOOT_S + 10 * i, record_s=RECORD_EPOCH_S + 10 * i, system=system)
    path = link.save(tmp_path / "pair.tlog")
    assert read_log(path, excerpts=part(200.0)).excerpt_s is None
    found = read_log(path, system=7, excerpts=part(200.0))
    assert found.excerpt_s is not None
    assert_same_within(found, read_log(path, system=7))


def test_the_beginning_reaches_to_the_first_position(tmp_path, records):
    blind = [r for r in records[: len(records) // 6] if r[2] != 132 and r[2] != 130]  # neither POS nor GPS
    path = saved(tmp_path / "late.bin", [*blind, *records[len(records) // 6 :]])
    found, whole = read_log(path, excerpts=part(400.0)), read_log(path)
    assert found.excerpt_s is not None
    assert first_position(found) == first_position(whole)
    assert first_position(found) != PLACE


def test_definitions_that_come_late_are_found(tmp_path, records):
    """Behind the first megabyte, as a script on board has them: then all of the file is searched for more."""
    kinds, rest = records[:8], records[8:]
    late = [*kinds[:5], *rest[: len(rest) // 2], *kinds[5:], *rest[len(rest) // 2 :]]
    path = saved(tmp_path / "late.bin", [*late[:1000], bytes(1 << 20), *late[1000:]])
    found, whole = read_log(path, excerpts=part(600.0)), read_log(path)
    assert found.excerpt_s is not None
    assert_same_within(found, whole)
    raw = read_dataflash(path, pieces=((0, 1 << 16), (path.stat().st_size - 50_000, path.stat().st_size)))
    assert raw.bytes_read == path.stat().st_size
    assert "CAM" in raw.tables


def test_a_log_that_breaks_off_needs_no_search(tmp_path, records):
    path = saved(tmp_path / "cut.bin", [*records, records[-1][:9]])
    found, whole = read_log(path, excerpts=part(END_S - 20.0)), read_log(path)
    assert whole.corrupt_packets == found.corrupt_packets == 1
    assert found.bytes_read < 0.35 * path.stat().st_size
    assert_same_within(found, whole)


@pytest.mark.parametrize("name", ["a.mavlink", "a.log", "short.tlog"])
def test_other_formats_and_short_logs_are_read_whole(tmp_path, name):
    path = tmp_path / name
    if name == "a.log":
        path.write_text("FMT, 1, 20, POS, QLLf, TimeUS,Lat,Lng,Alt\n" + "POS, 100, 28.2, 112.9, 5\n" * 3)
    else:
        link = Link(stamped=name != "a.mavlink")
        fly(link, seconds=5)
        link.save(path)
    assert read_log(path, excerpts=part(102.0)).excerpt_s is None


def test_pieces():
    assert joined(((5, 9), (0, 3), (3, 4), (8, 12), (7, 7))) == ((0, 4), (5, 12))
    for size in (10, 5000, 100_000, 10_000_000):
        found = sampled(size, 1 << 14)
        assert found[0][0] == 0
        assert found[-1][1] == size
        assert all(b > a for (_, a), (b, _) in pairwise(found))
    assert share_read(((0, 10), (90, 100)), 50) == 0.5
    assert share_read(((0, 10), (90, 100)), 100) == 1.0


@pytest.mark.real
@pytest.mark.parametrize(
    "name", ["ardusub_small.tlog", "erlerobot_pxf_plane_5-12-2014_05_12_2014_E.BIN", "h3ct0r_16-07-13_17-52-16.bin"]
)
def test_excerpts_of_real_logs(name):
    if not (REAL / name).exists():
        pytest.skip("the real logs are not here")
    whole = read_log(REAL / name)
    known = whole.position.time_s[whole.position.valid]
    for start in np.linspace(known[0], known[-1] - 20.0, 7):
        found = read_log(REAL / name, excerpts=part(start))
        assert found.excerpt_s is not None
        for series, columns in SERIES.items():
            ours, theirs = getattr(found, series), getattr(whole, series)
            mine, its = ((s.time_s >= start - 2.0) & (s.time_s <= start + 20.0) for s in (ours, theirs))
            for column in columns:
                np.testing.assert_array_equal(getattr(ours, column)[mine], getattr(theirs, column)[its])
        assert first_position(found) == first_position(whole)
        if whole.utc is not None:
            assert abs(utc_at(found, start) - utc_at(whole, start)) < 0.3 * whole.utc.sigma_s  # by 60 kB of the log
