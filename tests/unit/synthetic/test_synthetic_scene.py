"""Scenes: clocks, paths, what a bridge hides, and the demo's own promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import LOST
from pipeline.synthetic.demo_scenes import demo_scene, small_scene
from pipeline.synthetic.scene import Bridge, Path, pixels_of, polynomial_motion
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import true_flight
from pipeline.synthetic.vehicles import outline_enu_m


def test_frame_time_is_paper_eq_2():
    camera = demo_scene().cameras[1]
    assert camera.frame_time_s(np.array([0, 1251])) == pytest.approx([1.6137, 1.6137 + 1251 / 25.02])


def test_first_camera_is_common_time():
    scene = paper_scene()
    late = replace(scene.cameras[0], offset_s=0.3)
    with pytest.raises(ValueError, match="common time"):
        replace(scene, cameras=(late, scene.cameras[1]))


def test_polynomial_is_the_paper_s():
    rows = np.array([[1.0, 2, 3], [4, 5, 6], [0.5, -0.25, 0.1]])
    motion = polynomial_motion("x", rows, (-2.0, 9.0))
    at = np.array([-2.0, 0.0, 3.3, 9.0])
    assert motion.position_enu_m(at) == pytest.approx(np.vander(at, 3, increasing=True) @ rows)
    assert motion.power_coefficients() == pytest.approx(rows)


def test_still_target_stays():
    motion = polynomial_motion("x", np.array([[1.0, 2.0, 3.0]]), (0.0, 4.0))
    assert motion.position_enu_m(np.array([0.0, 2.0, 3.9])) == pytest.approx(np.tile([1.0, 2.0, 3.0], (3, 1)))


def test_path_passes_its_samples_and_knows_its_rate():
    time = np.arange(0.0, 3.0, 0.05)
    path = Path(time_s=time, value=np.stack([np.sin(time), np.cos(time)], axis=1))
    at = np.array([0.31, 1.77])
    assert path(at)[:, 0] == pytest.approx(np.sin(at), abs=1e-7)
    assert path.rate(at)[:, 0] == pytest.approx(np.cos(at), abs=1e-5)


def test_bridge_hides_what_is_behind_its_deck():
    bridge = Bridge(centre_enu_m=(10.0, 0.0, 6.0), heading_rad=0.0, length_m=30.0, width_m=8.0)
    camera = np.array([[10.0, 0.0, 100.0]])
    points = np.array([[10.0, 0.0, 1.0], [14.5, 0.0, 1.0], [10.0, 14.0, 1.0], [10.0, 0.0, 7.0]])
    assert bridge.hides(np.repeat(camera, 4, axis=0), points).tolist() == [True, False, True, False]


@pytest.mark.parametrize("seed", [7, 1, 2])
def test_demo_keeps_its_promises(seed):
    scene = demo_scene(seed)
    truth = true_flight(scene)
    for camera in scene.cameras:
        assert (camera.frames, camera.lens.image_size, camera.nominal_rate) == (500, (1280, 720), 25.0)
    for pose in truth.poses:
        assert 280 < np.linalg.norm(pose.position_enu_m, axis=1).mean() < 320
    for track in truth.tracks:
        hidden = track.state == LOST
        assert hidden.mean() < 0.08 if track.target == "van" else not hidden.any()
    hidden_s = [(t.state == LOST).sum() / 25 for t in truth.tracks if t.target == "van"]
    assert all(0.8 < s < 1.8 for s in hidden_s)


def test_small_flight_shows_every_vehicle_and_returns_it_from_under_the_bridge():
    truth = true_flight(small_scene())
    for track in truth.tracks:
        assert track.seen.mean() > 0.75
        assert track.seen[-20:].all()
        assert track.seen[:20].all()


def test_demo_vehicles_are_12_to_45_pixels_long():
    scene = demo_scene()
    for camera in scene.cameras:
        for target in scene.targets:
            for frame in (0, 250, 499):
                when = camera.frame_time_s(np.array([frame]))[0]
                corners = outline_enu_m(target, float(when))
                pixels, _ = pixels_of(camera, np.full(4, frame), corners)
                length = max(np.linalg.norm(pixels[i] - pixels[j]) for i in range(4) for j in range(i))
                assert 12 < length < 48


def test_vehicles_never_touch():
    truth = true_flight(demo_scene())
    places = [t.position_enu_m for t in truth.trajectories]
    gaps = [np.linalg.norm(places[i] - places[j], axis=1).min() for i in range(4) for j in range(i)]
    assert min(gaps) > 4.0


def test_seed_changes_the_sway_and_nothing_else():
    one, two = true_flight(demo_scene(1)), true_flight(demo_scene(2))
    assert np.array_equal(one.trajectories[0].position_enu_m, two.trajectories[0].position_enu_m)
    assert not np.allclose(one.poses[1].enu_from_cam, two.poses[1].enu_from_cam, atol=1e-4)
