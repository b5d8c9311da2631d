"""Rolling shutters: rows of a frame are exposed one after the other, and the camera goes on turning and moving.

A frame's time and pose are those of its middle row. The row at the fraction q of the readout T, -1/2 at the first row
and 1/2 at the last, is exposed dt = q T (1 + s) later, s the clock's scale; what it sees there is

    y' = R(t + dt) (X(t + dt) - C(t + dt))          R(t + dt) = exp(w) exp(omega dt) R(t),  C(t + dt) = C(t) + c dt

with w the frame's own error, which a frame has once. Everything else knows a frame as one instant,
y = R(t) (X(t) - C(t)). So rays d and gains of such sightings are turned by the smallest rotation S from y to y', with
the lens' magnification M on both: gain S and S'd, after which

    gain S M y / (d . S M y) = gain M y' / (d . M y')

is the residual of the row's own instant, exactly, where it is turned (metric residuals, which have no depth below, are
stretched as well); derivatives by all but T are those of the frame's
instant, which differ by the share that anything changes during a readout. They are turned anew at every step. The
derivative by T itself is worked out here:

    dr/dT = q (1 + s) G (omega' x y' + R(t + dt) (V(t + dt) - c)),      omega' = exp(w) omega
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import CameraInput, Problem
from pipeline.solver.observation.observations import NEAREST_COSINE, Frames, Rows
from pipeline.solver.observation.residuals import magnifications

STEP_S = 0.01
"""Common time before and after a frame from which its targets' motion is taken: half a long readout."""
SAME_S = 1e-3
"""Log times that have moved by less have the same rates."""

Positions = Callable[[Floats], Floats]
"""Common times (F,) -> the targets' positions (F, N, 3)."""


def has_rows(camera: CameraInput) -> bool:
    """Whether a camera's rows are told apart: its readout is given or refined."""
    return camera.rays.row is not None and (camera.readout_s != 0 or camera.sigma.readout_s > 0)


def with_rows(problem: Problem, frames: Frames) -> Frames:
    """The packed frames of `problem` with their rows, turned as the cameras turn: of targets nothing is known yet."""
    cameras = tuple(c for c, camera in enumerate(problem.cameras) if has_rows(camera))
    if not cameras:
        return frames
    rows = rows_of(problem, frames, cameras)
    readout_s = np.array([problem.cameras[c].readout_s if c in cameras else 0.0 for c in range(len(frames.cameras))])
    angle = rows.rate[:, None, :3] * (readout_s[frames.camera][:, None] * rows.fraction)[..., None]
    turn = rotation.matrix(rotation.exp(angle))
    refined = any(problem.cameras[c].sigma.readout_s > 0 for c in cameras)
    return replace(
        frames, gain=frames.gain @ turn, ray=(np.swapaxes(turn, -1, -2) @ frames.ray[..., None])[..., 0],
        rows=replace(rows, turn=turn), by_readout=np.zeros((*frames.seen.shape, 2)) if refined else frames.by_readout,
    )  # fmt: skip


def rows_of(problem: Problem, frames: Frames, cameras: tuple[int, ...]) -> Rows:
    """The rows of the sightings of some of the cameras, in the frames of `problem`; nothing is turned yet."""
    fraction, rate = np.zeros(frames.seen.shape), np.zeros((frames.count, 6))
    for c in cameras:
        camera, part = problem.cameras[c], frames.of(c)
        assert camera.rays.row is not None
        column = np.array([frames.targets.index(name) for name in camera.rays.targets], dtype=np.int64)
        place = np.searchsorted(camera.poses.frame, camera.rays.frame)
        fraction[part.start + place, column[camera.rays.target]] = camera.rays.row
        if camera.pose_rate is not None:
            rate[part] = camera.pose_rate
    return Rows(fraction=fraction, rate=rate, turn=np.broadcast_to(np.eye(3), (*frames.seen.shape, 3, 3)))


def with_row_numbers(problem: Problem) -> tuple[int, ...]:
    """Cameras of which it is known in which row each sighting is."""
    return tuple(c for c, camera in enumerate(problem.cameras) if camera.rays.row is not None)


def add_rows(problem: Problem, frames: Frames, cameras: tuple[int, ...]) -> Frames:
    """The frames with the rows of some cameras beside those that they have; nothing is turned by them yet."""
    added = rows_of(problem, frames, cameras)
    if frames.rows is None:
        return replace(frames, rows=added)
    own = np.isin(frames.camera, cameras)[:, None]
    fraction = np.where(own, added.fraction, frames.rows.fraction)
    return replace(
        frames,
        rows=replace(frames.rows, fraction=fraction, rate=np.where(own, added.rate, frames.rows.rate)),
    )


