"""The written folder: complete, reproducible, readable, silent about the truth."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.records import LOST
from pipeline.synthetic import Quality, demo_scene, paper_scene, read_truth, small_scene, write_flight
from pipeline.synthetic.flight import first_box
from pipeline.synthetic.simulate import true_flight

QUICK = Quality(crf=28, photos=2)


def short(frames=12):
    """The small flight, cut to a few frames, on a small piece of country."""
    scene = small_scene()
    return replace(
        scene,
        cameras=tuple(replace(c, frames=frames) for c in scene.cameras),
        landscape=replace(scene.landscape, half_size_m=150.0, texel_m=0.6),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    told = []
    place = tmp_path_factory.mktemp("flight")
    path = write_flight(
        short(), place, seed=5, quality=QUICK, progress=lambda stage, done, total: told.append((stage, done, total))
    )
    assert path == place / "flight.toml"
    assert told[-1] == ("render", 24, 24)
    return place


def digests(folder):
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_everything_a_user_brings_home_is_there(folder):
    assert set(digests(folder)) == {
        "board-uav1/photo-01.jpg",
        "board-uav1/photo-02.jpg",
        "board-uav2/photo-01.jpg",
        "board-uav2/photo-02.jpg",
        "flight.toml",
        "truth/truth.json",
        "uav1.mp4",
        "uav1.tlog",
        "uav2.mp4",
        "uav2.tlog",
    }


def test_same_seed_same_bytes_other_seed_others(folder, tmp_path):
    write_flight(short(), tmp_path / "again", seed=5, quality=QUICK)
    assert digests(tmp_path / "again") == digests(folder)
    write_flight(short(), tmp_path / "other", seed=6, quality=QUICK)
    other = digests(tmp_path / "other")
    assert other["uav1.mp4"] != digests(folder)["uav1.mp4"]
    assert other["uav1.tlog"] != digests(folder)["uav1.tlog"]


def test_the_flight_file_says_nothing_of_the_other_clock(folder):
    text = (folder / "flight.toml").read_text()
    assert "1.61" not in text
    assert "25.02" not in text
    content = tomllib.loads(text)
    assert "offset_s" not in content["cameras"]["uav2"]
    assert content["cameras"]["uav1"]["mount"] == "gimbal"
    assert content["cameras"]["uav2"]["mount"] == {"roll_deg": 1, "pitch_deg": -38, "yaw_deg": 3}
    assert content["cameras"]["uav2"]["start"] == "camera-event"
    assert content["flight"]["origin"] == {"lat": 28.2, "lon": 112.9, "height": 60}


def test_videos_hold_the_frames_at_their_nominal_times(folder):
    for name in ("uav1", "uav2"):
        video = cv2.VideoCapture(str(folder / f"{name}.mp4"))
        times = []
        while True:
            ok, image = video.read()
            if not ok:
                break
            assert image.shape == (360, 640, 3)
            times.append(video.get(cv2.CAP_PROP_POS_MSEC))
        assert times == pytest.approx(40.0 * np.arange(12), abs=1e-6)


def test_truth_comes_back(folder):
    want, got = true_flight(short()), read_truth(folder)
    assert (got.offset_s, got.frame_rate, got.focal_px) == (want.offset_s, want.frame_rate, want.focal_px)
    for a, b in zip(got.trajectories, want.trajectories, strict=True):
        assert a.target == b.target
        assert np.abs(a.position_enu_m - b.position_enu_m).max() < 1e-4
    for a, b in zip(got.poses, want.poses, strict=True):
        assert np.abs(a.enu_from_cam - b.enu_from_cam).max() < 1e-9
    for a, b in zip(got.tracks, want.tracks, strict=True):
        assert (a.camera, a.target) == (b.camera, b.target)
        assert np.array_equal(a.state, b.state)
        assert np.nanmax(np.abs(a.xy_px - b.xy_px)) < 1e-4


@pytest.mark.parametrize("content", ["", "{}", '{"cameras": 3, "targets": {}}', "[1, 2"])
def test_a_broken_truth_file_is_one_clear_message(tmp_path, content):
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "truth.json").write_text(content)
    with pytest.raises(InputFileError, match=r"truth\.json"):
        read_truth(tmp_path)


def test_no_truth_is_one_clear_message(tmp_path):
    with pytest.raises(InputFileError, match="no such file"):
        read_truth(tmp_path)


@pytest.mark.parametrize("scene", [demo_scene(), small_scene()], ids=["demo", "small"])
def test_first_boxes_are_centred_on_the_roof_and_drawn_where_it_shows(scene):
    truth = true_flight(scene)
    for track in truth.tracks:
        camera = scene.camera(track.camera)
        target = next(t for t in scene.targets if t.name == track.target)
        box = first_box(scene, camera, target, track)
        assert track.state[box.frame] != LOST
        assert np.abs(np.array(box.centre_px) - track.xy_px[box.frame]).max() < 0.12
        assert all(float(side).is_integer() for side in (box.x, box.y, box.width, box.height))
        assert min(box.width, box.height) >= 8
        assert box.frame < 32
        assert max(box.width, box.height) <= 50


def test_a_scene_without_ground_cannot_be_rendered(tmp_path):
    with pytest.raises(ValueError, match="landscape"):
        write_flight(paper_scene(), tmp_path, seed=1)
