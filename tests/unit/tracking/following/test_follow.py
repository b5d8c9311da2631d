"""Following over still ground: finds that do not hold, boxes that lie half under something."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.records import Box
from pipeline.tracking import track_video
from pipeline.tracking.following.follow import begin, follow
from pipeline.tracking.scene.background import scenes
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.target.track_state import Fix, TrackState
from pipeline.tracking.video.frames import Frame
from tests.scenes.video import written

SIZE, CAR, SPEED = (420, 160), (24, 16), 2.5
BAR = 180, 240  # columns that hide what is behind them
FLASH = (74, 75)  # frames on which something that looks like the car shows up, which does not stay


@pytest.fixture(scope="module")
def looks() -> tuple[np.ndarray, np.ndarray]:
    """The ground, and a car."""
    rng = np.random.default_rng(5)
    coarse = rng.uniform(70, 150, (SIZE[1] // 9 + 3, SIZE[0] // 9 + 3, 3)).astype(np.float32)
    ground = cv2.resize(coarse, SIZE, interpolation=cv2.INTER_CUBIC)
    car = cv2.resize(rng.uniform(20, 235, (4, 6, 3)).astype(np.float32), CAR, interpolation=cv2.INTER_NEAREST)
    return ground, car


def place(frame: int) -> np.ndarray:
    """Centre of the car."""
    return np.array([40.5 + SPEED * frame, 80.5])


def frames(looks: tuple[np.ndarray, np.ndarray], count: int, flash: bool) -> Iterator[Frame]:
    """A car that passes behind a bar; with `flash` another of its look shows for two frames while it is hidden."""
    ground, car = looks
    rng = np.random.default_rng(6)
    for index in range(count):
        picture = laid(ground, car, place(index))
        picture[:, BAR[0] : BAR[1]] = (90, 95, 100)
        if flash and index in FLASH:
            picture = laid(picture, car, place(index) + np.array([-6.0, 21.0]))
        noisy = picture + rng.normal(0, 2, picture.shape)
        yield Frame(index=index, time_s=index / 25.0, pixels=np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def laid(picture: np.ndarray, car: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """The picture with the car at a place."""
    corner = centre - (np.array(CAR) - 1) / 2
    move = np.array([[1, 0, corner[0]], [0, 1, corner[1]]])
    share = cv2.warpAffine(np.ones(car.shape[:2], np.float32), move, SIZE)[:, :, None]
    return picture * (1 - share) + cv2.warpAffine(car, move, SIZE) * share


def followed(video: Iterator[Frame], settings: TrackingSettings | None = None) -> tuple[list[Fix], list[TrackState]]:
    """Every fix, and the target after every frame."""
    settings = settings or TrackingSettings()
    fixes, states, target = list[Fix](), list[TrackState](), None
    x, y = place(0) - np.array(CAR) / 2 + 0.5
    for scene in scenes(video):
        if target is None:
            target, first = begin(scene.pixels, Box(frame=0, x=x, y=y, width=CAR[0], height=CAR[1]), settings)
            fixes.append(first)
        else:
            target, new = follow(target, scene, settings)
            fixes += new
        states.append(target)
    return fixes, states


def test_a_find_that_does_not_hold_leaves_the_target_on_its_own_course(looks) -> None:
    fixes, states = followed(frames(looks, 120, flash=True))
    assert any(state.doubt is not None for state in states[FLASH[0] : FLASH[1] + 1])  # it was taken for the car
    after = states[FLASH[1] + 3]
    assert after.hidden
    assert np.abs(after.course.position_px - place(FLASH[1] + 3)).max() < 12.0
    assert after.course.sigma_px > 4.0
    assert not [fix for fix in fixes if FLASH[0] <= fix.frame <= FLASH[1]]
    seen = np.array([fix.frame for fix in fixes])
    assert set(range(92, 120)) <= set(seen.tolist())
    assert max(np.abs(np.array(fix.xy_px) - place(fix.frame)).max() for fix in fixes) < 0.5


def test_a_mistaken_find_costs_nothing(looks) -> None:
    with_flash, without = (followed(frames(looks, 110, flash=flash))[0] for flash in (True, False))
    assert {fix.frame for fix in with_flash} == {fix.frame for fix in without}


def test_few_pixels_are_not_looked_for_for_long(looks) -> None:
    fixes, states = followed(frames(looks, 120, flash=False), TrackingSettings(telling_px=400.0))
    assert states[-1].gone
    assert max(fix.frame for fix in fixes) < 75


@pytest.mark.parametrize("step", [1e-15, -1e-15])
def test_no_decision_hangs_on_how_times_are_rounded(looks, step) -> None:
    rounded, raw = (
        followed(replace(f, time_s=f.time_s + off * f.index) for f in frames(looks, 110, flash=True))[0]
        for off in (0.0, step)
    )
    assert [fix.frame for fix in rounded] == [fix.frame for fix in raw]
    np.testing.assert_allclose([f.xy_px for f in rounded], [f.xy_px for f in raw], atol=1e-6)


@pytest.mark.parametrize("drawn", [85, 87, 90])
def test_a_box_beside_what_hides_the_target_is_followed_back_only_as_far_as_it_is_seen(looks, tmp_path, drawn) -> None:
    path = written(tmp_path / "a.avi", (frame.pixels for frame in frames(looks, 120, flash=False)), size=SIZE)
    x, y = place(drawn) - np.array(CAR) / 2 + 0.5
    box = Box(frame=drawn, x=x, y=y, width=CAR[0], height=CAR[1])
    track = track_video(path, camera="c", boxes={"car": box}).tracks[0]
    off = np.abs(track.xy_px - [place(int(f)) for f in track.frame]).max(axis=1)
    assert off[track.seen].max() < 1.0
    assert track.seen[track.frame < 50].all()
    assert not track.seen[(track.frame > 60) & (track.frame < 68)].any()


def test_what_was_learned_forwards_is_known_from_the_start_backwards(looks) -> None:
    known = followed(frames(looks, 50, flash=False))[1][-1]
    assert not known.new
    picture = next(frames(looks, 1, flash=False)).pixels
    x, y = place(0) - np.array(CAR) / 2 + 0.5
    again, _ = begin(picture, Box(frame=0, x=x, y=y, width=CAR[0], height=CAR[1]), TrackingSettings(), known)
    fresh, _ = begin(picture, Box(frame=0, x=x, y=y, width=CAR[0], height=CAR[1]), TrackingSettings())
    assert not again.new
    assert np.array_equal(again.template.own, known.template.own)
    assert np.array_equal(again.template.pixels, fresh.template.pixels)  # the point is that of the box
    assert again.course.sigma_px == fresh.course.sigma_px
