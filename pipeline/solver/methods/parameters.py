"""From the records to a model and a first point: which unknowns a method frees, and with what priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import CameraInput, Problem, SolverSettings, TargetInput
from pipeline.records.motion import MotionKind
from pipeline.solver.adjustment.elimination import CAUCHY, HUBER, NONE, Loss, PoseError
from pipeline.solver.adjustment.model import Model, Priors, State, build_model
from pipeline.solver.methods.known_motions import first_known, laid_through
from pipeline.solver.observation.clocks import (
    CAMERA_PARAMETERS,
    FOCAL,
    OFFSET,
    PLACE_PARAMETERS,
    POS,
    READOUT,
    ROT,
    SCALE,
    START,
    common_time_s,
    without_drift,
)
from pipeline.solver.observation.motion_basis import MotionBasis, build_basis
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.rolling_shutter import has_rows

BEND = {"none": Loss(), "huber": Loss(kind=HUBER, bend=3.0), "cauchy": Loss(kind=CAUCHY, bend=2.5)}
"""Where a loss bends, in sigmas of a sighting: 1.1 % of good sightings lie beyond three."""
FIRST_ORDER = 1
FIRST_JERK = 10.0
"""m / s^2.5: a drone in brisk flight. The data's own strength is estimated later."""
GROUND_JERK = 2.0
"""m / s^2.5: a vehicle on the ground. A motion that follows each wiggle of the attitude is cheaper the nearer it is, so
that what is loose here draws targets towards a single camera. Estimated later, too."""
KNOTS_S = 0.3
assert NONE == 0
TIMED = ("li", "algorithm-1", "algorithm-2", "map")
"""Methods that estimate clocks."""


@dataclass(frozen=True, kw_only=True)
class MotionChoice:
    """Kind and order of every target's motion in force, and the spacing of splines' knots."""

    kinds: tuple[MotionKind, ...]
    orders: tuple[int, ...]
    spacing_s: float = KNOTS_S


def first_choice(problem: Problem, method: str = "map") -> MotionChoice:
    """What the problem says, with `FIRST_ORDER` where the data shall say."""
    lone = seen_by_one(problem)
    return MotionChoice(
        kinds=tuple(_first_kind(t, method, t.target in lone) for t in problem.targets),
        orders=tuple(_first_order(t, method, t.target in lone) for t in problem.targets),
    )


def seen_by_one(problem: Problem) -> frozenset[str]:
    """Targets that only one camera sees, and no ground holds: a free motion of theirs could not be known."""
    count = {t.target: 2 * (t.on_ground and problem.ground is not None) for t in problem.targets}
    for camera in problem.cameras:
        for index in np.unique(camera.rays.target):
            name = camera.rays.targets[index]
            count[name] = count.get(name, 0) + 1
    return frozenset(name for name, cameras in count.items() if cameras < 2)


def _jerk(target: TargetInput, problem: Problem) -> float:
    return GROUND_JERK if target.on_ground and problem.ground is not None else FIRST_JERK


def _first_kind(target: TargetInput, method: str, lone: bool) -> MotionKind:
    """Only `map` can let the data say, and begins with a spline; with a still point where one camera alone looks."""
    asked = target.is_asked and method == "map" and not lone
    return "spline" if target.motion == "spline" or asked else "polynomial"


def _first_order(target: TargetInput, method: str, lone: bool) -> int:
    if target.order != "auto":
        return int(target.order)
    return 0 if lone and method == "map" else FIRST_ORDER


def is_still(camera: CameraInput) -> bool:
    """Whether no frame has a pose error of its own."""
    return camera.still or (camera.sigma.attitude_rad == 0 and camera.sigma.position_m == 0)


def pose_errors(problem: Problem, method: str) -> PoseError:
    """Per-frame errors: instruments' for `map`, a free rotation without prior for `algorithm-2`, else none.

    Without a prior the paper's objective has valleys that lead far away (every frame may turn, and shorter rays cost
    less), so `algorithm-2` damps the frames' rotations in every step and stops early, as the paper's descent from the
    measured rotations does by itself.
    """
    spread = np.zeros((len(problem.cameras), 6))
    prior = np.ones((len(problem.cameras), 6))
    if method == "algorithm-2":
        spread[:, ROT], prior[:, ROT] = 1.0, 0.0
    if method == "map":
        for c, camera in enumerate(problem.cameras):
            if not is_still(camera):
                spread[c, ROT], spread[c, POS] = camera.sigma.attitude_rad, camera.sigma.position_m
    return PoseError(spread=spread, prior=prior, damping=1.0 if method == "algorithm-2" else 0.0)


