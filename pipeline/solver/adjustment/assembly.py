"""From a point to the normal equations of all its unknowns.

Block by block, local power series turn into coefficients and local columns into the cameras' parameters
(`Blocks.local_from_camera`); then the priors come on top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment import _assembly, _kernels
from pipeline.solver.adjustment.banded_system import Bordered
from pipeline.solver.adjustment.elimination import At, BlockNormals, frame_steps
from pipeline.solver.adjustment.known_rows import add_known
from pipeline.solver.adjustment.model import Model, Order, State, drift_penalty, jerk_penalty
from pipeline.solver.adjustment.seen_targets import Seen, seen_targets
from pipeline.solver.observation.clocks import FOCAL, common_time_s
from pipeline.solver.observation.frame_blocks import Blocks, partition

CHUNK_BLOCKS = 4096
"""Most blocks whose normal equations are held at once; one of four targets with splines takes 28 kB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """The adjustment linearised at `state`.

    system  normal equations, gradient included, priors included
    cost    half the (robust) chi-square, priors included
    found   the blocks and the point as they were eliminated, None: worked out when somebody asks
    data    system and cost without priors, for the same point under others; None: not kept
    """

    model: Model
    state: State
    system: Bordered
    cost: float
    frame_gain: float
    kept: Floats | None = None
    found: Seen | None = None
    data: tuple[Bordered, float] | None = None

    @cached_property
    def seen(self) -> Seen:
        """The blocks at the state's clocks, with the targets that they see, and the state at each."""
        return self.found or seen_targets(self.model, *blocks_at(self.model, self.state))


def blocks_at(model: Model, state: State, cluster: Ints | None = None) -> tuple[Blocks, At]:
    """The blocks at a point's clocks, and the point as the elimination wants it."""
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)
    blocks = partition(
        model.frames, model.basis, model.drift, time, state.camera, state.deviation, cluster, model.wander
    )
    bias = state.camera[blocks.camera, :6]
    if model.wander is not None:
        bias = bias + model.wander.at(state.wander, blocks.begin[:-1])
    at = At(
        series=model.basis.series(blocks.span, state.coefficients),
        bias=np.ascontiguousarray(bias),
        focal=np.ascontiguousarray(state.camera[:, FOCAL]),
        own=state.own,
        camera=state.camera,
    )
    return blocks, at


def linear(model: Model, state: State) -> Linear:
    """Normal equations and cost at `state`: one pass over the frames, some blocks at a time to bound the memory."""
    seen = seen_targets(model, *blocks_at(model, state))
    whole, cost, gain, kept = None, 0.0, 0.0, None
    for part in seen.parts(CHUNK_BLOCKS):
        normals = part.normals(model, keep=part is seen)
        system = assemble(model.order, part, normals)
        whole = system if whole is None else whole.plus(system)
        cost, gain, kept = cost + normals.cost, gain + normals.frame_gain, normals.kept
    assert whole is not None
    system, prior_cost = add_priors(model, state, whole)
    return Linear(
        model=model, state=state, system=system, cost=cost + prior_cost, frame_gain=gain, kept=kept,
        found=seen, data=(whole, cost),
    )  # fmt: skip


def linear_again(model: Model, state: State, begun: Linear | None) -> Linear:
    """`linear`, from one that differs in nothing but the priors' strengths where `begun` is such a one."""
    if begun is None or begun.data is None or begun.state is not state:
        return linear(model, state)
    parts = ("frames", "basis", "drift", "pose", "loss", "order", "motion_free", "drift_free", "wander", "known")
    if any(getattr(model, part) is not getattr(begun.model, part) for part in parts):
        return linear(model, state)
    system, prior_cost = add_priors(model, state, begun.data[0])
    return replace(begun, model=model, system=system, cost=begun.data[1] + prior_cost)


def width_of(order: Order, places: Ints) -> int:
    """The band's width for blocks of `places` (B, G): as far apart as two of its unknowns are in one block."""
    inside = (places >= 0) & (places < order.n_band)
    high, low = np.where(inside, places, -1).max(axis=1), np.where(inside, places, order.n_band).min(axis=1)
    return max(order.width, int((high - low).max(initial=0)))


def assemble(order: Order, seen: Seen, normals: BlockNormals) -> Bordered:
    """All blocks' normal equations in the order of the unknowns, without priors; compiled where numba is installed."""
    if not _kernels.AVAILABLE:
        return assemble_plain(order, seen, normals)
    band, border, corner, gradient = _assembly.assemble(
        normals.normal, normals.gradient, seen.transform, seen.degree, seen.row, seen.local_from_camera,
        seen.places, order.n_band, order.n_border, width_of(order, seen.places),
    )  # fmt: skip
    return Bordered(band=band, border=border, corner=corner, gradient=gradient)


