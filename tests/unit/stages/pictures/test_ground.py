"""The ground from above: frames of a drawn ground come back as that ground, right way up and in its place."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from calibration.camera import CameraModel, unproject
from pipeline.geometry import rotation
from pipeline.records import Ground, GroundHeights, PoseTrack
from pipeline.stages.pictures.films import evenly, film_of
from pipeline.stages.pictures.ground import Level, Mosaic, Sheet, level_of, pose_at
from pipeline.stages.pictures.settings import PictureSettings
from tests.scenes.report import fake_results

SETTINGS = PictureSettings()
CAMERA = CameraModel(
    image_size=(640, 360),
    K=np.array([[500.0, 0, 319.5], [0, 500.0, 179.5], [0, 0, 1]]),
    distortion=np.array([-0.12, 0.02, 0.0, 0.0, 0.0]),
)
UP = np.array([0.0, 0.0, 1.0])
SHEET = Sheet(west_m=-40.0, south_m=-30.0, east_m=40.0, north_m=30.0, size=(400, 300))


def colour(east, north):
    """Of the ground: 20 m squares, brighter to the north, redder to the east."""
    square = (np.floor(east / 20) + np.floor(north / 20)) % 2
    return np.stack([60 + 60 * square, 100 + 1.5 * north, 100 + 1.5 * east], axis=-1)


def seen_from(position, q, up):
    """What a camera at a pose sees of the level ground at `up`."""
    u, v = np.meshgrid(np.arange(640.0), np.arange(360.0))
    rays = rotation.rotate(q, unproject(CAMERA, np.stack([u.ravel(), v.ravel()], axis=1)))
    far = np.where(rays[:, 2] < 0, (up - position[2]) / rays[:, 2], np.nan)
    at = position + far[:, None] * rays
    shown = np.nan_to_num(colour(at[:, 0], at[:, 1]), nan=255.0)
    return np.clip(shown, 0, 255).reshape(360, 640, 3).astype(np.uint8)


def pose(east, north, up, yaw_deg, pitch_deg):
    q = rotation.enu_from_cam(rotation.ned_from_frd(*np.radians([yaw_deg, pitch_deg, 0.0])))
    return np.array([east, north, up]), q


def decoded(webp):
    return cv2.imdecode(np.frombuffer(webp, np.uint8), cv2.IMREAD_UNCHANGED).astype(float)


@pytest.mark.parametrize("up", [0.0, 12.5])
def test_the_ground_comes_back_in_its_place(up):
    mosaic = Mosaic(SHEET, Level(at=lambda p: np.full(len(p), up), words="level"))
    for where in (pose(-50, -60, up + 50, 30, -40), pose(60, -40, up + 60, -50, -45), pose(0, 0, up + 40, 0, -90)):
        mosaic.add(seen_from(*where, up), CAMERA, *where)
    found = mosaic.picture("words", SETTINGS)
    assert (found.west_m, found.north_m, found.words) == (-40.0, 30.0, "words")
    shown = decoded(found.webp)
    east, north = SHEET.places(1)
    clear = shown[..., 3] > 250
    assert clear.mean() > 0.5
    edge = np.minimum(np.abs((east + 10) % 20 - 10), np.abs((north + 10) % 20 - 10)) < 1.5  # of a square
    away = np.abs(shown[..., :3] - colour(east, north)).max(axis=2)
    assert np.median(away[clear & ~edge]) < 5
    assert np.quantile(away[clear & ~edge], 0.97) < 25
    other = np.abs(shown[::-1, :, :3] - colour(east, north)).max(axis=2)
    assert np.median(other[clear & ~edge]) > 15


def test_what_no_camera_sees_well_is_clear():
    mosaic = Mosaic(SHEET, Level(at=lambda p: np.zeros(len(p)), words="level"))
    where = pose(-200, 0, 6, 90, -2)  # grazing
    mosaic.add(seen_from(*where, 0.0), CAMERA, *where)
    assert mosaic.picture("words", SETTINGS) is None
    where = pose(-30, 0, 20, 0, -90)
    mosaic.add(seen_from(*where, 0.0), CAMERA, *where)
    shown = decoded(mosaic.picture("words", SETTINGS).webp)
    assert (shown[:, 300:, 3] == 0).all()
    assert (shown[140:160, 40:60, 3] > 250).all()


def test_the_level_is_the_grounds_own_else_the_targets():
    results = fake_results(seconds=4)
    own = Ground(
        at=lambda p: GroundHeights(up_m=p[:, 0] / 10, slope=np.zeros((len(p), 2)), rough_m=np.zeros(len(p)),
                                   known=np.ones(len(p), bool)),
        sigma_m=1.0, common_m=0.5, cell_m=30.0, source="dem.tif",
    )  # fmt: skip
    level = level_of(results, own)
    assert level.at(np.array([[50.0, 0.0]])) == pytest.approx([5.0])
    assert "dem.tif" in level.words
    middle = level_of(results, None)
    heights = np.concatenate([t.position_enu_m[:, 2] for t in results.trajectories])
    assert middle.at(np.zeros((1, 2))) == pytest.approx([np.median(heights)])


def test_targets_that_fly_are_no_ground():
    results = fake_results(seconds=4)
    apart = [dataclasses.replace(t, position_enu_m=t.position_enu_m + 40.0 * i * UP)
             for i, t in enumerate(results.trajectories)]  # fmt: skip
    assert "no [ground] says" in level_of(dataclasses.replace(results, trajectories=tuple(apart)), None)
    above = [dataclasses.replace(t, position_enu_m=t.position_enu_m + 500.0 * UP) for t in results.trajectories]
    assert "no camera looks down" in level_of(dataclasses.replace(results, trajectories=tuple(above)), None)


def test_poses_between_frames():
    q = np.stack([rotation.ned_from_frd(0.0, 0.0, 0.0), rotation.ned_from_frd(0.2, 0.0, 0.0)])
    track = PoseTrack(
        camera="a", frame=np.array([10, 20]), time_s=np.array([0.0, 1.0]),
        position_enu_m=np.array([[0.0, 0, 0], [10.0, 0, 0]]), enu_from_cam=q,
    )  # fmt: skip
    place, turned = pose_at(track, 15)
    assert place == pytest.approx([5.0, 0, 0])
    assert abs(turned @ rotation.ned_from_frd(0.1, 0.0, 0.0)) == pytest.approx(1.0)
    assert pose_at(track, 9) is None
    assert pose_at(track, 21) is None


def test_films_are_evenly_over_the_flight_coarse_first():
    time = np.arange(1000) / 25
    frames = evenly(time, (10.0, 30.0), 16)
    assert set(frames[:2]) == {250, 517}
    assert np.ptp(np.diff(sorted(frames))) <= 1
    assert (min(frames), max(frames), len(frames)) == (250, 750, 16)
    assert evenly(time, (100.0, 200.0), 16) == []
    assert sorted(evenly(time[:5], (0.0, 1.0), 16)) == [0, 1, 2, 3, 4]


def test_a_film_keeps_within_its_bytes_and_marks_what_was_tracked():
    results = fake_results(seconds=4)
    found = {f: (bytes(1000), (160, 90)) for f in range(0, 80, 10)}
    film = film_of("uav1", np.arange(100) / 25, found, results.tracks, (1280, 720), 4500)
    assert film.frame == (0, 20, 40, 60)
    assert film.time_s == pytest.approx([0, 0.8, 1.6, 2.4])
    own = {t.target: t for t in results.tracks if t.camera == "uav1"}
    for frame, marks in zip(film.frame, film.marks, strict=True):
        assert {m[0] for m in marks} == {n for n, t in own.items() if t.seen[frame]}
        for name, x, y in marks:
            assert (x * 1280, y * 720) == pytest.approx(own[name].xy_px[frame] + 0.5, abs=0.1)
    assert film_of("uav1", np.arange(100) / 25, {}, results.tracks, (1280, 720), 4500) is None
