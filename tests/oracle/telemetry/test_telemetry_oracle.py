"""Our readers against pymavlink's own: the same messages, the same values, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry import camera_poses, covered, first_position, read_log
from pipeline.telemetry.camera_pose.from_log import Mount
from pipeline.telemetry.dataflash.messages.read import read_dataflash
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from pipeline.telemetry.mavlink.packets.plain import read_mavlink_plain
from tests.scenes.logs import Link, dataflash, fly

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "logs"
ALL_NAMES = tuple(message.msgname for message in mav.mavlink_map.values())
TLOGS = ["ardusub_small.tlog", "cuav_testdata_flight.tlog", "dronekit_flight_replay.tlog"]
BINS = [
    "amc_backend_log_80k.bin",
    "erlerobot_pxf_plane_5-12-2014_05_12_2014_E.BIN",
    "h3ct0r_16-07-13_17-52-16.bin",
    "pymavlink_test.BIN",
]


def real(name: str) -> Path:
    if not (REAL / name).exists():
        pytest.skip(f"the real log {name} is not beside the project (../shared/real/logs)")
    return REAL / name


def as_pymavlink_says(column):
    if column.dtype.kind == "S":
        return np.array([value.split(b"\0")[0].decode("ascii", "replace") for value in column.tolist()])
    return column


def differing(ours, theirs, names=None) -> int:
    """Values in common tables that differ; the tables must hold the same messages."""
    wrong = 0
    for name in names or theirs:
        mine, its = ours[name], theirs[name]
        assert len(mine) == len(its), name
        for column in its.columns:
            a, b = as_pymavlink_says(mine.columns[column]), its.columns[column]
            wrong += int((~((a == b) | ((a != a) & (b != b)))).sum())
        wrong += int((mine.system != its.system).sum() + (mine.component != its.component).sum())
        wrong += int((~((mine.record_time_s == its.record_time_s) | np.isnan(its.record_time_s))).sum())
    return wrong


def every_kind_of_message(link: Link) -> None:
    """One of each message of the dialect, its fields filled with running numbers, then with zeros at the end."""
    rng = np.random.default_rng(5)
    for i, message in enumerate(mav.mavlink_map.values()):
        if link.version == 1 and message.id > 255:
            continue
        for fill in (rng.integers(1, 100, 300), np.zeros(300, dtype=int)):
            values = []
            lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
            for at, (name, kind) in enumerate(zip(message.fieldnames, message.fieldtypes, strict=True)):
                many = lengths[name]
                part = [int(v) for v in fill[at : at + max(many, 1)]]
                part += [0] * (max(many, 1) - len(part))
                if kind == "char":
                    values.append(bytes(65 + v % 26 if v else 0 for v in part))
                else:
                    part = [v + 0.5 for v in part] if kind in ("float", "double") else part
                    values.append(part if many else part[0])
            link.send(message(*values), record_s=1.7e9 + i, system=3, component=4)


@pytest.mark.parametrize(("version", "signed"), [(1, False), (2, False), (2, True)])
@pytest.mark.parametrize("stamped", [True, False])
def test_every_message_of_the_dialect_reads_the_same(tmp_path, version, signed, stamped):
    link = Link(version=version, signed=signed, stamped=stamped)
    every_kind_of_message(link)
    path = link.save(tmp_path / ("a.tlog" if stamped else "a.mavlink"))
    ours, theirs = (read(path, wanted=ALL_NAMES) for read in (read_mavlink_fast, read_mavlink_plain))
    assert ours.counts == theirs.counts
    assert sum(ours.counts.values()) == len(link.packets)
    assert (ours.corrupt_packets, theirs.corrupt_packets) == (0, 0)
    assert differing(ours.tables, theirs.tables) == 0


def test_versions_mixed_on_one_link_lose_nothing(tmp_path):
    """pymavlink's own reader stumbles over short v1 packets after v2 ones; ours must not."""
    old, new = Link(version=1), Link(version=2)
    every_kind_of_message(old)
    every_kind_of_message(new)
    mixed = b"".join(p for pair in zip(old.packets, new.packets, strict=False) for p in pair)
    path = tmp_path / "mixed.tlog"
    path.write_bytes(mixed)
    log = read_mavlink_fast(path, wanted=ALL_NAMES)
    assert sum(log.counts.values()) == 2 * len(old.packets)
    assert log.corrupt_packets == 0


@pytest.mark.real
@pytest.mark.parametrize("name", TLOGS)
def test_real_tlogs_read_the_same(name):
    path = real(name)
    ours, theirs = (read(path, wanted=ALL_NAMES) for read in (read_mavlink_fast, read_mavlink_plain))
    lost_by_pymavlink = {"HEARTBEAT", "COMMAND_LONG"} if name.startswith("cuav") else set()
    for message, count in theirs.counts.items():
        more = ours.counts[message] - count
        assert more == (1 if message in lost_by_pymavlink else 0), message
    assert differing(ours.tables, theirs.tables, set(theirs.tables) - lost_by_pymavlink) == 0


@pytest.mark.real
def test_corrupt_packets_of_a_real_log_are_counted():
    """1314 packets by pymavlink's count; ours adds the one that the end of the file cuts off."""
    path = real("dronekit_flight_replay.tlog")
    assert read_mavlink_plain(path).corrupt_packets == 1314
    assert read_log(path).corrupt_packets == 1315


