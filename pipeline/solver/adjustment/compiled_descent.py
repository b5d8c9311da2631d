"""Points of a descent whose unknowns all sit in the border, for the compiled steps of `_descent.py`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment import _assembly, _band, _descent, _kernels
from pipeline.solver.adjustment._descent import Course, Local
from pipeline.solver.adjustment._kernels import Loosely, Observed, Point, Runs
from pipeline.solver.adjustment.assembly import Linear
from pipeline.solver.adjustment.banded_system import Bordered
from pipeline.solver.adjustment.elimination import kept_room, loosely_of, observed_of
from pipeline.solver.adjustment.known_rows import add_known
from pipeline.solver.adjustment.log_poses import Renew, carry
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, FOCAL
from pipeline.solver.observation.frame_blocks import BLOCK_PARAMETERS, LOCAL_COLUMNS, share_per_second, shortened
from pipeline.solver.observation.observations import Frames

ANY = 1 << 62


def is_dense(model: Model) -> bool:
    """Whether the compiled steps know the model: one span of motion, no clock that drifts."""
    one_span = len(model.basis.grid_s) == 2 and model.order.n_band == 0 and model.drift.count == 0
    settled = model.wander is None or model.wander.count == 0
    return bool(_kernels.AVAILABLE and one_span and settled)


@dataclass(eq=False)
class _Room:
    """Memory for what the elimination keeps of every frame, and the point that it holds it of."""

    kept: Floats
    owner: BorderPoint | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class BorderPoint:
    """The adjustment linearised at a point; see `levenberg_marquardt.Point`."""

    model: Model
    course: Course
    observed: Observed
    camera: Floats
    coefficients: Floats
    own: Floats
    local: Local
    corner: Floats
    gradient: Floats
    cost: float
    frame_gain: float
    room: _Room
    ground: Floats = field(default_factory=lambda: np.zeros(0))

    def step(self, damping: float) -> tuple[Floats, float] | None:
        """The step (q,) at a relative damping and what it is foretold to take off the cost; None: not positive."""
        pivot, foretold, step = _descent.damped_step(self.corner, self.gradient, damping)
        return (step, foretold + self.frame_gain) if pivot > 0 else None

    def tried(self, step: Floats, renew: Renew | None) -> BorderPoint:
        """The adjustment linearised a step away."""
        coefficients, camera, local = _descent.tried(
            self.course, self.local.chain, step, self.coefficients, self.camera
        )
        own, model, observed = self.own, self.model, self.observed
        ground = (
            self.ground
            if model.known is None
            else self.ground + np.where(model.order.ground >= 0, step[model.order.ground], 0.0)
        )
        if self.model.pose.free:
            own = self._own_there(local)
        if renew is not None:
            model = renew(model, self._state(coefficients, camera, own, ground))
            if model is not self.model:
                observed = observed_of(model.frames, _is_placed(model))
        return _linearised(model, self.course, observed, coefficients, camera, own, self.room, ground)

    def _own_there(self, step: Floats) -> Floats:
        """Frames' own errors (F, 6) that go with a step (B, L) of the local unknowns."""
        if self.room.owner is not self:  # a trial has taken the room of what was kept here
            _eliminated(self.model, self.course, self.observed, self.camera, self.own, self.local, self.room.kept)
            self.room.owner = self
        out, placed = np.empty_like(self.own), len(self.local.shift) > 0
        _kernels.kept_steps(
            self.room.kept, len(self.observed.pose_rate) > 0, len(self.observed.by_readout) > 0, placed,
            self.model.pose.spread, _runs(self.course, self.local), self.local.series, step, self.own, out,
        )  # fmt: skip
        return out

    def _state(self, coefficients: Floats, camera: Floats, own: Floats, ground: Floats) -> State:
        return State(coefficients=coefficients, camera=camera, deviation=np.empty(0), own=own, ground=ground)

    def linear(self) -> Linear:
        """The same as every other model has it."""
        corner = np.tril(self.corner) + np.tril(self.corner, -1).T
        system = Bordered(
            band=np.empty((1, 0)), border=np.empty((0, len(corner))), corner=corner, gradient=self.gradient
        )
        return Linear(
            model=self.model, state=self._state(self.coefficients, self.camera, self.own, self.ground),
            system=system, cost=self.cost, frame_gain=self.frame_gain,
        )  # fmt: skip


