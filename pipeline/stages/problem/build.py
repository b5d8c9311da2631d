"""Tracks, poses and camera models become the `Problem` that the solver is asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.camera import CameraModel, focal_effect
from calibration.foundation.arrays import Ints
from calibration.foundation.errors import GeometryError, InputFileError, UsageError
from pipeline.flight import CameraSettings, Flight
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import CameraInput, ImageTrack, PoseTrack, Problem, SightRays, TargetInput
from pipeline.stages.inputs.cameras import camera_notes
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.known import ground_of, landmarks
from pipeline.stages.problem.priors import offset_sigma, place_sigma_px, with_focal
from pipeline.stages.problem.rays import check_inside, sight_rays
from pipeline.stages.problem.readout import check_readout, rates_of
from pipeline.telemetry import is_pose_table


@dataclass(frozen=True, kw_only=True, eq=False)
class BuiltProblem:
    """The problem, and what was left out on the way: one sentence each."""

    problem: Problem
    models: Mapping[str, CameraModel]
    notes: tuple[str, ...]


def build_problem(
    flight: Flight, tracks: Sequence[ImageTrack], measured: Sequence[MeasuredPoses], models: Mapping[str, CameraModel],
    origin: Geodetic | None = None,
) -> BuiltProblem:  # fmt: skip
    """The problem of a flight; `origin` of its ENU, which ground and surveyed landmarks need.

    Raises InputFileError where a fix lies outside of its image, GeometryError where no target is left.
    """
    moving = _targets(flight, tracks)
    still = landmarks(flight, tracks, origin)
    targets = (*moving, *still)
    names = tuple(t.target for t in targets)
    inputs, notes = [], []
    for pose in measured:
        own = [t for t in tracks if t.camera == pose.camera and t.target in names and t.seen.any()]
        if not any(t.target in {m.target for m in moving} for t in own):
            notes.append(f"camera {pose.camera} sees no target and takes no part")
            continue
        notes += camera_notes(pose.camera, models[pose.camera])
        check_inside(flight, models[pose.camera], own)
        rays, lost = sight_rays(models[pose.camera], pose.camera, own, names)
        rays = replace(rays, place_sigma_px=place_sigma_px(flight, flight.camera(pose.camera)))
        if lost:
            notes.append(f"{pose.camera}: {lost} fixes left out, the lens model maps no direction to them")
        own_sigma = with_focal(pose.sigma, flight.camera(pose.camera).sigma, models[pose.camera], rays)
        if own_sigma.focal > 0:
            rays = replace(rays, focal_effect=focal_effect(models[pose.camera], rays.direction_cam))
        inputs.append(camera_input(flight, replace(pose, sigma=own_sigma), rays, measured))
    _check_common(flight, inputs)
    seen = {c.rays.targets[i] for c in inputs for i in np.unique(c.rays.target)}
    unseen = [t.target for t in still if t.target not in seen]
    notes += [f"landmark {name} is seen by no camera that takes part" for name in unseen]
    ground, told = ground_of(flight, inputs, origin)
    problem = Problem(
        cameras=tuple(inputs), targets=tuple(t for t in targets if t.target not in unseen),
        reference_camera=flight.reference_camera, ground=ground,
    )  # fmt: skip
    notes += told
    return BuiltProblem(problem=problem, models=models, notes=tuple(notes))


def _targets(flight: Flight, tracks: Sequence[ImageTrack]) -> tuple[TargetInput, ...]:
    still = {mark.name for mark in flight.landmarks}
    seen = dict.fromkeys(t.target for t in tracks if t.seen.any() and t.target not in still)
    if flight.targets:
        chosen = [t for t in flight.targets if t.name in seen]
        if not chosen:
            raise UsageError(
                where=f"{flight.path}: targets",
                seen=f"{', '.join(t.name for t in flight.targets)}, none of which any track holds",
                expected=f"names of tracked targets ({', '.join(seen) or 'there are none'})",
                advice="use the names of the target column, or leave [targets] out to take them all",
            )
        return tuple(
            TargetInput(
                target=t.name, motion=t.motion, order=t.order, on_ground=t.on_ground, above_ground_m=t.above_ground_m
            )
            for t in chosen
        )
    if not seen:
        raise GeometryError(
            where=str(flight.path),
            seen="no target was seen in any camera",
            expected="at least one track with fixes",
            advice="look at tracks.csv: were all targets lost?",
        )
    return tuple(TargetInput(target=name) for name in seen)


def camera_input(
    flight: Flight, pose: MeasuredPoses, rays: SightRays, measured: Sequence[MeasuredPoses]
) -> CameraInput:
    """One camera as solver and matching get it: rays, their poses, and the first guess of its offset."""
    settings = flight.camera(pose.camera)
    base = poses_of(flight, pose, np.unique(rays.frame))
    check_readout(flight, pose, rays)
    offset, sigma = settings.offset_s, pose.sigma
    reference = next(m for m in measured if m.camera == flight.reference_camera)
    if offset is None and pose.utc_s is not None and reference.utc_s is not None:
        offset = pose.utc_s - reference.utc_s
        sigma = offset_sigma(settings, pose, reference)
    return CameraInput(
        camera=pose.camera,
        rays=rays,
        poses=base,
        frame_rate=pose.frame_rate,
        offset_s=0.0 if pose.camera == flight.reference_camera else offset,
        sigma=sigma,
        clock=settings.clock,
        still=pose.still,
        mount_ypr_rad=_fixed_mount(settings),
        poses_at=None if pose.poses_at is None else pose.poses_at(base),
        readout_s=settings.readout_s,
        pose_rate=None if pose.still else rates_of(pose.poses, base.frame),
    )


def _fixed_mount(settings: CameraSettings) -> tuple[float, float, float] | None:
    """Yaw, pitch, roll of the mount where a log's attitudes rest on it; tables and still poses have none."""
    if settings.telemetry is None or is_pose_table(settings.telemetry) or settings.mount.gimbal:
        return None
    return settings.mount.yaw_rad, settings.mount.pitch_rad, settings.mount.roll_rad


