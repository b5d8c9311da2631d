"""From a finished adjustment to the record that leaves the solver."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import (
    Bias,
    Clock,
    Finding,
    Motion,
    OffsetCandidate,
    PoseTrack,
    Problem,
    Redundancy,
    Sightings,
    Solution,
    SolverSettings,
    SolveStatus,
)
from pipeline.solver.adjustment.known_rows import known_square
from pipeline.solver.adjustment.model import Model, State, pose_error, residuals_of, wander_square
from pipeline.solver.methods.still_points import ground_fits, landmarks_of
from pipeline.solver.observation.clocks import FOCAL, OFFSET, POS, READOUT, ROT, SCALE, START, common_time_s
from pipeline.solver.observation.motion_basis import motion_of
from pipeline.solver.observation.observations import Frames
from pipeline.solver.uncertainty.covariance import Covariance, motion_band
from pipeline.solver.uncertainty.redundancy import redundancies

NAMES = (
    "rotation_bias_x_rad", "rotation_bias_y_rad", "rotation_bias_z_rad", "position_bias_east_m",
    "position_bias_north_m", "position_bias_up_m", "focal_scale", "offset_s", "frame_rate", "start_s", "readout_s",
)  # fmt: skip

PLACE_NAMES = ("place_x_px", "place_x_drift_px", "place_y_px", "place_y_drift_px")


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What a method found.

    observed  the frames with the reprojection error as residual, whatever the method minimised
    plain, robust  covariances; None: not determined
    """

    model: Model
    observed: Frames
    state: State
    status: SolveStatus
    iterations: int
    cost: float
    plain: Covariance | None
    robust: Covariance | None = None
    findings: tuple[Finding, ...] = ()
    candidates: tuple[OffsetCandidate, ...] = ()


MESSAGES: dict[SolveStatus, str] = {
    "converged": "the cost no longer falls",
    "iteration-limit": "the iteration limit came before the cost stopped falling; allow more iterations",
    "stalled": "no step lowers the cost any more although its gradient is not zero; look at the findings",
}


def solution_of(problem: Problem, settings: SolverSettings, found: Outcome, seconds: float) -> Solution:
    """The record."""
    model, state = found.model, found.state
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)
    sightings, squares, observations = _sightings(found, time)
    square = float(squares.sum())
    names, shared = _shared(problem, model, state, found.plain)
    _, shared_robust = _shared(problem, model, state, found.robust)
    return Solution(
        method=settings.method,
        status=found.status,
        message=MESSAGES[found.status],
        iterations=found.iterations,
        cost=found.cost,
        chi_square=square + _prior_square(model, state),
        degrees_of_freedom=_degrees_of_freedom(model, observations),
        clocks=tuple(_clock(problem, found, c) for c in range(len(problem.cameras))),
        poses=tuple(_poses(problem, model, state, c) for c in range(len(problem.cameras))),
        motions=_moving(problem, _motions(model, state, found.plain, time)),
        sightings=sightings,
        biases=tuple(_bias(problem, found, c) for c in range(len(problem.cameras))),
        findings=found.findings,
        offset_candidates=found.candidates,
        shared_names=names,
        shared_covariance=shared,
        shared_covariance_robust=shared_robust,
        redundancies=_redundancies(settings, found, squares),
        motions_robust=() if found.robust is None else _moving(problem, _motions(model, state, found.robust, time)),
        landmarks=landmarks_of(problem, model, state, found.plain, found.robust, sightings),
        ground=ground_fits(problem, model, state, found.plain),
        seconds=seconds,
        settings=asdict(settings),
    )


def _moving(problem: Problem, motions: tuple[Motion, ...]) -> tuple[Motion, ...]:
    """Without the landmarks, which have no motion."""
    return tuple(m for m, t in zip(motions, problem.targets, strict=True) if not t.landmark)


def _redundancies(settings: SolverSettings, found: Outcome, square: Floats) -> tuple[Redundancy, ...]:
    """Only `map` weighs sightings and priors by their sigmas."""
    if found.plain is None or settings.method != "map":
        return ()
    return redundancies(found.model, found.state, found.plain, square)


def parameter_sigma(found: Outcome, place: Ints) -> Floats:
    """Root of the larger of the plain and the robust variances; NaN where not determined, zero where held."""
    plain = _of_one(found.plain, place)
    return plain if found.robust is None else np.fmax(plain, _of_one(found.robust, place))


def _of_one(covariance: Covariance | None, place: Ints) -> Floats:
    if covariance is None:
        return np.where(place >= 0, np.nan, 0.0)
    out = np.zeros(place.shape)
    free = place[place >= 0]
    out[place >= 0] = np.sqrt(np.maximum(covariance.pairs(free, free), 0))
    return out


def _motions(model: Model, state: State, covariance: Covariance | None, time: Floats) -> tuple[Motion, ...]:
    out = []
    for n, t in enumerate(model.basis.targets):
        own = time[model.frames.seen[:, n]]
        band = None if covariance is None else motion_band(covariance, model, n)
        coefficients = state.coefficients[t.first : t.first + t.count]
        out.append(motion_of(t, coefficients, band, float(own.min()), float(own.max())))
    return tuple(out)


def _clock(problem: Problem, found: Outcome, c: int) -> Clock:
    model, state = found.model, found.state
    nominal = problem.cameras[c].frame_rate
    scale = 1 + state.camera[c, SCALE]
    offset_sigma, scale_sigma = parameter_sigma(found, model.order.camera[c, [OFFSET, SCALE]])
    own = model.drift.of(c)
    drifts = own.stop > own.start
    return Clock(
        camera=problem.cameras[c].camera,
        offset_s=float(state.camera[c, OFFSET]),
        frame_rate=float(nominal / scale),
        nominal_rate=nominal,
        offset_sigma_s=float(offset_sigma),
        frame_rate_sigma=float(nominal / scale**2 * scale_sigma),
        deviation_frame=model.drift.knot_s[own] * nominal if drifts else None,
        deviation_s=state.deviation[own] if drifts else None,
        deviation_sigma_s=parameter_sigma(found, model.order.drift[own]) if drifts else None,
    )


