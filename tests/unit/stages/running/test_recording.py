"""The recording for the Rerun viewer, read back by the SDK's own reader."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.export import export_all, poses_csv, tracks_csv
from pipeline.flight import read_flight
from pipeline.stages import record_flight
from pipeline.stages.running import recording
from tests.scenes.export import BUS, VAN, poses, tiny_results

DATA = Path(__file__).resolve().parents[4] / "data" / "flight"
CAMERA = {
    "model": "pinhole",
    "image_size": [640, 360],
    "K": [[500, 0, 320], [0, 510, 180], [0, 0, 1]],
    "distortion": [],
}
FLIGHT = """
[cameras.uav1]
calibration = "camera.json"
video = "uav1.mp4"
pose = {{ east_m = 0, north_m = 0, up_m = 2, yaw_deg = 0, pitch_deg = 0, roll_deg = 0 }}
[cameras.uav2]
calibration = "camera.json"
{second}
frame_rate = 25.0
pose = {{ east_m = 0, north_m = 0, up_m = 2, yaw_deg = 0, pitch_deg = 0, roll_deg = 0 }}
[targets.bus]
boxes.uav1 = {{ frame = 0, box = [30, 50, 24, 16] }}
"""


def finished(folder: Path, second: str = 'tracks = "tracks.csv"'):
    """A folder with a flight file and what a run of it left."""
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    shutil.copy(DATA / "uav1.mp4", folder / "uav1.mp4")
    results = tiny_results()
    out = folder / "out"
    out.mkdir()
    files = {
        **export_all(results),
        "poses.csv": poses_csv(poses(), poses(0.25)),
        "tracks.csv": tracks_csv(results.tracks),
    }
    for name, content in files.items():
        (out / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "tracks.csv").write_text("frame,target,x_px,y_px\n3,bus,1.5,2.5\n")
    (folder / "flight.toml").write_text(FLIGHT.format(second=second))
    return read_flight(folder / "flight.toml"), out, results


def read_back(file: Path):
    """Entity and column -> values, and entity -> common times, by the SDK's reader."""
    chunk = pytest.importorskip("rerun.chunk", reason="the extra rerun is not installed")
    values, times = {}, {}
    for part in chunk.RrdReader(file).stream():
        batch = part.to_record_batch()
        for name in batch.schema.names:
            column = batch.column(name).to_pylist()
            if name == recording.TIME_LINE:
                times[part.entity_path] = np.array(
                    [t.total_seconds() if hasattr(t, "total_seconds") else t for t in column]
                )
            elif ":" in name:
                values[part.entity_path, name] = column
    return values, times


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    folder = tmp_path_factory.mktemp("recording")
    flight, out, results = finished(folder)
    told = record_flight(flight, out, out / "flight.rrd")
    return told, results, *read_back(told.file)


def test_trajectories_are_there_to_a_millimetre(made):
    _, results, values, times = made
    for t in results.trajectories:
        name = (
            "targets/bus" if t.target == BUS else next(e for e, _ in values if e.startswith("/targets/van")).strip("/")
        )
        found = np.array(values[f"/{name}", "Points3D:positions"], float).reshape(-1, 3)
        np.testing.assert_allclose(found, t.position_enu_m, atol=1e-3)
        np.testing.assert_allclose(times[f"/{name}"], t.time_s, atol=1e-6)
    assert {t.target for t in results.trajectories} == {BUS, VAN}


def test_cameras_are_there_refined_with_their_lens(made):
    _, results, values, times = made
    own = next(p for p in results.solution.poses if p.camera == "uav2")
    place = np.array(values["/cameras/uav2", "Transform3D:translation"], float).reshape(-1, 3)
    turned = np.array(values["/cameras/uav2", "Transform3D:quaternion"], float).reshape(-1, 4)
    np.testing.assert_allclose(place, own.position_enu_m, atol=1e-3)
    np.testing.assert_allclose(turned[:, [3, 0, 1, 2]], own.enu_from_cam, atol=1e-6)
    clock = next(c for c in results.solution.clocks if c.camera == "uav2")
    np.testing.assert_allclose(times["/cameras/uav2"], clock.common_time_s(own.frame / 25), atol=1e-3)
    matrix = np.ravel(values["/cameras/uav2/image", "Pinhole:image_from_camera"]).reshape(3, 3).T
    np.testing.assert_allclose(matrix, CAMERA["K"])


def test_videos_and_fixes_stand_on_the_same_time_line(made):
    told, results, values, times = made
    assert (
        bytes(np.ravel(values["/cameras/uav1/image", "AssetVideo:blob"]).tolist()) == (DATA / "uav1.mp4").read_bytes()
    )
    stamps = np.ravel(values["/cameras/uav1/image", "VideoFrameReference:timestamp"]).astype(float)
    np.testing.assert_allclose(stamps[:3] * 1e-9, [0.0, 0.04, 0.08])
    np.testing.assert_allclose(times["/cameras/uav1/image"][:3], [0.0, 0.04, 0.08], atol=1e-6)
    entity = next(e for e, _ in values if e.startswith("/cameras/uav1/image/van"))
    track = next(t for t in results.tracks if t.camera == "uav1")
    found = np.array(values[entity, "Points2D:positions"], float).reshape(-1, 2)
    np.testing.assert_allclose(found, track.xy_px[track.seen] + 0.5, atol=1e-3)
    np.testing.assert_allclose(times[entity], track.time_s[track.seen], atol=1e-6)
    assert told.warnings == ("uav2 has no video here",)
    assert not list(told.file.parent.glob(".*.part"))


def test_what_the_viewer_cannot_play_is_said(tmp_path):
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    flight, out, _ = finished(tmp_path, 'video = "uav2.mkv"')
    shutil.copy(DATA / "uav1.mp4", tmp_path / "uav2.mkv")
    told = record_flight(flight, out, out / "a.rrd")
    assert told.warnings == ("uav2: the viewer plays .mp4, not .mkv; its video is left out",)
    assert record_flight(flight, out, out / "b.rrd", videos=False).warnings == ()
    assert not [name for _, name in read_back(out / "b.rrd")[0] if name.startswith("AssetVideo")]


def test_without_the_sdk_or_a_result_it_is_refused(tmp_path, monkeypatch):
    flight, out, _ = finished(tmp_path)
    (out / "solution.json").unlink()
    pytest.importorskip("rerun", reason="the extra rerun is not installed")
    with pytest.raises(InputFileError, match=r"no solution\.json"):
        record_flight(flight, out, out / "a.rrd")
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(UsageError, match="rerun-sdk is not installed"):
        record_flight(flight, out, out / "a.rrd")


def test_times_of_frames_follow_offset_rate_and_drift():
    tracks = pd.DataFrame({"camera": ["a"] * 3, "frame": [0, 50, 100], "time_s": [0.0, 2.1, 4.0]})
    solution = {"clocks": [{"camera": "a", "offset_s": 1.0, "frame_rate": 20.0, "nominal_rate": 25.0, "drifts": False}]}
    times = recording._Times("a", solution, tracks, Path())
    np.testing.assert_allclose(times.common_s(np.array([0.0, 50.0, 75.0])), [1.0, 1 + 52.5 / 20, 1 + 76.25 / 20])