def parameters(problem: Problem) -> int:
    """How many parameters a camera has: more where tracked points may sit elsewhere on their targets."""
    placed = any(sigma > 0 for c in problem.cameras for sigma in c.rays.place_sigma_px)
    return CAMERA_PARAMETERS + (PLACE_PARAMETERS * len(problem.targets) if placed else 0)


def camera_priors(problem: Problem, settings: SolverSettings) -> tuple[Floats, Floats, Bools]:
    """Mean, precision and freedom (C, W) of the cameras' constant parameters for the method in force."""
    width = parameters(problem)
    rows = [_camera_prior(problem, settings, camera, width) for camera in problem.cameras]
    precision = [[s**-2 if f and 0 < s < np.inf else 0.0 for s, f in zip(*r[1:], strict=True)] for r in rows]
    return np.array([r[0] for r in rows]), np.array(precision), np.array([r[2] for r in rows])


def _camera_prior(
    problem: Problem, settings: SolverSettings, camera: CameraInput, width: int
) -> tuple[list[float], list[float], list[bool]]:
    """Mean, sigma and freedom (W,) of one camera's. Lists: small flights are solved in less than arrays take."""
    mean, sigma, free = [0.0] * width, [np.inf] * width, [False] * width
    known, statistical = camera.sigma, settings.method == "map"
    mean[READOUT] = first_readout_s(camera)
    if statistical:
        sigma[ROT] = [known.attitude_bias_rad] * 3
        sigma[POS] = [known.position_bias_m] * 3
        sigma[FOCAL] = known.focal
        sigma[START] = known.start_s if camera.poses_at is not None else 0.0
        sigma[READOUT] = known.readout_s if has_rows(camera) else 0.0
        targets = (width - CAMERA_PARAMETERS) // PLACE_PARAMETERS
        sigma[CAMERA_PARAMETERS:] = camera.rays.place_sigma_px * (2 * targets)
        free = [s > 0 for s in sigma]
        free[OFFSET] = free[SCALE] = False
    if settings.method in TIMED and camera.camera != problem.reference_camera:
        free[OFFSET] = known.offset_s is None or known.offset_s > 0
        free[SCALE] = settings.refine_frame_rate and known.frame_rate > 0 and settings.method != "li"
        if statistical:
            sigma[SCALE] = known.frame_rate
            if known.offset_s is not None and camera.offset_s is not None:
                sigma[OFFSET], mean[OFFSET] = known.offset_s, camera.offset_s
    return mean, sigma, free


def first_camera(problem: Problem, offset_s: Mapping[str, float], rate: Mapping[str, float]) -> Floats:
    """(C, W) first values: clocks as given here, readouts as the problem has them, everything else zero."""
    out = np.zeros((len(problem.cameras), parameters(problem)))
    for c, camera in enumerate(problem.cameras):
        out[c, READOUT] = first_readout_s(camera)
        if camera.camera != problem.reference_camera:
            out[c, OFFSET] = offset_s.get(camera.camera, 0.0)
            out[c, SCALE] = camera.frame_rate / rate.get(camera.camera, camera.frame_rate) - 1
    return out


def first_readout_s(camera: CameraInput) -> float:
    """The readout of a camera's rolling shutter as given; zero where its rows are exposed at once."""
    return camera.readout_s if has_rows(camera) else 0.0


def given_offsets(problem: Problem) -> dict[str, float]:
    """The first guesses of the offsets; zero where nothing is known, as the paper starts."""
    return {c.camera: c.offset_s or 0.0 for c in problem.cameras}


