"""Matching finds common targets among strangers, finds the clocks, and says what it cannot know."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.matching import MatchSettings, match_tracks
from tests.scenes.matching import camera, parked, paths, scene

SETTINGS = MatchSettings(search_s=8.0)


def told(found):
    return [(pair.first, pair.second) for pair in found.pairs]


@pytest.mark.parametrize("seed", [1, 2])
def test_common_targets_are_found_among_strangers(seed):
    cameras, truth = scene(seed)
    found = match_tracks(cameras, SETTINGS)
    right = [truth[a.camera][a.target] == truth[b.camera][b.target] for a, b in told(found)]
    assert all(right)
    assert len(right) == 4
    assert all(pair.margin >= SETTINGS.sure for pair in found.pairs)


def test_the_clocks_are_found_with_them():
    cameras, truth = scene(1)
    clock = match_tracks(cameras, SETTINGS).clocks[1]
    assert clock.camera == "uav2"
    assert abs(clock.offset_s - truth["uav2", "begin_s"]) < max(0.2, 4 * clock.sigma_s)
    assert clock.sigma_s < 0.3


def test_three_cameras_agree_on_groups():
    cameras, truth = scene(3, cameras=3, common=3, strangers=1)
    found = match_tracks(cameras, SETTINGS)
    groups = [target for target in found.targets if len(target.tracks) > 1]
    for group in groups:
        assert len({truth[t.camera][t.target] for t in group.tracks}) == 1
        assert len({t.camera for t in group.tracks}) == len(group.tracks)
    assert sum(len(group.tracks) == 3 for group in groups) >= 2
    every = [track for target in found.targets for track in target.tracks]
    assert len(every) == len(set(every)) == 12


def test_strangers_only_are_left_apart():
    cars = paths(5, 6)
    one = camera("uav1", {f"a{k}": cars[k] for k in range(3)}, begin_s=0.0, bearing_rad=0.0, seed=1)
    other = camera("uav2", {f"b{k}": cars[3 + k] for k in range(3)}, begin_s=2.0, bearing_rad=1.5, seed=2)
    found = match_tracks([one, other], SETTINGS)
    assert not found.pairs
    assert len(found.targets) == 6


def test_parked_cars_tell_no_clock():
    """They fit at every offset: who is who may be known, when is not."""
    cars = parked(2, 4)
    one = camera("uav1", {f"a{k}": cars[k] for k in range(4)}, begin_s=0.0, bearing_rad=0.0, seed=1)
    other = camera("uav2", {f"b{k}": cars[k] for k in range(4)}, begin_s=2.0, bearing_rad=1.5, seed=2)
    found = match_tracks([one, other], SETTINGS)
    assert all(a.target[1] == b.target[1] for a, b in told(found))
    assert found.clocks[1].offset_s is None


def test_a_known_clock_is_used():
    cameras, truth = scene(1)
    right = truth["uav2", "begin_s"]
    known = replace(cameras[1], offset_s=right - 7)
    found = match_tracks([cameras[0], known], MatchSettings(search_s=1.0))
    assert not found.pairs  # looked for only where the flight says it is


def test_the_same_input_gives_the_same_answer():
    cameras, _ = scene(2, common=2, strangers=1)
    one, other = (match_tracks(cameras, SETTINGS) for _ in range(2))
    assert one.targets == other.targets
    assert np.isclose(one.score, other.score)


def cut(camera, low_s, high_s):
    """A camera's tracks of a part of its video."""
    rays = camera.rays
    kept = (rays.time_s >= low_s) & (rays.time_s <= high_s)
    fields = ("target", "frame", "time_s", "direction_cam", "pixel_from_ray", "sigma_px")
    return replace(camera, rays=replace(rays, **{name: getattr(rays, name)[kept] for name in fields}))


def test_cameras_that_look_one_after_the_other_do_not_part_a_third_from_them():
    """Two cameras with no second in common both see targets that a third sees throughout."""
    cameras, truth = scene(3, cameras=3, common=3, strangers=1)
    begin = {c.camera: truth[c.camera, "begin_s"] for c in cameras}
    middle = np.mean([begin[c.camera] + c.rays.time_s.mean() for c in cameras])
    first, second, third = cameras
    parted = (
        cut(first, -np.inf, middle - 0.8 - begin[first.camera]),
        cut(second, middle + 0.8 - begin[second.camera], np.inf),
        third,
    )
    pairs = told(match_tracks(parted, SETTINGS))
    assert all(truth[a.camera][a.target] == truth[b.camera][b.target] for a, b in pairs)
    with_third = {a.camera for a, b in pairs if b.camera == third.camera}
    assert with_third == {first.camera, second.camera}
