"""Subtitles of DJI models in all their dialects, and what a person is told of a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.telemetry import Mount, camera_poses, inspect_log, read_log
from tests.scenes.logs import log_of, tlog

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "dji-srt"

DIALECTS = {
    "brackets": ("[latitude: 41.5] [longitude: 2.25] [rel_alt: 5.4 abs_alt: 117.0]", (41.5, 2.25), "ellipsoid"),
    "misspelt": ("[latitude : 41.5] [longtitude : 2.25] [rel_alt: 5.4]", (41.5, 2.25), "home"),
    "lon lat satellites": ("GPS (2.25, 41.5, 15), D 1.0m, H 5.40m, H.S 0.0m/s", (41.5, 2.25), "home"),
    "lat lon metres": ("GPS(41.5,2.25,0.0M) BAROMETER:5.4M", (41.5, 2.25), "home"),
}


def srt(tmp_path, lines, name="a.srt"):
    path = tmp_path / name
    path.write_text("\n".join(f"{i + 1}\n00:00:0{i},000 --> 00:00:0{i},900\n{x}\n" for i, x in enumerate(lines)))
    return read_log(path)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_says_where(tmp_path, dialect):
    line, (lat, lon), datum = DIALECTS[dialect]
    log = srt(tmp_path, [line] * 3)
    np.testing.assert_allclose(np.degrees(log.position.lat_rad), lat)
    np.testing.assert_allclose(np.degrees(log.position.lon_rad), lon)
    assert log.position.datum == datum
    if datum == "home":
        np.testing.assert_allclose(log.position.height_m, 5.4)
        assert any("take-off place" in note for note in log.notes)
    np.testing.assert_allclose(log.position.time_s, [0.0, 1.0, 2.0])
    assert log.utc is None


def test_gimbal_angles_are_pitch_roll_yaw(tmp_path):
    log = srt(tmp_path, ["GPS (2.0, 41.0, 15), H 5.0m, F.PRY (2.0°, -7.0°, 110.0°), G.PRY (-24.0°, 0.0°, 110.5°)"] * 3)
    track = camera_poses(
        log, camera="c", frame=np.arange(2), log_time_s=np.array([0.5, 1.5]), mount=Mount(gimbal=True),
        lever_arm_m=np.zeros(3), origin=Geodetic.from_degrees(41.0, 2.0, 0.0), where="w",
    )  # fmt: skip
    np.testing.assert_allclose(
        np.degrees(rotation.camera_yaw_pitch_roll(track.enu_from_cam)), [[110.5, -24.0, 0.0]] * 2
    )


def test_subtitles_without_a_time_are_refused(tmp_path):
    (tmp_path / "b.srt").write_text("hello\n\nworld\n")
    with pytest.raises(InputFileError, match="no subtitle with a time"):
        read_log(tmp_path / "b.srt")


@pytest.mark.real
@pytest.mark.parametrize(("name", "valid"), [
    ("air2s.srt", 17), ("broken_incomplete.SRT", 19), ("callmarcus_Avata360.SRT", 5), ("matrice_300.srt", 381),
    ("mavic_2_style.SRT", 0), ("mavic_air.SRT", None), ("mavic_mini.SRT", 117), ("mavic_pro.SRT", 468),
    ("p4_rtk.SRT", 55),
])  # fmt: skip
def test_subtitles_of_real_models(name, valid):
    if not (REAL / name).exists():
        pytest.skip(f"{name} is not beside the project (../shared/real/dji-srt)")
    position = read_log(REAL / name).position
    assert (None if position is None else int(position.told.sum())) == valid


def test_a_log_is_told_in_words(tmp_path):
    told = inspect_log(read_log(tlog(tmp_path / "a.tlog")))
    assert told.corrupt_packets == 0
    assert told.messages == sum(told.counts.values())
    assert [facts.what for facts in told.series] == ["position", "attitude"]
    assert told.series[0].rate_hz == pytest.approx(10.0, rel=1e-6)
    text = "\n".join(told.words)
    for part in ("system 1 component 1", "101 of 101 samples valid", "undulation", "UTC at log time 0: 2023-11-14"):
        assert part in text
    assert told.flight_file[0] == 'telemetry = "a.tlog"'
    assert 'start = "auto"   # or a UTC time, or seconds of log time' in told.flight_file
    assert "sigmas from it: position 1.24 m constant and 0.41 m moving" in text
    assert len(told.missing) == 1
    assert "GIMBAL_DEVICE_ATTITUDE_STATUS" in told.missing[0]


def test_gaps_are_counted():
    told = inspect_log(log_of(time_s=(0.0, 1.0, 9.0)))
    assert (told.series[0].gaps, told.series[0].longest_gap_s) == (1, 8.0)
    assert "1 gaps over 3 s" in "\n".join(told.words)


def test_what_to_write_where_a_log_leaves_a_choice(tmp_path):
    from tests.scenes.logs import Link, fly

    link = Link()
    fly(link, seconds=3, system=1)
    fly(link, seconds=4, system=5)
    told = inspect_log(read_log(link.save(tmp_path / "two.tlog")))
    assert "system = 5   # of 1, 5" in told.flight_file
    assert "vehicles that give positions: systems 1, 5" in told.words
    home = inspect_log(srt(tmp_path, ["GPS (2.0, 41.0, 15), H 5.0m, G.PRY (-24.0°, 0.0°, 110.5°)"] * 3))
    assert any(line.startswith("takeoff = ") for line in home.flight_file)
    assert any(line.startswith('mount = "gimbal"') for line in home.flight_file)
