"""What an adjustment takes anew at every point: poses from logs at moved times, sightings at their rows' instants."""

from __future__ import annotations

from dataclasses import replace

from pipeline.records import Problem
from pipeline.solver.adjustment.log_poses import Renew, renewing_poses
from pipeline.solver.adjustment.model import Model, State, pose_error
from pipeline.solver.observation.clocks import FOCAL, READOUT, SCALE, common_time_s
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.rolling_shutter import has_rows, turned


def renewing(problem: Problem) -> Renew | None:
    """A function (model, state) -> the model with its data as they are at the state; None: nothing changes with it."""
    poses = renewing_poses(problem)
    return rolling_too(poses) if any(has_rows(camera) for camera in problem.cameras) else poses


def rolling_too(renew: Renew | None) -> Renew:
    """What `renew` does, and sightings at their rows' instants."""

    def both(model: Model, state: State) -> Model:
        moved = model if renew is None else renew(model, state)
        return replace(moved, frames=rolled(moved.frames, moved, state))

    return both


def rolled(frames: Frames, model: Model, state: State) -> Frames:
    """`frames`, which need not be the model's own, with every sighting at its row's instant; see `rolling_shutter`."""
    if frames.rows is None:
        return frames
    camera = state.camera[frames.camera]
    return turned(
        frames, frames.rows, readout_s=camera[:, READOUT], scale=camera[:, SCALE],
        time_s=common_time_s(frames, model.drift, state.camera, state.deviation),
        positions=lambda time_s: model.basis.position(time_s, state.coefficients),
        error=pose_error(model, state, slice(None)), focal=camera[:, FOCAL],
        derive=bool(model.priors.camera_free[:, READOUT].any()),
    )  # fmt: skip
