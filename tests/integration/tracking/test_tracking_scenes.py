"""Whole videos with known truth: accuracy, honest sigmas, occlusion, determinism."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.records import LOST, REACQUIRED, Box
from pipeline.synthetic.moving_cars import Scene, first_box, render, scene, truth, write
from pipeline.tracking import TrackingSettings, VideoTracks, overlay_frame, track_video, write_overlay

SEED, FRAMES, SIZE = 31, 110, (480, 320)
HIDDEN, VISIBLE = 0.1, 0.9


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path, dict[str, Box], VideoTracks]:
    made = scene(SEED, frames=FRAMES, size=SIZE, lengths=(22, 34), hidden=(8, 12))
    path = tmp_path_factory.mktemp("scene") / "scene.avi"
    write(render(made), path, codec="MJPG")
    boxes = {car.name: first_box(made, car) for car in made.cars}
    return made, path, boxes, track_video(path, camera="uav1", boxes=boxes)


def test_centres_are_within_a_quarter_of_a_pixel(flight) -> None:
    made, _, boxes, found = flight
    for car, track in zip(made.cars, found.tracks, strict=True):
        true_px, share = truth(made, car, boxes[car.name])
        good = track.seen & (share > VISIBLE)
        assert good.sum() >= 0.95 * (share > VISIBLE).sum()
        rms = np.sqrt(np.mean((track.xy_px[good] - true_px[good]) ** 2, axis=0))
        assert (rms < 0.25).all(), (car.name, rms)


def test_sigmas_are_honest(flight) -> None:
    made, _, boxes, found = flight
    normed = []
    for car, track in zip(made.cars, found.tracks, strict=True):
        true_px, share = truth(made, car, boxes[car.name])
        good = track.seen & (share > VISIBLE)
        normed.append((track.xy_px[good] - true_px[good]) / track.sigma_px[good, None])
    assert 0.4 < np.sqrt(np.mean(np.concatenate(normed) ** 2)) < 1.8


def test_hidden_targets_are_lost_and_found_again(flight) -> None:
    made, _, boxes, found = flight
    for car, track in zip(made.cars, found.tracks, strict=True):
        _, share = truth(made, car, boxes[car.name])
        hidden = np.flatnonzero(share < HIDDEN)
        assert len(hidden) > 3
        assert not track.seen[hidden].any()
        assert (track.state[hidden] == LOST).all()
        assert np.isnan(track.xy_px[hidden]).all()
        assert np.isnan(track.sigma_px[hidden]).all()
        after = np.flatnonzero(track.seen & (np.arange(FRAMES) > hidden[-1]))
        assert track.state[after[0]] == REACQUIRED
        assert (track.state == REACQUIRED).sum() == 1


@pytest.mark.parametrize("at", [10, 100])
def test_a_box_on_any_frame_is_tracked_both_ways(flight, at) -> None:
    made, path, _, _ = flight
    box = first_box(made, made.cars[0], at)
    told: list[tuple[int, int]] = []
    found = track_video(path, camera="uav1", boxes={"late": box}, progress=lambda d, n: told.append((d, n)))
    track = found.tracks[0]
    assert track.frame.tolist() == list(range(FRAMES))
    assert tuple(track.xy_px[at]) == box.centre_px
    true_px, share = truth(made, made.cars[0], box)
    good = track.seen & (share > VISIBLE)
    assert good.sum() >= 0.95 * (share > VISIBLE).sum()
    assert (np.sqrt(np.mean((track.xy_px[good] - true_px[good]) ** 2, axis=0)) < 0.25).all()
    assert not track.seen[share < HIDDEN].any()
    np.testing.assert_allclose(track.time_s, np.arange(FRAMES) / 25.0, atol=2e-3)
    assert found.frame_rate == 25.0
    assert found.image_size == SIZE
    assert told[-1] == (FRAMES + at + 1, FRAMES + at + 1)


def test_same_input_same_output_whatever_the_threads(flight) -> None:
    _, path, boxes, found = flight
    threads = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        again = track_video(path, camera="uav1", boxes=boxes)
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(threads)
    alone = track_video(path, camera="uav1", boxes={"car2": boxes["car2"]})
    for a, b in zip((*found.tracks, found.tracks[1]), (*again.tracks, alone.tracks[0]), strict=True):
        assert a.xy_px.tobytes() == b.xy_px.tobytes()
        assert a.sigma_px.tobytes() == b.sigma_px.tobytes()
        assert a.state.tobytes() == b.state.tobytes()


def test_progress_counts_to_the_end(flight) -> None:
    _, path, boxes, _ = flight
    told: list[tuple[int, int]] = []
    track_video(path, camera="uav1", boxes={"car1": boxes["car1"]}, progress=lambda d, n: told.append((d, n)))
    assert told[0] == (1, FRAMES)
    assert told[-1] == (FRAMES, FRAMES)


def test_the_other_coarse_tracker_does_too(flight) -> None:
    made, path, boxes, _ = flight
    short = path.parent / "short.avi"
    write((f for f, _ in zip(render(made), range(25), strict=False)), short, codec="MJPG")
    found = track_video(short, camera="uav1", boxes=boxes, settings=TrackingSettings(tracker="csrt"))
    for car, track in zip(made.cars, found.tracks, strict=True):
        true_px, share = truth(made, car, boxes[car.name])
        good = track.seen & (share[:25] > VISIBLE)
        assert good.sum() > 20
        assert np.sqrt(np.mean((track.xy_px[good] - true_px[:25][good]) ** 2)) < 0.3


def test_overlay_draws_without_touching_the_frame(flight, tmp_path: Path) -> None:
    made, path, _, found = flight
    frame = next(iter(render(made)))
    before = frame.copy()
    drawn = overlay_frame(frame, found, 0)
    np.testing.assert_array_equal(frame, before)
    x, y = np.rint(found.tracks[1].xy_px[0]).astype(int)
    assert (drawn[y - 20 : y + 21, x - 20 : x + 21] != frame[y - 20 : y + 21, x - 20 : x + 21]).any()
    made_file = write_overlay(path, found, tmp_path / "overlay.mp4")
    capture = cv2.VideoCapture(str(made_file))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    assert [p.name for p in tmp_path.iterdir()] == ["overlay.mp4"]
