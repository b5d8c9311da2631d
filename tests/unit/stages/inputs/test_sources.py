"""A big log is read where the videos are, when the flight file says where; poses are those of the whole log."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from calibration import write_camera
from pipeline.flight import read_flight
from pipeline.stages import measure_poses, open_sources
from pipeline.stages.inputs import sources
from pipeline.synthetic.demo_scenes import small_scene
from pipeline.telemetry.excerpts import excerpt
from pipeline.telemetry.log import byte_ranges as pieces
from tests.scenes.logs import RECORD_EPOCH_S, tlog

VIDEO = Path(__file__).parents[4] / "data" / "flight" / "uav2.mp4"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A video of eight seconds beside a log of twenty minutes."""
    folder = tmp_path_factory.mktemp("flight")
    shutil.copy(VIDEO, folder / "a.mp4")
    write_camera(folder / "a.json", small_scene().cameras[1].lens)
    tlog(folder / "a.tlog", seconds=1200.0)
    return folder


@pytest.fixture
def _big(monkeypatch):
    monkeypatch.setattr(sources, "BIG_LOG_BYTES", 1 << 20)
    monkeypatch.setattr(excerpt, "HEAD_BYTES", 1 << 14)
    monkeypatch.setattr(excerpt, "FINE_BYTES", 1 << 12)
    monkeypatch.setattr(pieces, "SAMPLES", 16)
    monkeypatch.setattr(pieces, "SAMPLE_BYTES", 1 << 12)


def opened(folder, *starts, video='video = "a.mp4"', more=""):
    cameras = "".join(
        f'[cameras.c{i}]\ncalibration = "a.json"\ntelemetry = "a.tlog"\nsystem = 1\nstart = {start}\n{video}\n{more}\n'
        for i, start in enumerate(starts)
    )
    (folder / "flight.toml").write_text(cameras)
    flight = read_flight(folder / "flight.toml")
    return flight, open_sources(flight)


@pytest.mark.usefixtures("_big")
def test_poses_are_those_of_the_whole_log(folder, monkeypatch):
    flight, cut = opened(folder, 600.0)
    begin, end = cut.logs["c0"].excerpt_s
    assert (begin, end) == pytest.approx((600.0 - 60.8, 608.0 + 60.8), abs=0.3)
    monkeypatch.setattr(sources, "BIG_LOG_BYTES", 1 << 40)
    whole = open_sources(flight)
    assert whole.logs["c0"].excerpt_s is None
    assert cut.origin == whole.origin
    ours, theirs = (measure_poses(flight, source)[0] for source in (cut, whole))
    np.testing.assert_array_equal(ours.poses.position_enu_m, theirs.poses.position_enu_m)
    np.testing.assert_array_equal(ours.poses.enu_from_cam, theirs.poses.enu_from_cam)
    assert (ours.sigma, ours.notes) == (theirs.sigma, theirs.notes)
    assert ours.utc_s == pytest.approx(theirs.utc_s, abs=1e-3)
    moved = [pose.poses_at(pose.poses)(np.full(len(pose.poses.frame), 50.0)) for pose in (ours, theirs)]
    np.testing.assert_array_equal(moved[0].position_enu_m, moved[1].position_enu_m)


@pytest.mark.usefixtures("_big")
def test_what_the_margin_depends_on_and_two_cameras_of_one_log(folder):
    _, cut = opened(folder, 600.0, RECORD_EPOCH_S + 600.03, more="sigma = { start_s = 2.0 }")
    assert cut.logs["c0"] is cut.logs["c1"]
    assert cut.logs["c0"].excerpt_s == pytest.approx((600.0 - 80.8, 708.0 + 80.8), abs=0.3)


@pytest.mark.usefixtures("_big")
@pytest.mark.parametrize(
    ("starts", "video"),
    [
        (['"camera-event"'], 'video = "a.mp4"'),
        (['"auto"'], 'video = "a.mp4"'),
        ([600.0, '"auto"'], 'video = "a.mp4"'),
        ([600.0], "frame_rate = 25.0"),
    ],
)
def test_where_the_videos_minutes_are_not_known_the_log_is_read_whole(folder, starts, video):
    assert opened(folder, *starts, video=video)[1].logs["c0"].excerpt_s is None


def test_a_small_log_is_read_whole(folder):
    assert opened(folder, 600.0)[1].logs["c0"].excerpt_s is None
