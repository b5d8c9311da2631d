"""Starts that put a target behind a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import OffsetCandidate, SolverSettings
from pipeline.solver.adjustment.levenberg_marquardt import Descent
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.initialisation import cleared, left_out, statistical_start, too_near, without
from pipeline.solver.methods.parameters import first_choice
from pipeline.solver.observation.observations import Frames, pack
from tests.scenes.solver import looped_flight

END_S = 58.0


def flight_start() -> tuple[Model, State, Frames]:
    """A minute of three cameras of which the last alone sees the end; the start."""
    problem, _ = looped_flight(0.0, seconds=60.0)
    frames = pack(problem)
    hidden = (frames.video_s > END_S)[:, None] & (frames.camera < 2)[:, None]
    frames = without(frames, frames, hidden)
    candidate = OffsetCandidate(offset_s={"cam0": 0.0, "cam1": 0.05, "cam2": 0.1}, cost=0.0)
    model, state = statistical_start(problem, SolverSettings(), frames, first_choice(problem), candidate)
    return model, state, frames


def mirrored(model: Model, state: State, camera: int, after_s: float) -> State:
    """The same motion, turned to the other side of a camera after a time."""
    place = model.frames.position_m[model.frames.of(camera).start]
    target = model.basis.targets[0]
    late = np.array([target.knots_s[i + 2] > after_s for i in range(target.count)])
    coefficients = state.coefficients.copy()
    coefficients[late] = 2 * place - coefficients[late]
    return replace(state, coefficients=coefficients)


def test_a_target_behind_its_camera_is_too_near_and_before_it_is_not() -> None:
    model, state, frames = flight_start()
    good = cleared(model, state, Descent()).state
    assert not too_near(model, good).any()
    found = too_near(model, mirrored(model, good, 2, END_S - 3.0))
    assert not found[frames.camera < 2].any()
    own = frames.camera == 2
    assert found[own & (frames.video_s > END_S - 1.0)].all()
    assert not found[own & (frames.video_s < END_S - 5.0)].any()


def test_sightings_left_out_for_a_bad_start_come_back() -> None:
    model, state, frames = flight_start()
    good = cleared(model, state, Descent())
    again = cleared(model, mirrored(model, good.state, 2, END_S - 3.0), Descent())
    assert again.model.frames.seen.sum() == frames.seen.sum()
    assert not left_out(frames, again.model.frames)
    assert again.cost == pytest.approx(good.cost, rel=1e-4)


def test_what_stays_out_is_said() -> None:
    _, _, frames = flight_start()
    hidden = (frames.camera == 2)[:, None] & (frames.video_s > END_S)[:, None]
    (finding,) = left_out(frames, without(frames, frames, hidden))
    assert finding.subject == "cam2"
    assert finding.words.startswith(f"{int(hidden.sum())} sightings of cam2 are left out")