def linearised(model: Model, start: State) -> BorderPoint:
    """The adjustment linearised at `start`."""
    course, placed = _course(model), _is_placed(model)
    observed = observed_of(model.frames, placed)
    kept = kept_room(model.frames, course.begin, placed, ANY if model.pose.free else 0)
    room = _Room(kept)
    return _linearised(model, course, observed, start.coefficients, start.camera, start.own, room, start.ground)


def squared_lengths(model: Model, state: State) -> Floats:
    """(F, N) squared residuals in sigmas, zero where unseen."""
    course, observed = _course(model), observed_of(model.frames, _is_placed(model))
    local = _localised(model, course, state.coefficients, state.camera)
    out = np.empty(model.frames.seen.shape)
    point = _point(local, state.camera, state.own)
    _kernels.squared_lengths(observed, model.pose.spread, _runs(course, local), point, out)
    return out


def motion_step(model: Model, state: State, frames: Frames, rank: float) -> tuple[Floats, float]:
    """The motion (P, 3) one linear step on, with the linear residuals of `frames`; and the smallest pivot.

    `model` has all coefficients free. Pivot -1: a coefficient touches no sight ray; 0: singular.
    """
    out = np.zeros(state.coefficients.shape)
    course = _course(replace(model, frames=frames))
    return out, _descent.motion_alone(observed_of(frames, False), course, state.camera, rank, out)


def _is_placed(model: Model) -> bool:
    """Whether tracked points may sit elsewhere on their targets."""
    return model.frames.angular and model.priors.camera_mean.shape[1] > CAMERA_PARAMETERS


def _course(model: Model) -> Course:
    frames, basis, order = model.frames, model.basis, model.order
    placed = _is_placed(model)
    begin, low, high = shortened(frames.first), float(basis.grid_s[0]), float(basis.grid_s[1])
    return Course(
        frames.video_s, frames.camera, begin, frames.camera[begin[:-1]], frames.place_share,
        share_per_second(frames) if placed else np.zeros(len(frames.cameras)),
        frames.place_gain if placed else frames.place_gain[:0], basis.firsts, basis.degrees, 0.5 * (low + high),
        0.5 * (high - low), order.coefficient, order.camera,
        _descent.motion_columns(order.coefficient, basis.firsts, basis.degrees, basis.degree + 1),
    )  # fmt: skip


def _localised(model: Model, course: Course, coefficients: Floats, camera: Floats) -> Local:
    blocks, targets = len(course.block_camera), len(course.first)
    placed = len(course.place_gain) > 0
    local = Local(
        np.empty(len(course.video_s)),
        np.empty((blocks, LOCAL_COLUMNS + (4 * targets if placed else 0), camera.shape[1])),
        np.empty((blocks, targets, 3, model.basis.degree + 1)), np.empty((len(course.place_gain), targets, 2)),
    )  # fmt: skip
    _descent.localise(course, coefficients, camera, local)
    return local


def _runs(course: Course, local: Local) -> Runs:
    return Runs(course.begin, course.block_camera, local.u, np.full(len(course.block_camera), course.half_s))


def _point(local: Local, camera: Floats, own: Floats) -> Point:
    return Point(local.series, camera[:, :6].copy(), camera[:, FOCAL].copy(), own, local.shift)


def _eliminated(
    model: Model, course: Course, observed: Observed, camera: Floats, own: Floats, local: Local, kept: Floats
) -> tuple[Floats, Floats, float, float]:
    found: tuple[Floats, Floats, float, float] = _kernels.block_normals(
        observed, loosely_of(model.pose, model.loss), _runs(course, local), _point(local, camera, own), kept
    )
    return found