def assemble_plain(order: Order, seen: Seen, normals: BlockNormals) -> Bordered:
    """The same in numpy only."""
    n, q, w = order.n_band, order.n_border, width_of(order, seen.places)
    band, border, corner = np.zeros((w + 1) * n), np.zeros(n * q), np.zeros(q * q)
    gradient, low = np.zeros(n + q), 0
    for part in seen.parts(CHUNK_BLOCKS):
        own = slice(low, low + len(part.row))
        low, place = own.stop, part.places
        chain = part.chain()
        turned = np.swapaxes(chain, 1, 2)
        matrix = turned @ normals.normal[own] @ chain
        vector = (turned @ normals.gradient[own, :, None])[..., 0]
        held = place < 0
        gradient += np.bincount(place[~held], vector[~held], minlength=n + q)
        i, j = np.broadcast_arrays(place[:, :, None], place[:, None, :])
        free = (i >= 0) & (j >= 0)
        i, j, value = i[free], j[free], matrix[free]
        for choice, size, index, target in (
            ((i < n) & (j < n) & (i >= j), (w + 1) * n, (i - j) * n + j, band),
            ((i < n) & (j >= n), n * q, i * q + j - n, border),
            ((i >= n) & (j >= n), q * q, (i - n) * q + j - n, corner),
        ):
            target += np.bincount(index[choice], value[choice], minlength=size)
    return Bordered(
        band=band.reshape(w + 1, n), border=border.reshape(n, q), corner=corner.reshape(q, q), gradient=gradient
    )


def add_priors(model: Model, state: State, data: Bordered) -> tuple[Bordered, float]:
    """The system with priors of cameras, drifting clocks and splines on top, and what they cost at `state`."""
    band, border, corner, gradient = data.band.copy(), data.border, data.corner.copy(), data.gradient.copy()
    n, order, priors = data.n_band, model.order, model.priors
    off = state.camera - priors.camera_mean
    pull = priors.camera_precision * off
    free = order.camera >= 0
    place = order.camera[free]
    gradient[place] += pull[free]
    corner[place - n, place - n] += priors.camera_precision[free]
    cost = 0.5 * float((pull * off).sum())
    for c in range(len(model.frames.cameras)):
        if model.drift_free and model.drift.of(c).stop > model.drift.of(c).start:
            matrix = drift_penalty(model.drift, c, float(priors.drift_rate[c]))
            place = order.drift[model.drift.of(c)]
            pulled = matrix @ state.deviation[model.drift.of(c)]
            corner[np.ix_(place - n, place - n)] += matrix
            gradient[place] += pulled
            cost += 0.5 * float(pulled @ state.deviation[model.drift.of(c)])
    if model.wander is not None:
        cost += _add_wander(model, state, corner, gradient)
    if model.motion_free:
        for t in range(len(model.basis.targets)):
            cost += _add_jerk(model, state, t, band, gradient)
        if model.known is not None:
            border = border.copy()
            cost += add_known(model, state, band, border, corner, gradient)
    return Bordered(band=band, border=border, corner=corner, gradient=gradient), cost


def _add_wander(model: Model, state: State, corner: Floats, gradient: Floats) -> float:
    """Adds the Gauss-Markov priors of wandering poses to the corner and the gradient in place; returns their cost."""
    wander, n, cost = model.wander, model.order.n_band, 0.0
    assert wander is not None
    for c, axis, matrix in wander.penalties:
        place, value = model.order.wander[wander.of(c), axis], state.wander[wander.of(c), axis]
        pulled = matrix @ value
        corner[place[:, None] - n, place - n] += matrix
        gradient[place] += pulled
        cost += 0.5 * float(value @ pulled)
    return cost


def _add_jerk(model: Model, state: State, t: int, band: Floats, gradient: Floats) -> float:
    """Adds a spline's white-jerk prior to the band and the gradient in place; returns its cost."""
    target = model.basis.targets[t]
    if target.kind != "spline":
        return 0.0
    first, rows, _ = jerk_penalty(model, t)
    acting = first[:, None] + np.arange(target.degree + 1)
    value = np.einsum("pax,pax->px", rows, state.coefficients[acting])
    place = model.order.coefficient[acting]
    np.add.at(gradient, place, rows * value[:, None, :])
    i, j = place[:, :, None, :], place[:, None, :, :]
    i, j, product = np.broadcast_arrays(i, j, rows[:, :, None] * rows[:, None])
    low = i >= j
    np.add.at(band, ((i - j)[low], j[low]), product[low])
    return 0.5 * float((value**2).sum())


def moved(model: Model, here: Linear, step: Floats) -> State:
    """The point a step (n + q,) away, every frame's own pose error following in closed form."""
    order, state = model.order, here.state

    def part(place: Ints) -> Floats:
        return np.where(place >= 0, step[place], 0.0) if len(step) else np.zeros(place.shape)

    own = state.own
    if model.pose.free:
        seen = here.seen
        local = local_step(seen, step)
        own = own + frame_steps(seen.frames, model.pose, model.loss, seen.at, seen.blocks, local, here.kept)
    return State(
        coefficients=state.coefficients + part(order.coefficient),
        camera=state.camera + part(order.camera),
        deviation=state.deviation + part(order.drift),
        own=own,
        wander=state.wander + part(order.wander),
        ground=state.ground + part(order.ground) if model.known is not None else state.ground,
    )


def local_step(seen: Seen, step: Floats) -> Floats:
    """(B, L): the step of the local unknowns of every block."""
    chosen = np.where(seen.places >= 0, step[seen.places], 0.0)
    out, column = [], 0
    for n, degree in enumerate(seen.degree.tolist()):
        wide = 3 * (degree + 1)
        own = chosen[:, column : column + wide].reshape(len(chosen), 3, degree + 1)
        turned = np.swapaxes(seen.transform[seen.row, n, :, : degree + 1], 1, 2)
        out.append((own @ turned).reshape(len(chosen), -1))
        column += wide
    out.append((seen.local_from_camera @ chosen[:, column:, None])[..., 0])
    return np.concatenate(out, axis=1)
