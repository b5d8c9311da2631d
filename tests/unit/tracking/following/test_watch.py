"""Two who watch one target: a walker whose look changes is held by its box, and a post in front is not the target."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.records import Box
from pipeline.tracking import TrackingSettings, track_video
from pipeline.tracking.following import watch as watching
from pipeline.tracking.following.follow import hide
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene
from pipeline.tracking.settings import WATCH
from tests.scenes.video import written

SIZE, BODY, FRAMES = (480, 160), (20, 44), 60


def ground() -> np.ndarray:
    rng = np.random.default_rng(8)
    coarse = rng.uniform(90, 150, (SIZE[1] // 5 + 2, SIZE[0] // 5 + 80, 3)).astype(np.float32)
    return cv2.resize(coarse, (SIZE[0] + 200, SIZE[1]), interpolation=cv2.INTER_CUBIC)


def centre(frame: int) -> np.ndarray:
    return np.array([60.0 + 5.0 * frame, 80.0])


def walk(*, post: bool) -> Iterator[np.ndarray]:
    """A striped body whose stripes and legs change as it walks; with `post` something still stands in its way."""
    rng = np.random.default_rng(9)
    scene = ground()
    for frame in range(FRAMES):
        picture = scene[:, frame : frame + SIZE[0]].copy()
        x, y = np.rint(centre(frame) - (np.array(BODY) - 1) / 2).astype(int)
        stride = round(7 * np.sin(frame * 0.9))
        bend = round(3 * np.sin(frame * 0.35))
        picture[y : y + 10, x + 6 + bend : x + 14 + bend] = (40, 60, 90)
        for row in range(4):
            shade = 220 if (row + frame // 8) % 2 else 40
            picture[y + 10 + 4 * row : y + 14 + 4 * row, x + 2 : x + 18] = (shade, 40, 255 - shade)
        picture[y + 26 : y + 44, x + 6 + stride : x + 10 + stride] = (30, 20, 20)
        picture[y + 26 : y + 44, x + 10 - stride : x + 14 - stride] = (30, 20, 20)
        if post:
            left = 260 - frame
            picture[20:140, left : left + 40] = scene[20:140, 420:460]
        yield np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


def followed(tmp_path: Path, post: bool):
    path = written(tmp_path / "a.avi", walk(post=post), "FFV1", 10.0, SIZE)
    x, y = centre(0) - (np.array(BODY) - 1) / 2
    return track_video(path, camera="c", boxes={"who": Box(frame=0, x=x, y=y, width=BODY[0], height=BODY[1])})


def test_a_walker_is_held_and_each_fix_says_what_it_is_worth(tmp_path: Path) -> None:
    found = followed(tmp_path, post=False)
    track = found.tracks[0]
    off = np.abs(track.xy_px - np.array([centre(f) for f in range(FRAMES)]))
    assert track.seen.mean() >= 0.9
    assert (off[track.seen] < np.array(BODY) / 2).all()
    if track.by_box.any():
        assert track.sigma_px[track.by_box].min() >= 0.1 * np.sqrt(np.prod(BODY)) * 0.7
        assert any("middle of its box" in note for note in found.notes)


def test_what_stands_in_the_way_is_not_the_target(tmp_path: Path) -> None:
    track = followed(tmp_path, post=True).tracks[0]
    off = np.abs(track.xy_px - np.array([centre(f) for f in range(FRAMES)]))
    inside = (off < np.array(BODY) / 2 + 0.5).all(axis=1)
    assert track.seen.sum() >= 20
    assert inside[track.seen].all()


@pytest.mark.parametrize(
    ("likeness", "dim_s", "held"), [(0.3, 0.1, True), (0.3, 2 * WATCH.blind_s, False), (0.1, 0.1, False)]
)
def test_a_box_that_looks_dim_for_a_moment_is_held_and_says_nothing(monkeypatch, likeness, dim_s, held) -> None:
    pixels = next(walk(post=False))
    x, y = centre(0) - (np.array(BODY) - 1) / 2
    scene = Scene(frame=0, time_s=0.0, pixels=pixels, dt_s=0.1, cur_from_prev=np.eye(3), keys=())
    box, settings = Box(frame=0, x=x, y=y, width=BODY[0], height=BODY[1]), TrackingSettings()
    alone, _ = watching.begin_watch(scene, box, settings, None)
    alone = changed(
        alone,
        surface=changed(hide(alone.surface, 1.0), usual=np.array([0.85, 0.9])),
        together=False,
        trail=changed(alone.trail, velocity=np.array([5.0, 0.0])),
    )
    real = watching.look_box
    monkeypatch.setattr(watching, "look_box", lambda *given: changed(real(*given), likeness=likeness))
    later = changed(scene, frame=1, time_s=dim_s)
    after, seen = watching.watch(alone, later, settings)
    assert not [fix for fix in seen.fixes if fix.kind == "box"]
    assert (after.box is not None) is held
    if after.box is not None:
        np.testing.assert_array_equal(after.box.look, alone.box.look)


@pytest.mark.parametrize("doubtful", [True, False])
def test_what_box_and_surface_newly_differ_by_is_part_of_a_doubtful_fix(monkeypatch, doubtful) -> None:
    pixels = next(walk(post=False))
    x, y = centre(0) - (np.array(BODY) - 1) / 2
    scene = Scene(frame=0, time_s=0.0, pixels=pixels, dt_s=0.1, cur_from_prev=np.eye(3), keys=())
    box, settings = Box(frame=0, x=x, y=y, width=BODY[0], height=BODY[1]), TrackingSettings()
    watched, _ = watching.begin_watch(scene, box, settings, None)
    usual = np.array([1.01 + WATCH.score_drop if doubtful else 0.95, 0.9])
    watched = changed(watched, surface=changed(watched.surface, usual=usual))
    real, aside = watching.look_box, np.array([0.3 * BODY[0], 0.0])

    def beside(*given):
        found = real(*given)
        return changed(found, centre_px=found.centre_px + aside)

    monkeypatch.setattr(watching, "look_box", beside)
    _, seen = watching.watch(watched, changed(scene, frame=1, time_s=1.0), settings)
    (fix,) = seen.fixes
    assert (fix.sigma_px > 0.2 * BODY[0]) is doubtful