def _poses(problem: Problem, model: Model, state: State, c: int) -> PoseTrack:
    given, part = problem.cameras[c].poses, model.frames.of(c)
    error = pose_error(model, state, part)
    cam_from_enu = rotation.matrix(rotation.exp(error[:, :3])) @ model.frames.cam_from_enu[part]
    return PoseTrack(
        camera=given.camera,
        frame=given.frame,
        time_s=given.time_s,
        position_enu_m=model.frames.position_m[part] + error[:, 3:],
        enu_from_cam=rotation.conjugate(rotation.from_matrix(cam_from_enu)),
    )


def _bias(problem: Problem, found: Outcome, c: int) -> Bias:
    model, state = found.model, found.state
    sigma = parameter_sigma(found, model.order.camera[c])
    scale = float(np.exp(state.camera[c, FOCAL]))
    return Bias(
        camera=problem.cameras[c].camera,
        rotation_rad=state.camera[c, ROT],
        rotation_sigma_rad=sigma[ROT],
        position_m=state.camera[c, POS],
        position_sigma_m=sigma[POS],
        focal_scale=scale,
        focal_scale_sigma=scale * float(sigma[FOCAL]),
        start_s=float(state.camera[c, START]),
        start_sigma_s=float(sigma[START]),
        readout_s=float(state.camera[c, READOUT]),
        readout_sigma_s=float(sigma[READOUT]),
    )


def _sightings(found: Outcome, time: Floats) -> tuple[Sightings, Floats, int]:
    """The table of sightings, squared residuals (F, N) in sigmas, and how many sightings there are."""
    model, state, frames = found.model, found.state, found.observed
    time_s, position = _exposed(model, state, time)
    residual = residuals_of(frames, slice(None), model, state)
    f, n = np.nonzero(frames.seen)
    sigmas = np.linalg.norm(residual[f, n], axis=-1)
    pixel = frames.sigma_px
    camera = frames.camera[f]
    table = Sightings(
        camera=tuple(np.array(frames.cameras, dtype=object)[camera]),
        target=tuple(np.array(frames.targets, dtype=object)[n]),
        frame=frames.frame[f],
        time_s=time_s[f, n],
        residual_px=-residual[f, n] * pixel[f, n][:, None],
        residual_sigma=sigmas,
        weight=model.loss.weight(sigmas**2),
        position_enu_m=position[f, n],
    )
    square = np.zeros(frames.seen.shape)
    square[f, n] = sigmas**2
    return table, square, len(f)


def _exposed(model: Model, state: State, time: Floats) -> tuple[Floats, Floats]:
    """Common time (F, N) at which every target's row is exposed, and where the target is then (F, N, 3)."""
    rows, basis, targets = model.frames.rows, model.basis, model.frames.seen.shape[1]
    if rows is None:
        return np.tile(time[:, None], (1, targets)), basis.position(time, state.coefficients)
    camera = state.camera[model.frames.camera]
    time_s = time[:, None] + (camera[:, READOUT] * (1 + camera[:, SCALE]))[:, None] * rows.fraction
    each = [basis.position(time_s[:, n], state.coefficients)[:, n] for n in range(targets)]
    return time_s, np.stack(each, axis=1)


def _prior_square(model: Model, state: State) -> float:
    """Squared prior residuals of cameras, frames and splines; `map` only has them."""
    off = (state.camera - model.priors.camera_mean) ** 2 * model.priors.camera_precision
    own = model.pose.prior[model.frames.camera] * state.own**2
    return float(off.sum() + own.sum()) + wander_square(model, state) + known_square(model, state)


def _degrees_of_freedom(model: Model, observations: int) -> int:
    """Observations and priors less unknowns; a frame's own error with a prior adds one of each."""
    own = model.pose.spread[model.frames.camera] * (1 - model.pose.prior[model.frames.camera])
    priors = int(((model.priors.camera_precision > 0) & model.priors.camera_free).sum())
    priors += int((model.order.wander >= 0).sum())
    if model.known is not None:
        priors += len(model.known.target) + model.known.count
    return 2 * observations + priors - model.order.n_band - model.order.n_border - int((own > 0).sum())


def parameter_names(model: Model) -> tuple[str, ...]:
    """The name of each of a camera's parameters, without the camera."""
    return (*NAMES, *(f"{t}.{word}" for t in model.frames.targets for word in PLACE_NAMES))


def _shared(
    problem: Problem, model: Model, state: State, covariance: Covariance | None
) -> tuple[tuple[str, ...], Floats | None]:
    """Names of the cameras' free parameters and their covariance, frame rates in Hz and focal lengths as scales."""
    names, places, unit = [], [], []
    order_names = parameter_names(model)
    for c, camera in enumerate(problem.cameras):
        units = np.ones(len(order_names))
        units[SCALE] = -camera.frame_rate / (1 + state.camera[c, SCALE]) ** 2
        units[FOCAL] = np.exp(state.camera[c, FOCAL])
        for k in np.flatnonzero(model.order.camera[c] >= 0):
            names.append(f"{camera.camera}.{order_names[k]}")
            places.append(model.order.camera[c, k])
            unit.append(units[k])
    if covariance is None or not places:
        return tuple(names), None
    place, scale = np.array(places), np.array(unit)
    return tuple(names), covariance.pairs(place[:, None], place[None, :]) * scale[:, None] * scale