def sighted_ends_s(frames: Frames, time_s: Floats) -> Floats:
    """(N, 2) first and last common time at which each target was seen. Raises GeometryError where one never was."""
    if frames.seen.all():
        return np.array([[time_s.min(), time_s.max()]] * len(frames.targets))
    low = np.where(frames.seen, time_s[:, None], np.inf).min(axis=0)
    high = np.where(frames.seen, time_s[:, None], -np.inf).max(axis=0)
    for name, start_s in zip(frames.targets, low, strict=True):
        if start_s == np.inf:
            raise GeometryError(
                where=f"target {name}", seen="no sighting in any camera", expected="at least two sightings",
                advice="leave the target out, or look at its tracks",
            )  # fmt: skip
    return np.stack([low, high], axis=1)


def basis_at(frames: Frames, choice: MotionChoice, time_s: Floats) -> MotionBasis:
    """The motion basis over the common times in which each target was seen."""
    return build_basis(frames.targets, choice.kinds, choice.orders, sighted_ends_s(frames, time_s), choice.spacing_s)


def first_model(
    problem: Problem, settings: SolverSettings, frames: Frames, choice: MotionChoice, camera: Floats
) -> tuple[Model, State]:
    """A model of the method in force, and the point with these cameras (C, W) and no motion yet."""
    drift = without_drift(frames)
    mean, precision, free = camera_priors(problem, settings)
    time = common_time_s(frames, drift, camera, np.empty(0))
    basis = basis_at(frames, choice, time)
    priors = Priors(
        camera_mean=mean, camera_precision=precision, camera_free=free,
        jerk=np.tile([[_jerk(t, problem)] for t in problem.targets], (1, len(basis.grid_s) - 1)),
        drift_rate=np.zeros(len(frames.cameras)),
    )  # fmt: skip
    loss = BEND[settings.robust] if settings.method == "map" else Loss()
    known, ways = first_known(problem, frames, time) if settings.method == "map" else (None, {})
    model = build_model(frames, basis, drift, pose_errors(problem, settings.method), loss, priors, known=known)
    coefficients = np.zeros((basis.count, 3))
    state = State(
        coefficients=coefficients if known is None else laid_through(basis, coefficients, ways, problem),
        camera=camera, deviation=np.empty(0), own=np.zeros((frames.count, 6)),
        ground=np.zeros(0 if known is None else known.count),
    )  # fmt: skip
    return model, state


def model_with_basis(model: Model, basis: MotionBasis) -> Model:
    """The model with another motion basis, its priors' strengths read from the old spans."""
    jerk = model.priors.jerk[:, model.basis.span(basis.mid_s)]
    return model.changed(basis=basis, priors=replace(model.priors, jerk=jerk))


def with_basis(model: Model, state: State, basis: MotionBasis) -> tuple[Model, State]:
    """The same motion as well as another basis can say it: fitted to its positions, four for every coefficient."""
    changed = model_with_basis(model, basis)
    coefficients = np.zeros((basis.count, 3))
    for n, t in enumerate(basis.targets):
        old = model.basis.targets[n]
        time = np.linspace(t.knots_s[0], t.knots_s[-1], 4 * t.count + 8)
        wanted = _going_on(model.basis, state, n, time, old.knots_s[0], old.knots_s[-1])
        unit = np.zeros((len(time), t.count))
        span = basis.span(time)
        u = (time - basis.mid_s[span]) / basis.half_s[span]
        value = np.einsum("bij,bi->bj", t.transform[span], u[:, None] ** np.arange(basis.degree + 1))
        unit[np.arange(len(time))[:, None], t.active[span][:, None] - t.first + np.arange(t.degree + 1)] = value
        coefficients[t.first : t.first + t.count] = np.linalg.lstsq(unit, wanted, rcond=None)[0]
    return changed, replace(state, coefficients=coefficients)


def _going_on(basis: MotionBasis, state: State, n: int, time_s: Floats, low: float, high: float) -> Floats:
    """(n, 3) positions of a target, beyond `low` and `high` straight on as it was going there."""
    inside = np.clip(time_s, low, high)
    here = basis.position(inside, state.coefficients)[:, n]
    step_s = np.where(inside < 0.5 * (low + high), 1.0, -1.0) * 1e-3 * (high - low)
    velocity = (basis.position(inside + step_s, state.coefficients)[:, n] - here) / step_s[:, None]
    return np.asarray(here + velocity * (time_s - inside)[:, None])
