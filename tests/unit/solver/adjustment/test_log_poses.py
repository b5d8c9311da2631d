"""Poses of a log follow the clocks: read at steps, carried between them, and as far as the log goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.geometry import rotation
from pipeline.records import PoseTrack, Problem
from pipeline.solver.adjustment import log_poses
from pipeline.solver.observation.observations import pack
from scripts.validation.check_offset_search import random_flight

LOG_ENDS_S = 1.1


def logged(reads: list[float]) -> Problem:
    problem = random_flight(6).problem
    first = problem.cameras[0]
    time_s = first.poses.frame / first.frame_rate

    def at(shift: Floats) -> PoseTrack:
        if np.abs(shift).max() > LOG_ENDS_S:
            raise GeometryError(where="log", seen="it ends", expected="more", advice="none")
        reads.append(float(shift[0]))
        there = time_s + shift
        place = np.stack([3.0 * there, 0.2 * there**2, np.full(len(there), 50.0)], axis=1)
        turn = rotation.exp(np.stack([0 * there, 0 * there, 0.1 * there], axis=1))
        return replace(first.poses, position_enu_m=place, enu_from_cam=turn)

    start = replace(first, poses=at(np.zeros(len(time_s))), poses_at=at)
    reads.clear()
    return replace(problem, cameras=(start, *problem.cameras[1:]))


@pytest.mark.parametrize("shift", [0.04, 0.14, 0.31, -0.78])
def test_poses_move_with_the_log_time_and_each_step_is_read_once(shift: float) -> None:
    reads: list[float] = []
    problem = logged(reads)
    frames = pack(problem)
    readings = log_poses._Readings(problem)
    part = frames.of(0)
    moved = log_poses._moved(readings, frames, np.full(frames.count, shift), (0,))
    truth = problem.cameras[0].poses_at(np.full(part.stop - part.start, shift))  # type: ignore[misc]
    np.testing.assert_allclose(moved.position_m[part], truth.position_enu_m, atol=0.2 * log_poses.CARRIED_S**2 + 0.02)
    turned = rotation.matrix(rotation.conjugate(truth.enu_from_cam))
    np.testing.assert_allclose(moved.cam_from_enu[part], turned, atol=1e-9)
    count = len(reads)
    log_poses._moved(readings, frames, np.full(frames.count, shift + 0.01), (0,))
    assert len(reads) == count


def test_a_frame_stays_with_its_reading_until_it_is_well_past_the_middle() -> None:
    problem = logged([])
    frames = pack(problem)
    readings = log_poses._Readings(problem)
    part = frames.of(0)
    for shift, taken in ((0.12, 0.2), (0.06, 0.2), (0.04, 0.0), (0.14, 0.0), (0.16, 0.2)):
        frames = log_poses._moved(readings, frames, np.full(frames.count, shift), (0,))
        np.testing.assert_allclose(frames.pose_taken_s[part], taken)
        np.testing.assert_allclose(frames.pose_shift_s[part], shift)


def test_beyond_the_ends_of_the_log_poses_go_on_as_at_its_last_step() -> None:
    problem = logged([])
    frames = pack(problem)
    part = frames.of(0)
    moved = log_poses._moved(log_poses._Readings(problem), frames, np.full(frames.count, 3.0), (0,))
    np.testing.assert_allclose(moved.pose_taken_s[part], 1.0)
    time_s = problem.cameras[0].poses.frame / problem.cameras[0].frame_rate
    np.testing.assert_allclose(moved.position_m[part][:, 0], 3.0 * (time_s + 3.0), rtol=1e-9)
