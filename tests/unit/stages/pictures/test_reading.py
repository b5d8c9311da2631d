"""Pictures are cut out of the right frame at the right place, within what reading and the page may cost."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.flight import Flight, read_flight
from pipeline.records import TRACKED, Clock, ImageTrack, Results
from pipeline.stages.pictures.reading import NO_VIDEO, with_pictures
from pipeline.stages.pictures.settings import PictureSettings
from tests.scenes.report import fake_results
from tests.scenes.video import encoded, panning, written

SETTINGS = PictureSettings(least_px=40, unknown_px=40)


def flight_of(folder: Path, *, videos: bool = True) -> Flight:
    """A flight of two cameras; the boxes are those of the drawn square."""
    lines = []
    for name in ("uav1", "uav2"):
        source = 'video = "{}.avi"' if videos else 'tracks = "{}.csv"\nframe_rate = 25.0'
        lines += [f"[cameras.{name}]", f'calibration = "{name}.json"', source.format(name)]
        lines += ["pose = { east_m = 0, north_m = 0, up_m = 2, yaw_deg = 0, pitch_deg = 0, roll_deg = 0 }"]
    lines += ["[targets.car]"]
    if videos:
        lines += [f"boxes.{name} = {{ frame = 0, box = [30, 50, 24, 16] }}" for name in ("uav1", "uav2")]
    path = folder / "flight.toml"
    path.write_text("\n".join(lines))
    return read_flight(path)


def results_of(frames: int, *, from_frame: int = 0) -> Results:
    """The square, tracked without error in both cameras; the solution knows nothing of it."""
    frame = np.arange(from_frame, frames)
    xy = np.stack([30 + np.round(1.5 * frame) + 11.5, np.full(len(frame), 57.5)], axis=1)
    tracks = tuple(
        ImageTrack(
            camera=name, target="car", frame=frame, time_s=frame / 25, xy_px=xy, sigma_px=np.full(len(frame), 0.4),
            state=np.full(len(frame), TRACKED),
        )
        for name in ("uav1", "uav2")
    )  # fmt: skip
    still = fake_results(targets=1, seconds=2)
    clocks = tuple(dataclasses.replace(c, deviation_frame=None) for c in still.solution.clocks)
    assert all(isinstance(c, Clock) for c in clocks)
    return dataclasses.replace(
        still, tracks=tracks, pictures=(), solution=dataclasses.replace(still.solution, clocks=clocks)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures")
    for name in ("uav1", "uav2"):
        written(path / f"{name}.avi", panning(30))
    return path


def decoded(jpeg: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)


@pytest.mark.parametrize("first", [0, 17])
def test_the_target_is_where_the_picture_says(folder, first):
    found = with_pictures(flight_of(folder), results_of(30, from_frame=first), settings=SETTINGS)
    assert [(p.camera, p.frame) for p in found.pictures] == [("uav1", first), ("uav2", first)]
    for picture in found.pictures:
        shown = decoded(picture.jpeg)
        assert shown.shape[:2] == picture.size[::-1]
        left, top = (round(c + 0.5) for c in picture.corner_px)
        there = panning(30)[first].astype(int)
        assert np.abs(shown - there[top : top + shown.shape[0], left : left + shown.shape[1]]).mean() < 8
        assert np.abs(shown[:, 3:] - there[top : top + shown.shape[0], left : left + shown.shape[1] - 3]).mean() > 12
        assert picture.place(picture.fix_px) == pytest.approx((30 + round(1.5 * first) + 12 - left, 58 - top))


def test_the_drawn_box_lies_on_the_square(folder):
    picture = with_pictures(flight_of(folder), results_of(30), settings=SETTINGS).pictures[0]
    left, top = picture.place(picture.box_px[:2])
    assert picture.place(picture.fix_px) == pytest.approx((left + 12 * picture.zoom, top + 8 * picture.zoom))


def test_the_same_video_gives_the_same_bytes(folder):
    one, two = (with_pictures(flight_of(folder), results_of(30), settings=SETTINGS) for _ in range(2))
    assert one.pictures == two.pictures
    assert one.pictures


def test_a_large_cut_out_is_made_smaller(folder):
    small = dataclasses.replace(SETTINGS, least_px=100, encoded_px=50)
    picture = with_pictures(flight_of(folder), results_of(30), settings=small).pictures[0]
    assert (picture.size, picture.zoom) == ((50, 50), 0.5)
    assert decoded(picture.jpeg).shape == (50, 50, 3)


def test_without_videos_there_is_a_word(tmp_path):
    flight = flight_of(tmp_path, videos=False)
    found = with_pictures(flight, results_of(5))
    assert found.pictures == ()
    assert found.picture_notes == (NO_VIDEO,)


def test_a_video_that_cannot_be_read_again_is_said_and_the_other_is_shown(tmp_path):
    written(tmp_path / "uav1.avi", panning(5))
    (tmp_path / "uav2.avi").write_bytes(b"no video")
    found = with_pictures(flight_of(tmp_path), results_of(5), settings=SETTINGS)
    assert {p.camera for p in found.pictures} == {"uav1"}
    assert len(found.picture_notes) == 1
    assert "uav2 could not be read again" in found.picture_notes[0]


def test_the_page_stays_small(folder):
    one = with_pictures(flight_of(folder), results_of(30), settings=SETTINGS).pictures[0]
    little = dataclasses.replace(SETTINGS, most_bytes=len(one.jpeg) + 9)
    found = with_pictures(flight_of(folder), results_of(30), settings=little)
    assert len(found.pictures) == 1
    assert "1 further picture is left out" in found.picture_notes[0]


def test_moments_deep_in_a_video_are_left_out_and_said(tmp_path):
    for name in ("uav1", "uav2"):
        encoded(written(tmp_path / "all.avi", panning(30)), tmp_path / f"{name}.avi", "-g", "30")
    none = dataclasses.replace(SETTINGS, decoded_px=0)
    found = with_pictures(flight_of(tmp_path), results_of(30, from_frame=12), settings=none)
    assert found.pictures == ()
    assert [("deep inside" in note) for note in found.picture_notes] == [True, True]
    assert len(with_pictures(flight_of(tmp_path), results_of(30), settings=none).pictures) == 2


def test_every_camera_has_its_share_of_what_may_be_decoded(tmp_path):
    for name in ("uav1", "uav2"):
        encoded(written(tmp_path / "all.avi", panning(30)), tmp_path / f"{name}.avi", "-g", "30")
    for frames, shown in ((12, {"uav1"}), (11, set())):
        enough = dataclasses.replace(SETTINGS, decoded_px=2 * frames * 160 * 120)
        found = with_pictures(flight_of(tmp_path), results_of(30, from_frame=12), settings=enough)
        assert ("uav1" in {p.camera for p in found.pictures}) == ("uav1" in shown)
        assert "uav2" in {p.camera for p in found.pictures}
