"""`start = "auto"` end to end: the flight of `data/` finds the camera event that its log knows, or says why not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from calibration import write_camera
from calibration.foundation.errors import UsageError
from pipeline.flight import read_flight
from pipeline.stages import measure_poses, open_sources
from pipeline.synthetic.demo_scenes import small_scene

DATA = Path(__file__).parents[2] / "data" / "flight"
MOUNT = "{ roll_deg = 1.0, pitch_deg = -38.0, yaw_deg = 3.0 }"


def flight(folder, start, *, video=True):
    for name in ("uav2.mp4", "uav2.tlog"):
        shutil.copy(DATA / name, folder / name)
    write_camera(folder / "uav2.json", small_scene().cameras[1].lens)
    seen = 'video = "uav2.mp4"\n' if video else "frame_rate = 25.0\n"
    (folder / "flight.toml").write_text(
        f'[cameras.uav2]\ncalibration = "uav2.json"\n{seen}telemetry = "uav2.tlog"\nstart = "{start}"\n'
        f"mount = {MOUNT}\nlever_arm_m = [0.18, -0.03, 0.07]\n"
    )
    return read_flight(folder / "flight.toml")


def test_the_video_is_found_in_its_log(tmp_path):
    event, auto = (
        measure_poses(found, open_sources(found))[0]
        for found in (flight(tmp_path, "camera-event"), flight(tmp_path, "auto"))
    )
    assert auto.poses.time_s[0] == pytest.approx(event.poses.time_s[0], abs=0.08)  # 8 s of gentle flight, a noisy log
    assert abs(auto.poses.time_s[0] - event.poses.time_s[0]) < 3.5 * auto.sigma.start_s
    assert 0.002 <= auto.sigma.start_s < 0.05
    assert (event.sigma.start_s, event.frame_rate) == (0.0, auto.frame_rate)
    assert any("by the camera's turning" in note for note in auto.notes)


def test_without_a_video_there_is_nothing_to_match(tmp_path):
    found = flight(tmp_path, "auto", video=False)
    with pytest.raises(UsageError, match="without a video"):
        measure_poses(found, open_sources(found))