def _linearised(
    model: Model, course: Course, observed: Observed, coefficients: Floats, camera: Floats, own: Floats, room: _Room,
    ground: Floats,
) -> BorderPoint:  # fmt: skip
    local = _localised(model, course, coefficients, camera)
    normal, gradient, cost, gain = _eliminated(model, course, observed, camera, own, local, room.kept)
    priors = model.priors
    corner, right, prior_cost = _descent.folded(
        course, normal, gradient, local.chain, camera, priors.camera_mean, priors.camera_precision,
        model.order.n_border,
    )  # fmt: skip
    if model.known is not None:
        state = State(coefficients=coefficients, camera=camera, deviation=np.empty(0), own=own, ground=ground)
        nothing: Floats = np.empty((0, model.order.n_border))
        prior_cost += add_known(model, state, nothing, nothing, corner, right)
    point = BorderPoint(
        model=model, course=course, observed=observed, camera=camera, coefficients=coefficients, own=own, local=local,
        corner=corner, gradient=right, cost=cost + prior_cost, frame_gain=gain, room=room, ground=ground,
    )  # fmt: skip
    room.owner = point
    return point


def warm() -> None:
    """Compiles, or loads from disk, everything that a solve uses: its clock shall not count that."""
    if not getattr(_kernels.block_normals, "py_func", None) or _kernels.block_normals.signatures:
        return
    i, f = np.zeros(1, np.int64), np.zeros
    begin = np.array([0, 1])
    ray, gain = np.array([[[0.0, 0.0, 1.0]]]), f((1, 1, 2, 3))
    observed = Observed(
        np.eye(3)[None],
        f((1, 3)),
        f((0, 6)),
        ray,
        gain,
        f((0, 1, 2)),
        f((0, 1, 2)),
        np.ones((1, 1), bool),
        f((0, 1)),
        True,
    )
    kept = _kernels.room(*_kernels.kept_shape(begin, 1, False, False, False))
    runs, camera = Runs(begin, i, f(1), np.ones(1)), f((1, CAMERA_PARAMETERS))
    point = Point(f((1, 1, 3, 1)), f((1, 6)), f(1), f((1, 6)), f((0, 1, 2)))
    weights = Loosely(f((1, 6)), np.ones((1, 6)), 0.0, 0, 1.0)
    normal, gradient, _, _ = _kernels.block_normals(observed, weights, runs, point, kept)
    _kernels.kept_steps(kept, False, False, False, weights.spread, runs, point.series, gradient, point.own, point.own)
    _kernels.squared_lengths(observed, weights.spread, runs, point, f((1, 1)))
    columns: Ints = np.full((1, 3 + BLOCK_PARAMETERS), -1)
    _assembly.assemble(
        normal, gradient, np.ones((1, 1, 1, 1)), i, i, f((1, LOCAL_COLUMNS, BLOCK_PARAMETERS)), columns, 0, 0, 0
    )
    order: Ints = np.arange(3)[None]
    motion = _descent.motion_columns(order, i, i, 1)
    held = np.full(camera.shape, -1)
    course = Course(f(1), i, begin, i, f(1), f(1), f((0, 1)), i, i, 0.0, 1.0, order, held, motion)
    local = Local(f(1), f((1, LOCAL_COLUMNS, CAMERA_PARAMETERS)), point.series, f((0, 1, 2)))
    _descent.localise(course, f((1, 3)), camera, local)
    corner, right, _ = _descent.folded(course, normal, gradient, local.chain, camera, camera, camera, 3)
    _, _, step = _descent.damped_step(corner, right, 1.0)
    _descent.tried(course, local.chain, step, f((1, 3)), camera)
    _descent.motion_alone(observed, course, camera, 1e-12, f((1, 3)))
    _band.inverse_band(np.ones((1, 1)))
    carry(f((1, 6)), f(1), np.eye(3)[None], f((1, 3)))
