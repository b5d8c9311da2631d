"""A solution with all that belongs to it, ready for exports and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from pipeline.flight import Flight
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Bias, ImageTrack, Motion, PoseTrack, Results, Solution, Trajectory
from pipeline.report import typical_sigma_m
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.build import BuiltProblem
from pipeline.stages.running.provenance import versions


def sample(motion: Motion, rate_hz: float, robust: Motion | None = None) -> Trajectory:
    """A motion at even steps over the time in which its target was seen.

    Of the plain and the robust covariance the larger holds, at each time.
    """
    count = int(np.floor((motion.end_s - motion.start_s) * rate_hz * (1 + 1e-12))) + 1
    time = motion.start_s + np.arange(count) / rate_hz
    own = motion.position_covariance(time)
    alike = own if robust is None else robust.position_covariance(time)
    greater = np.trace(alike, axis1=1, axis2=2) > np.trace(own, axis1=1, axis2=2)
    velocity = motion.position_enu_m(time, 1) if motion.degree > 0 else np.zeros((count, 3))
    return Trajectory(
        target=motion.target,
        time_s=time,
        position_enu_m=motion.position_enu_m(time),
        velocity_mps=velocity,
        covariance=np.where(greater[:, None, None], alike, own),
    )


def refined_poses(measured: PoseTrack, refined: PoseTrack, bias: Bias | None) -> PoseTrack:
    """The adjusted pose of every measured frame: where nothing was seen, the camera's constant correction alone."""
    position, attitude = measured.position_enu_m.copy(), measured.enu_from_cam.copy()
    if bias is not None:
        position += bias.position_m
        attitude = rotation.multiply(attitude, rotation.conjugate(rotation.exp(bias.rotation_rad)))
    row = np.searchsorted(measured.frame, refined.frame)
    position[row], attitude[row] = refined.position_enu_m, refined.enu_from_cam
    return PoseTrack(
        camera=measured.camera,
        frame=measured.frame,
        time_s=measured.time_s,
        position_enu_m=position,
        enu_from_cam=rotation.normalised(attitude),
    )


def all_refined(measured: Sequence[MeasuredPoses], solution: Solution) -> tuple[PoseTrack, ...]:
    """`refined_poses` of every camera that took part."""
    adjusted = {p.camera: p for p in solution.poses}
    biases = {b.camera: b for b in solution.biases}
    return tuple(
        refined_poses(m.poses, adjusted[m.camera], biases.get(m.camera)) for m in measured if m.camera in adjusted
    )


def gather_results(
    flight: Flight,
    solution: Solution,
    tracks: Sequence[ImageTrack],
    measured: Sequence[MeasuredPoses],
    built: BuiltProblem,
    origin: Geodetic | None,
    hashes: Mapping[str, str],
    tracking_notes: Sequence[str] = (),
) -> Results:
    """Everything that exports and report draw from."""
    robust = {m.target: m for m in solution.motions_robust}
    reference = next(m for m in measured if m.camera == flight.reference_camera)
    notes = tuple(f"{m.camera}: {note}" for m in measured for note in m.notes)
    gathered = Results(
        title=flight.title,
        solution=solution,
        trajectories=tuple(sample(m, flight.solve.rate_hz, robust.get(m.target)) for m in solution.motions),
        tracks=tuple(tracks),
        measured_poses=tuple(m.poses for m in measured),
        image_size={name: model.image_size for name, model in built.models.items() if all(model.image_size)},
        origin=origin,
        utc_s=reference.utc_s,
        inputs=hashes,
        settings={**asdict(flight.solve), **solution.settings},
        versions=versions(),
        warnings=(*tracking_notes, *notes, *built.notes),
    )
    return replace(gathered, typical_sigma_m=typical_sigma_m(gathered))