@pytest.mark.real
@pytest.mark.parametrize("name", BINS)
def test_real_dataflash_reads_the_same(name, capsys):
    path = real(name)
    assert dataflash_differing(path) == 0
    capsys.readouterr()


def test_written_dataflash_reads_the_same(tmp_path):
    assert dataflash_differing(dataflash(tmp_path / "a.bin", seconds=4)) == 0


def text_of(value) -> str:
    """What DFReader makes of a string: up to the first zero, UTF-8 or else western European."""
    if isinstance(value, str):
        return value
    try:
        return value.decode("utf-8").split("\0")[0]
    except UnicodeDecodeError:
        return value.decode("ISO-8859-1").split("\0")[0]


def dataflash_differing(path: Path) -> int:
    """Values that differ from DFReader's, over all messages; both must find the same messages."""
    theirs: dict[str, list] = {}
    reader = DFReader.DFReader_binary(str(path))
    while (message := reader.recv_msg()) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    ours = read_dataflash(path, wanted=tuple(theirs))
    assert ours.counts == {name: len(found) for name, found in theirs.items()}
    wrong = 0
    for name, found in theirs.items():
        for column in found[0].get_fieldnames():
            values, mine = [getattr(m, column) for m in found], ours.tables[name].columns[column]
            if mine.dtype.kind == "S":
                texts = [v if isinstance(v, bytes) else v.encode("utf-8", "replace") for v in values]
                wrong += sum(
                    a.split(b"\0")[0][:3] != b.split(b"\0")[0][:3] for a, b in zip(mine.tolist(), texts, strict=True)
                )
            else:
                its = np.array([list(v) if hasattr(v, "__len__") else v for v in values])
                wrong += int((~((mine == its) | ((mine != mine) & (its != its)))).sum())
    reader.close()
    return wrong


@pytest.mark.real
@pytest.mark.parametrize(("name", "positions", "attitudes"), [
    ("ardusub_small.tlog", 792, 5245),
    ("cuav_testdata_flight.tlog", 1098, 1088),
    ("dronekit_flight_replay.tlog", 2833, 2829),
    ("erlerobot_pxf_plane_5-12-2014_05_12_2014_E.BIN", 4122, 7675),
    ("h3ct0r_16-07-13_17-52-16.bin", 1305, 2555),
    ("pymavlink_test.BIN", 23, 24),
    ("amc_backend_log_80k.bin", 4, 5),
])  # fmt: skip
def test_every_position_and_attitude_of_a_real_log_and_camera_poses_from_them(name, positions, attitudes):
    log = read_log(real(name))
    assert (len(log.position.time_s), len(log.attitude.time_s)) == (positions, attitudes)
    assert log.position.datum == "ellipsoid"
    time = np.linspace(log.position.time_s[0], log.position.time_s[-1], 500)
    mount = Mount(gimbal=log.gimbal is not None)
    seen = time[covered(log, time, mount=mount, lever_arm_m=np.zeros(3))]
    assert len(seen) > 350
    track = camera_poses(
        log, camera="c", frame=np.arange(len(seen)), log_time_s=seen, mount=mount, lever_arm_m=np.zeros(3),
        origin=first_position(log), where="test",
    )  # fmt: skip
    assert np.isfinite(track.position_enu_m).all()
    np.testing.assert_allclose(np.linalg.norm(track.enu_from_cam, axis=1), 1.0, atol=1e-12)


@pytest.mark.real
def test_a_real_autopilots_quaternions_agree_with_its_angles():
    """XKQ and NKQ1 less the board's trim are ATT, to the hundredths of a degree that old ATT has."""
    from pipeline.geometry import rotation

    for name in ("amc_backend_log_80k.bin", "pymavlink_test.BIN"):
        raw = read_dataflash(real(name))
        log, att = read_log(real(name)), raw.tables["ATT"]
        ours = np.degrees(rotation.yaw_pitch_roll(log.attitude.ned_from_body))[:5]
        theirs = np.stack([att.floats(angle)[:5] for angle in ("Yaw", "Pitch", "Roll")], axis=1)
        np.testing.assert_allclose((ours - theirs + 180) % 360 - 180, 0.0, atol=0.03)


@pytest.mark.real
def test_real_px4_logs():
    log = read_log(real("pyulog_sample.ulg"))
    assert len(log.attitude.time_s) == 6461
    assert log.position is None
    assert len(read_log(real("pyulog_sample_appended_multiple.ulg")).attitude.time_s) == 306


def test_the_plain_reader_gives_the_same_flight(tmp_path):
    from pipeline.telemetry.mavlink.flight import mavlink_flight

    link = Link()
    fly(link, seconds=3)
    path = link.save(tmp_path / "a.tlog")
    fast, plain = mavlink_flight(read_mavlink_fast(path)), mavlink_flight(read_mavlink_plain(path))
    np.testing.assert_array_equal(fast.position.lat_rad, plain.position.lat_rad)
    np.testing.assert_array_equal(fast.attitude.ned_from_body, plain.attitude.ned_from_body)
    np.testing.assert_array_equal(fast.attitude.time_s, plain.attitude.time_s)
    assert fast.utc == plain.utc
    assert fast.counts == plain.counts
