"""Simulated measurements: exact without noise, and as noisy as they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_HIGH, Noise, simulate

EXACT = Noise(pixel_px=0.0)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_without_noise_every_ray_meets_its_target(order):
    scene = paper_scene(order=order, targets=4, offset_frames=7)
    problem, truth = simulate(scene, noise=EXACT, seed=0)
    for given in problem.cameras:
        time = given.rays.frame / truth.frame_rate[given.camera] + truth.offset_s[given.camera]
        row = np.searchsorted(given.poses.frame, given.rays.frame)
        for index, target in enumerate(given.rays.targets):
            mine = given.rays.target == index
            motion = next(t.motion for t in scene.targets if t.name == target)
            sight = motion.position_enu_m(time[mine]) - given.poses.position_enu_m[row[mine]]
            ray = rotation.rotate(given.poses.enu_from_cam[row[mine]], given.rays.direction_cam[mine])
            assert np.abs(np.cross(ray, sight)).max() < 1e-6
            assert (np.einsum("ij,ij->i", ray, sight) > 0).all()


def test_the_user_is_told_what_the_scene_says():
    problem, truth = simulate(paper_scene(offset_frames=4, given_rate_hz=9.0), noise=PAPER_HIGH, seed=3)
    assert truth.offset_s == {"uav1": 0.0, "uav2": 0.4}
    assert truth.frame_rate == {"uav1": 10.0, "uav2": 10.0}
    assert [c.frame_rate for c in problem.cameras] == [10.0, 9.0]
    assert [c.offset_s for c in problem.cameras] == [0.0, 0.0]
    second = problem.cameras[1]
    assert np.allclose(second.rays.time_s * 9.0, second.rays.frame)
    blind, _ = simulate(paper_scene(given_offset_s=None), noise=PAPER_HIGH, seed=3)
    assert blind.cameras[1].offset_s is None


def test_offset_guess_carries_its_sigma():
    guess = [
        simulate(paper_scene(), noise=replace(PAPER_HIGH, offset_s=0.2), seed=s)[0].cameras[1].offset_s
        for s in range(60)
    ]
    assert 0.14 < np.std(np.array(guess, float) - 0.5) < 0.26


def test_same_seed_same_numbers_other_seed_others():
    scene = paper_scene(targets=2)
    first, again, other = (simulate(scene, noise=PAPER_HIGH, seed=s)[0] for s in (5, 5, 6))
    for a, b in zip(first.cameras, again.cameras, strict=True):
        assert np.array_equal(a.rays.direction_cam, b.rays.direction_cam)
        assert np.array_equal(a.poses.enu_from_cam, b.poses.enu_from_cam)
    assert not np.array_equal(first.cameras[0].rays.direction_cam, other.cameras[0].rays.direction_cam)


def test_noise_is_as_large_as_it_says():
    scene = paper_scene(targets=4)
    pixel, turn_bias, turn, shift_bias, shift = [], [], [], [], []
    for seed in range(40):
        problem, truth = simulate(scene, noise=PAPER_HIGH, seed=seed)
        exact, _ = simulate(scene, noise=EXACT, seed=seed)
        for given, clean, pose in zip(problem.cameras, exact.cameras, truth.poses, strict=True):
            off = given.rays.pixel_from_ray @ (given.rays.direction_cam - clean.rays.direction_cam)[:, :, None]
            pixel.append(off.ravel())
            error = rotation.log(rotation.multiply(rotation.conjugate(pose.enu_from_cam), given.poses.enu_from_cam))
            turn_bias.append(error.mean(0))
            turn.append((error - error.mean(0)).ravel())
            gap = pose.position_enu_m - given.poses.position_enu_m
            shift_bias.append(gap.mean(0))
            shift.append((gap - gap.mean(0)).ravel())
    half = np.radians(0.5)
    assert np.std(np.concatenate(pixel)) == pytest.approx(2.0, rel=0.03)
    assert np.std(np.concatenate(turn)) == pytest.approx(half * np.sqrt(49 / 50), rel=0.03)
    assert np.std(np.concatenate(shift)) == pytest.approx(np.sqrt(49 / 50), rel=0.03)
    assert np.std(turn_bias) == pytest.approx(half, rel=0.15)
    assert np.std(shift_bias) == pytest.approx(3.0, rel=0.15)


def test_true_cam_from_enu_is_the_turn_times_the_measured_one():
    """The sense of the rotation error is that of records.Bias."""
    noise = Noise(attitude_bias_rad=0.02)
    problem, truth = simulate(paper_scene(), noise=noise, seed=1)
    true, measured = truth.poses[1].enu_from_cam, problem.cameras[1].poses.enu_from_cam
    turn = rotation.multiply(rotation.conjugate(true), measured)
    assert np.ptp(rotation.log(turn), axis=0).max() < 1e-12
    assert np.linalg.norm(rotation.log(turn)[0]) > 0.005
    back = rotation.multiply(turn, rotation.conjugate(measured))
    assert np.abs(np.abs((back * rotation.conjugate(true)).sum(1)) - 1).max() < 1e-12