def poses_of(flight: Flight, pose: MeasuredPoses, frame: Ints) -> PoseTrack:
    """A camera's measured poses at some of its frames. Raises InputFileError where one is missing."""
    have = pose.poses
    row = np.clip(np.searchsorted(have.frame, frame), 0, len(have.frame) - 1)
    missing = have.frame[row] != frame
    if missing.any():
        raise InputFileError(
            where=flight.key(pose.camera, "telemetry"),
            seen=f"no pose for frame {frame[missing][0]} ({int(missing.sum())} of {len(frame)} frames in all)",
            expected="a pose for every frame in which a target was seen",
            advice="check that tracks, video and poses belong to the same flight",
        )
    return PoseTrack(
        camera=have.camera,
        frame=frame,
        time_s=have.time_s[row],
        position_enu_m=have.position_enu_m[row],
        enu_from_cam=have.enu_from_cam[row],
    )


def _check_common(flight: Flight, inputs: Sequence[CameraInput]) -> None:
    """Refuses cameras that nothing ties together: zero targets in common."""
    if not any(c.camera == flight.reference_camera for c in inputs):
        raise GeometryError(
            where=f"{flight.path}: flight.reference_camera",
            seen=f"camera {flight.reference_camera} sees no target",
            expected="a reference camera with fixes, since its clock is common time",
            advice="choose another reference_camera",
        )
    seen = {c.camera: {c.rays.targets[i] for i in np.unique(c.rays.target)} for c in inputs}
    tied, grown = {flight.reference_camera}, True
    while grown:
        known = set().union(*(seen[c] for c in tied))
        more = {c for c in seen if seen[c] & known} - tied
        tied, grown = tied | more, bool(more)
    for camera, own in seen.items():
        if camera not in tied:
            raise GeometryError(
                where=f"{flight.path}: cameras.{camera}",
                seen=f"it sees {', '.join(sorted(own))}, which no camera tied to {flight.reference_camera} sees",
                expected="at least one target in common",
                advice="name the same vehicle alike in both cameras' boxes or tracks",
            )
