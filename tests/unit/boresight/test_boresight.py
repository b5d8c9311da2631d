"""Boresight against drawn flights: the truth within the claimed covariance, and a target that tells nothing refused."""

import numpy as np
import pytest

from pipeline.boresight.adjust import Known, find_boresight
from pipeline.geometry import rotation
from pipeline.records import InstrumentSigma, PoseTrack, SightRays

FOCAL_PX = 1000.0
SIGMA = InstrumentSigma(attitude_rad=np.radians(0.2), position_bias_m=0.5, position_m=0.2)
TARGET = np.array([5.0, -8.0, 1.0])


def attitude_at(time_s):
    """A camera that circles the target at 120 m and looks roughly at it, swinging."""
    swing = 0.15 * np.sin(0.9 * time_s)
    return rotation.enu_from_cam(
        rotation.ned_from_frd(-0.1 * time_s + swing, -0.4 + 0.1 * np.cos(1.3 * time_s), 0.2 * np.sin(0.5 * time_s))
    )


def place_at(time_s):
    heading = -0.1 * time_s
    out = np.stack([-np.sin(heading), -np.cos(heading), np.full_like(heading, 0.42)], axis=1)
    return TARGET + 120 * out


def flight(seed, turn_rad, start_s, frames=60):
    random = np.random.default_rng(seed)
    time = np.arange(frames) / 4.0
    bias = random.normal(0, SIGMA.position_bias_m, 3)
    wobble = random.normal(0, SIGMA.attitude_rad, (frames, 3))
    jitter = random.normal(0, SIGMA.position_m, (frames, 3))
    true_q = rotation.multiply(attitude_at(time + start_s), rotation.conjugate(rotation.exp(turn_rad + 0 * wobble)))
    true_q = rotation.multiply(true_q, rotation.exp(wobble))
    seen = rotation.rotate(rotation.conjugate(true_q), TARGET - (place_at(time + start_s) + bias + jitter))
    pixel = FOCAL_PX * seen[:, :2] / seen[:, 2:] + random.normal(0, 0.5, (frames, 2))
    ray = np.column_stack([pixel / FOCAL_PX, np.ones(frames)])
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    x, y, z = ray.T
    zero = np.zeros(frames)
    by_ray = np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], 1) * FOCAL_PX
    rays = SightRays(
        camera="c", targets=("mast",), target=np.zeros(frames, int), frame=np.arange(frames), time_s=time,
        direction_cam=ray, pixel_from_ray=by_ray, sigma_px=np.full(frames, 0.5),
    )  # fmt: skip

    def poses_at(shift_s):
        return PoseTrack(
            camera="c", frame=np.arange(frames), time_s=time + shift_s, position_enu_m=place_at(time + shift_s),
            enu_from_cam=attitude_at(time + shift_s),
        )  # fmt: skip

    return rays, Known(place_enu_m=np.tile(TARGET, (frames, 1)), sigma_m=0.05), poses_at


def test_error_over_sigma_is_one_for_every_angle_and_for_the_time():
    turn, start = np.array([0.05, -0.3, 0.12]), 0.08
    pulls = []
    for seed in range(24):
        found = find_boresight(*flight(seed, turn, start), SIGMA, start_sigma_s=1.0)
        off = rotation.log(rotation.multiply(rotation.exp(found.rotation_rad), rotation.exp(-turn)))
        error = np.array([*off, found.start_s - start])
        pulls.append(error / np.sqrt(np.diag(found.covariance)))
        assert 0.8 < found.misfit < 1.2
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (rms > 0.7).all()
    assert (rms < 1.35).all()


def test_a_held_start_has_no_variance():
    found = find_boresight(*flight(1, np.array([0.0, 0.02, 0.0]), 0.0), SIGMA, start_sigma_s=0.0)
    assert found.start_s == 0.0
    assert found.covariance[3, 3] == 0
    assert found.rotation_rad[1] == pytest.approx(0.02, abs=0.005)


def test_wild_frames_are_bounded():
    rays, known, poses_at = flight(2, np.array([0.0, 0.02, 0.0]), 0.0)
    direction, by_ray = rays.direction_cam.copy(), rays.pixel_from_ray.copy()
    direction[::20], by_ray[::20] = [0, 0, 1], [[FOCAL_PX, 0, 0], [0, FOCAL_PX, 0]]
    spoilt = SightRays(**{**vars(rays), "direction_cam": direction, "pixel_from_ray": by_ray})
    found = find_boresight(spoilt, known, poses_at, SIGMA, start_sigma_s=0.0)
    assert (found.weight[::20] < 0.5).all()
    assert np.abs(found.rotation_rad - [0, 0.02, 0]).max() < 0.01


def test_about_the_line_of_sight_to_a_target_in_one_place_nothing_is_known():
    rays, known, _ = flight(3, np.zeros(3), 0.0)
    still = np.zeros(60)

    def looking_at_it(shift_s):
        return PoseTrack(
            camera="c", frame=np.arange(60), time_s=np.arange(60) / 4.0,
            position_enu_m=TARGET + still[:, None] - [0, 90.0, 0],
            enu_from_cam=rotation.enu_from_cam(rotation.ned_from_frd(still, still, still)),
        )  # fmt: skip

    ahead = np.tile([0.0, 0.0, 1.0], (60, 1))
    by_ray = np.tile(np.array([[FOCAL_PX, 0, 0], [0, FOCAL_PX, 0]]), (60, 1, 1))
    rays = SightRays(**{**vars(rays), "direction_cam": ahead, "pixel_from_ray": by_ray})
    found = find_boresight(rays, known, looking_at_it, SIGMA, start_sigma_s=0.0)
    assert np.sqrt(found.covariance[2, 2]) > 0.5
    assert np.sqrt(found.covariance[0, 0]) < 0.02
