"""Poses from a log, taken anew at the times at which the frames were really exposed.

A frame's log time is start + tau. Where the start is refined (`start_s`), or the clock's rate and drift say that video
time runs differently, it moves by

    shift = d start + s tau + deviation(tau)

and with it the measured pose. Small moves are carried by the pose's rate of change over a second, which is also its
derivative in the adjustment; larger ones read the log anew. The rate is that of a second because an attitude's noise is
new with every sample: the difference of two neighbouring ones would say more of the noise than of the flight, and every
reading at another time would draw it again, under the feet of the descent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Floats1, Floats2, Floats3
from calibration.foundation.compiled import compiled, is_compiled
from calibration.foundation.errors import RunningFixError
from pipeline.geometry import rotation
from pipeline.records import PoseTrack, Problem
from pipeline.solver.adjustment._lanes import turn as rotated
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import SCALE, START, shift_from_given_s
from pipeline.solver.observation.observations import Frames, with_poses_of

STEP_S = 0.5
"""Half the time over which a rate of change is taken."""
STILL_S = 1e-7
"""Shifts that change by less leave the poses as they are."""
CARRIED_S = 0.1
"""How far poses are carried before the log is read anew."""

Renew = Callable[[Model, State], Model]


def movable(problem: Problem, model: Model) -> tuple[int, ...]:
    """Cameras whose poses come from a log and whose log times the adjustment can move."""
    free = model.priors.camera_free
    drifts = np.diff(model.drift.first) > 0
    moves = free[:, START] | free[:, SCALE] | drifts
    return tuple(c for c, camera in enumerate(problem.cameras) if camera.poses_at is not None and moves[c])


def renewing_poses(problem: Problem) -> Renew | None:
    """A function (model, state) -> the model with its poses at the state's log times; None: no poses come from logs."""
    if all(camera.poses_at is None for camera in problem.cameras):
        return None
    read: dict[tuple[int, tuple[int, ...]], tuple[Frames, Frames]] = {}

    def renew(model: Model, state: State) -> Model:
        cameras = movable(problem, model)
        if not cameras:
            return model
        frames = model.frames
        shift = shift_from_given_s(frames, model.drift, state.camera, state.deviation)
        shift += state.camera[frames.camera, START]
        if frames.pose_rate is not None:
            return replace(model, frames=moved(problem, frames, shift, cameras))
        key = id(frames.cam_from_enu), cameras  # the log is read once for all descents that begin at the same poses
        if key not in read:
            read[key] = frames, moved(problem, frames, shift, cameras)
        return replace(model, frames=moved(problem, with_poses_of(frames, read[key][1]), shift, cameras))

    return renew


def moved(problem: Problem, frames: Frames, shift_s: Floats, cameras: tuple[int, ...]) -> Frames:
    """The frames with the poses of `cameras` at log times moved by `shift_s` (F,), and their rates of change."""
    rate = np.zeros((frames.count, 6)) if frames.pose_rate is None else frames.pose_rate
    turn, position, now, taken = frames.cam_from_enu, frames.position_m, frames.pose_shift_s, frames.pose_taken_s
    fresh = False
    for c in cameras:
        part = frames.of(c)
        known = frames.pose_rate is not None and bool(rate[part].any())
        if known and np.abs(shift_s[part] - now[part]).max(initial=0.0) < STILL_S:
            continue
        if not fresh:
            turn, position, rate, now, taken = (a.copy() for a in (turn, position, rate, now, taken))
            fresh = True
        carried = known and bool(np.abs(shift_s[part] - taken[part]).max(initial=0.0) < CARRIED_S)
        try:
            if not carried:
                turn[part], position[part], rate[part] = _at(problem, c, shift_s[part])
                taken[part] = shift_s[part]
        except RunningFixError:  # beyond the log's ends: go on as fast as at the last place that could be had
            carried = True
        if carried and frames.pose_rate is not None:
            carry(rate[part], shift_s[part] - now[part], turn[part], position[part])
        now[part] = shift_s[part]
    if not fresh and frames.pose_rate is not None:
        return frames
    return replace(frames, cam_from_enu=turn, position_m=position, pose_rate=rate, pose_shift_s=now, pose_taken_s=taken)


def carry_plain(rate: Floats, seconds: Floats, turn: Floats, position: Floats) -> None:
    """Moves cam_from_enu (n, 3, 3) and positions (n, 3) on by `seconds` (n,) at their rates (n, 6), in place."""
    step = rate * seconds[:, None]
    turn[:] = rotation.matrix(rotation.exp(step[:, :3])) @ turn
    position += step[:, 3:]


@compiled
def _carry(rate: Floats2, seconds: Floats1, turn: Floats3, position: Floats2) -> None:
    """Twin of `carry_plain`."""
    w, turned = np.zeros(3), np.zeros((3, 3))
    for f in range(len(seconds)):
        for i in range(len(w)):
            w[i] = rate[f, i] * seconds[f]
            position[f, i] += rate[f, 3 + i] * seconds[f]
        rotated(w, turn[f], turned)
        for i in range(len(w)):
            for j in range(len(w)):
                turn[f, i, j] = turned[i, j]


def carry(rate: Floats, seconds: Floats, turn: Floats, position: Floats) -> None:
    """`carry_plain`, compiled where it can be."""
    if is_compiled(__name__):
        _carry(rate, seconds, turn, position)
    else:
        carry_plain(rate, seconds, turn, position)


def _at(problem: Problem, c: int, shift_s: Floats) -> tuple[Floats, Floats, Floats]:
    """cam_from_enu (n, 3, 3), position (n, 3) and their rates (n, 6) at moved log times."""
    poses_at = problem.cameras[c].poses_at
    assert poses_at is not None
    here = poses_at(shift_s)
    for ahead, behind in ((STEP_S, -STEP_S), (STEP_S, 0.0), (0.0, -STEP_S)):
        try:
            rate = _rate(poses_at(shift_s + ahead), poses_at(shift_s + behind), ahead - behind)
            break
        except RunningFixError:
            rate = np.zeros((len(shift_s), 6))
    return rotation.matrix(rotation.conjugate(here.enu_from_cam)), here.position_enu_m, rate


def _rate(later: PoseTrack, earlier: PoseTrack, seconds: float) -> Floats:
    """(n, 6): rotation vector of cam_from_enu in camera axes, and velocity, per second."""
    turned = rotation.multiply(rotation.conjugate(later.enu_from_cam), earlier.enu_from_cam)
    moved_m = later.position_enu_m - earlier.position_enu_m
    return np.concatenate([rotation.log(turned), moved_m], axis=1) / seconds
