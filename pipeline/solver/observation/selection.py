"""A problem with fewer targets."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.records import CameraInput, PoseTrack, Problem
from pipeline.records.problem import PoseAt


def without_targets(problem: Problem, names: Collection[str]) -> Problem | None:
    """The problem without some targets, and without cameras that see nothing else; None where nothing is left."""
    targets = tuple(t for t in problem.targets if t.target not in names)
    cameras = tuple(c for c in (_without(camera, names) for camera in problem.cameras) if c is not None)
    known = any(c.camera == problem.reference_camera for c in cameras)
    return replace(problem, cameras=cameras, targets=targets) if targets and known else None


def on_known_ground(problem: Problem) -> frozenset[str]:
    """Targets that a ground holds."""
    return frozenset(t.target for t in problem.targets if t.on_ground and problem.ground is not None)


def without_landmarks(problem: Problem) -> Problem:
    """The problem of what moves: still points tell nothing of time."""
    still = [t.target for t in problem.targets if t.landmark]
    return problem if not still else without_targets(problem, still) or problem


def _without(camera: CameraInput, names: Collection[str]) -> CameraInput | None:
    rays = camera.rays
    left = tuple(name for name in rays.targets if name not in names)
    place = np.array([left.index(name) if name in left else -1 for name in rays.targets], dtype=np.int64)
    kept = place[rays.target] >= 0
    if not kept.any():
        return None
    rows = np.isin(camera.poses.frame, np.unique(rays.frame[kept]))
    poses = replace(
        camera.poses, frame=camera.poses.frame[rows], time_s=camera.poses.time_s[rows],
        position_enu_m=camera.poses.position_enu_m[rows], enu_from_cam=camera.poses.enu_from_cam[rows],
    )  # fmt: skip
    fewer = replace(rays.some(kept), targets=left, target=place[rays.target[kept]])
    at = None if camera.poses_at is None else _at_rows(camera.poses_at, rows)
    rate = None if camera.pose_rate is None else camera.pose_rate[rows]
    return replace(camera, rays=fewer, poses=poses, poses_at=at, pose_rate=rate)


def _at_rows(poses_at: PoseAt, rows: Bools) -> PoseAt:
    """The same poses at moved times, of some of the frames."""

    def at(shift_s: Floats) -> PoseTrack:
        whole = np.full(len(rows), float(np.median(shift_s)) if len(shift_s) else 0.0)
        whole[rows] = shift_s
        found = poses_at(whole)
        return replace(
            found, frame=found.frame[rows], time_s=found.time_s[rows], position_enu_m=found.position_enu_m[rows],
            enu_from_cam=found.enu_from_cam[rows],
        )  # fmt: skip

    return at