def rate_now(frames: Frames, rows: Rows) -> Floats:
    """(F, 6) how the poses go on at the log times for which they hold now."""
    if np.abs(frames.pose_shift_s).max(initial=0.0) < SAME_S:
        return rows.rate
    out = rows.rate.copy()
    for c in range(len(frames.cameras)):
        part = frames.of(c)
        when = frames.video_s[part]
        for k in range(out.shape[1]):
            out[part, k] = np.interp(when + frames.pose_shift_s[part], when, rows.rate[part, k])
    return out


def turned(
    frames: Frames, rows: Rows, readout_s: Floats, scale: Floats, time_s: Floats, positions: Positions, error: Floats,
    focal: Floats, *, derive: bool,
) -> Frames:  # fmt: skip
    """The frames with rays and gains as the rows' instants want them, at a point.

    readout_s, scale, time_s, focal (F,), error (F, 6) of the frames' poses; `derive`: with the readout's derivative
    """
    stretch = (1 + scale)[:, None] * rows.fraction
    rate = rate_now(frames, rows)
    delay = (readout_s[:, None] * stretch)[..., None]
    here, later, sooner = positions(time_s), positions(time_s + STEP_S), positions(time_s - STEP_S)
    velocity, bend = (later - sooner) / (2 * STEP_S), (later + sooner - 2 * here) / (2 * STEP_S**2)
    speed = velocity - rate[:, None, 3:]
    away = here - (frames.position_m + error[:, 3:])[:, None]
    own = rotation.matrix(rotation.exp(error[:, :3]))
    whole = away @ np.swapaxes(own @ frames.cam_from_enu, 1, 2)
    spin = (own @ rate[:, :3, None])[:, None, :, 0]
    swept = rotation.matrix(rotation.exp(spin * delay))
    by_row = (swept @ (_in_camera(own, frames, away + delay * (speed + delay * bend)))[..., None])[..., 0]
    factor = magnifications(frames, slice(None), focal)[0]
    magnified = np.ones((*factor.shape, 3))
    magnified[..., :2] = factor[..., None]
    turn = smallest_turn(whole * magnified, by_row * magnified)
    size = np.cbrt(np.linalg.det(rows.turn))[..., None]
    gain = frames.gain @ np.swapaxes(rows.turn, -1, -2) / size[..., None] ** 2
    ray = (rows.turn @ frames.ray[..., None])[..., 0] / size
    by_readout = frames.by_readout
    if derive:
        growth = np.cross(spin, by_row) + (swept @ _in_camera(own, frames, speed + 2 * delay * bend)[..., None])[..., 0]
        seen = by_row * magnified
        by_readout = _derivative(frames.angular, gain, ray, seen, growth * magnified) * stretch[..., None]
    ray = (np.swapaxes(turn, -1, -2) @ ray[..., None])[..., 0]
    if not frames.angular:
        turn = turn * longer(whole * magnified, by_row * magnified)[..., None, None]
    return replace(
        frames, gain=gain @ turn, ray=ray, rows=replace(rows, turn=turn), by_readout=by_readout,
    )  # fmt: skip


def _in_camera(own: Floats, frames: Frames, enu: Floats) -> Floats:
    """Vectors (F, N, 3) of the map in the axes of the corrected cameras."""
    return np.asarray(enu @ np.swapaxes(own @ frames.cam_from_enu, 1, 2))


def _derivative(angular: bool, gain: Floats, ray: Floats, y: Floats, growth: Floats) -> Floats:
    """(F, N, 2) of gain y / depth where y grows by `growth` (F, N, 3)."""
    flat, along = (gain @ growth[..., None])[..., 0], (ray * y).sum(-1)
    if not angular:
        return np.asarray(flat)
    depth = np.maximum(along, np.maximum(NEAREST_COSINE * np.linalg.norm(y, axis=-1), 1e-9))[..., None]
    residual = (gain @ y[..., None])[..., 0] / depth
    return np.asarray((flat - residual * (ray * growth).sum(-1)[..., None]) / depth)


def longer(before: Floats, after: Floats) -> Floats:
    """How many times as long one vector is as another; one where that is zero."""
    length = np.linalg.norm(before, axis=-1)
    return np.where(length > 0, np.linalg.norm(after, axis=-1) / np.where(length > 0, length, 1.0), 1.0)


def smallest_turn(before: Floats, after: Floats) -> Floats:
    """(..., 3, 3) the smallest rotation from the direction of one vector to that of another; none from or to zero."""
    lengths = np.linalg.norm(before, axis=-1) * np.linalg.norm(after, axis=-1)
    safe = np.where(lengths > 0, lengths, 1.0)[..., None]
    cross = rotation.skew(np.cross(before, after) / safe)
    cosine = (before * after).sum(-1)[..., None, None] / safe[..., None]
    found = np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-6)
    return np.where((lengths > 0)[..., None, None], found, np.eye(3))
