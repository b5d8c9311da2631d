"""Poses from a log, taken anew at the times at which the frames were really exposed.

A frame's log time is start + tau. Where the start is refined (`start_s`), or the clock's rate and drift say that video
time runs differently, it moves by

    shift = d start + s tau + deviation(tau)

and with it the measured pose. The log is read at shifts that are multiples of `READ_S`, each once for all descents of a
flight; from the nearest of them a pose is carried by its rate of change over a second, which is also its derivative in
the adjustment. A frame stays with its reading until it is well past the middle to the next, so that a descent near that
middle does not go to and fro. The rate is that of a second because an attitude's noise is
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
from pipeline.solver.observation.observations import Frames

STEP_S = 0.5
"""Half the time over which a rate of change is taken."""
STILL_S = 1e-7
"""Shifts that change by less leave the poses as they are."""
READ_S, CARRIED_S = 0.2, 0.15
"""Distance of the shifts at which the log is read, and how far poses are carried before the nearest one is taken."""

Renew = Callable[[Model, State], Model]


def movable(problem: Problem, model: Model) -> tuple[int, ...]:
    """Cameras whose poses come from a log and whose log times the adjustment can move."""
    free = model.priors.camera_free
    drifts = np.diff(model.drift.first) > 0
    moves = free[:, START] | free[:, SCALE] | drifts
    return tuple(c for c, camera in enumerate(problem.cameras) if camera.poses_at is not None and moves[c])


def renewing_poses(problem: Problem) -> Renew | None:
    """A function (model, state) -> the model with its poses at the state's log times; None: no poses come from logs.

    What the logs say at the given times is read here, of the cameras whose clocks are as a rule refined.
    """
    if all(camera.poses_at is None for camera in problem.cameras):
        return None
    readings = _Readings(problem)
    for c, camera in enumerate(problem.cameras):
        if camera.poses_at is not None and (camera.camera != problem.reference_camera or camera.sigma.start_s > 0):
            readings.at(c, 0)

    def renew(model: Model, state: State) -> Model:
        cameras = movable(problem, model)
        if not cameras:
            return model
        shift = shift_from_given_s(model.frames, model.drift, state.camera, state.deviation)
        shift += state.camera[model.frames.camera, START]
        return replace(model, frames=_moved(readings, model.frames, shift, cameras))

    return renew


Reading = tuple[Floats, Floats, Floats]
"""cam_from_enu (n, 3, 3), position (n, 3) and their rates (n, 6) of a camera's frames at one shift."""


class _Readings:
    """What the logs say of every camera's frames at multiples of `READ_S`, each read when it is first asked for."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._known: dict[tuple[int, int], Reading | None] = {}

    def at(self, c: int, k: int) -> tuple[int, Reading]:
        """The reading at `k` steps, or at the nearest towards zero that the log has: its steps and itself."""
        while k and self._read(c, k) is None:
            k -= 1 if k > 0 else -1
        return k, self._read(c, k) or self._given(c)

    def _given(self, c: int) -> Reading:
        poses = self._problem.cameras[c].poses
        turn = rotation.matrix(rotation.conjugate(poses.enu_from_cam))
        return turn, poses.position_enu_m, np.zeros((len(turn), 6))

    def _read(self, c: int, k: int) -> Reading | None:
        if (c, k) not in self._known:
            self._known[c, k] = _at(self._problem, c, k * READ_S, self._problem.cameras[c].poses if k == 0 else None)
        return self._known[c, k]


def _moved(readings: _Readings, frames: Frames, shift_s: Floats, cameras: tuple[int, ...]) -> Frames:
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
        far = np.abs(shift_s[part] - taken[part]) > CARRIED_S if known else np.ones(part.stop - part.start, dtype=bool)
        if far.any():
            steps = np.round(shift_s[part] / READ_S).astype(np.int64)
            for k in np.unique(steps[far]):
                rows = np.flatnonzero(far & (steps == k))
                there, (turns, positions, rates) = readings.at(c, int(k))
                at = part.start + rows
                turn[at], position[at], rate[at] = turns[rows], positions[rows], rates[rows]
                taken[at] = now[at] = there * READ_S
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


def _at(problem: Problem, c: int, shift_s: float, here: PoseTrack | None) -> Reading | None:
    """Poses and rates of a camera's frames at log times moved by `shift_s`, `here` where they are known already; None
    beyond the log's ends."""
    poses_at = problem.cameras[c].poses_at
    assert poses_at is not None
    shift = np.full(len(problem.cameras[c].poses.frame), shift_s)
    try:
        here = here or poses_at(shift)
    except RunningFixError:
        return None
    rate = np.zeros((len(shift), 6))
    for ahead, behind in ((STEP_S, -STEP_S), (STEP_S, 0.0), (0.0, -STEP_S)):
        try:
            rate = _rate(poses_at(shift + ahead), poses_at(shift + behind), ahead - behind)
            break
        except RunningFixError:
            continue
    return rotation.matrix(rotation.conjugate(here.enu_from_cam)), here.position_enu_m, rate


def _rate(later: PoseTrack, earlier: PoseTrack, seconds: float) -> Floats:
    """(n, 6): rotation vector of cam_from_enu in camera axes, and velocity, per second."""
    turned = rotation.multiply(rotation.conjugate(later.enu_from_cam), earlier.enu_from_cam)
    moved_m = later.position_enu_m - earlier.position_enu_m
    return np.concatenate([rotation.log(turned), moved_m], axis=1) / seconds
