"""Where an adjustment begins: the candidates for the offsets, a first motion, and a descent that forgives the start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.records import Finding, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.adjustment import _kernels, compiled_descent
from pipeline.solver.adjustment.assembly import blocks_at
from pipeline.solver.adjustment.elimination import HUBER, NONE, Loss, squared_lengths
from pipeline.solver.adjustment.levenberg_marquardt import SMALL, Descent, Fit, levenberg_marquardt
from pipeline.solver.adjustment.model import Model, State, residuals_of
from pipeline.solver.methods.intersection import intersect, intersect_weighted
from pipeline.solver.methods.parameters import MotionChoice, first_camera, first_model, given_offsets
from pipeline.solver.methods.wandering_poses import begun
from pipeline.solver.observation.clocks import OFFSET, SCALE, common_time_s
from pipeline.solver.observation.observations import Frames
from pipeline.solver.offset_search.search import search_offsets

TRIED = 3
"""Offset candidates that are given a short adjustment each."""
TRIAL = 25
"""Iterations of it."""


@dataclass(frozen=True, kw_only=True)
class Stages:
    """Of a graduated loss: how many, iterations of each at most, what ends one, median residuals at which it bends.

    short_of  what ends an adjustment to which sightings are still going to come back
    """

    count: int
    short: int
    coarse: float
    far: float
    short_of: float


STAGES = Stages(count=4, short=8, coarse=1e-2, far=2.5, short_of=1e-3)
MARGIN, SAME_S = 0.3, 0.1
"""Share by which the search's cost may be worse for a candidate to be tried; clocks nearer than this are the same."""
NEAREST, READMITTED = 0.1, 4
"""Share of a camera's median depth below which a start has no business, and how often sightings may come back."""
CLEARLY_WORSE = 10.0
"""Cost (half chi-square) by which the next best offsets must be worse not to be called ambiguous."""


def candidates(problem: Problem, settings: SolverSettings) -> tuple[OffsetCandidate, ...]:
    """Offsets to start from: what the problem gives, or what the global search finds, best first."""
    unknown = any(c.offset_s is None for c in problem.cameras if c.camera != problem.reference_camera)
    if unknown and settings.method in ("algorithm-1", "algorithm-2", "map"):
        return search_offsets(problem, settings)
    return (OffsetCandidate(offset_s=given_offsets(problem), cost=0.0),)


def best_start(
    found: tuple[OffsetCandidate, ...], begin: Callable[[OffsetCandidate, int], Fit], iterations: int
) -> tuple[Fit, tuple[OffsetCandidate, ...], tuple[Finding, ...]]:
    """A short adjustment from each of the best candidates; the lowest cost goes on.

    All are reported: those that were tried where they ended and with the cost they reached, the others as much worse
    than the best as the search found them.
    """
    if len(found) == 1:
        return begin(found[0], iterations), found, ()
    worst = found[0].cost * (1 + MARGIN) + CLEARLY_WORSE
    tried = [c for c in found[:TRIED] if c.cost <= worst]
    fits = sorted((begin(c, min(TRIAL, iterations)) for c in tried), key=lambda fit: fit.cost)
    apart = [fit for i, fit in enumerate(fits) if all(differ(fit, other) for other in fits[:i])]
    left = [replace(c, cost=apart[0].cost + c.cost - found[0].cost) for c in found if c not in tried]
    reported = (*(_reached(fit) for fit in apart), *left)
    return fits[0], reported, ambiguous(reported)


def differ(one: Fit, other: Fit) -> bool:
    """Whether two adjustments ended at clocks that differ at some camera's mid-video."""
    frames = one.model.frames
    times = [common_time_s(frames, f.model.drift, f.state.camera, f.state.deviation) for f in (one, other)]
    middle = [(frames.of(c).start + frames.of(c).stop) // 2 for c in range(len(frames.cameras))]
    return bool(np.abs(times[0] - times[1])[middle].max() > SAME_S)


def _reached(fit: Fit) -> OffsetCandidate:
    """Where an adjustment from a candidate ended; frame rates relative to the given ones are in the state's scale."""
    frames, camera = fit.model.frames, fit.state.camera
    rate = frames.nominal_rate / (1 + camera[:, SCALE])
    return OffsetCandidate(
        offset_s={name: float(camera[c, OFFSET]) for c, name in enumerate(frames.cameras)},
        frame_rate={name: float(rate[c]) for c, name in enumerate(frames.cameras)},
        cost=fit.cost,
    )


def ambiguous(ranked: tuple[OffsetCandidate, ...]) -> tuple[Finding, ...]:
    """A finding where the second best offsets are not clearly worse than the best."""
    if len(ranked) < 2 or ranked[1].cost - ranked[0].cost > CLEARLY_WORSE:
        return ()
    other = ", ".join(f"{name} {value:+.2f} s" for name, value in ranked[1].offset_s.items())
    return (
        Finding(
            kind="ambiguous-offset",
            subject="",
            words=f"other time offsets fit nearly as well ({other}): the cost differs by only "
            f"{ranked[1].cost - ranked[0].cost:.1f}",
        ),
    )


def statistical_start(
    problem: Problem, settings: SolverSettings, frames: Frames, choice: MotionChoice, candidate: OffsetCandidate
) -> tuple[Model, State]:
    """The motion by weighted intersection at a candidate's clocks, or by plain intersection where that is enough."""
    camera = first_camera(problem, candidate.offset_s, candidate.frame_rate)
    model, state = begun(problem, *first_model(problem, settings, frames, choice, camera))
    found = intersect_weighted(model, state) if "spline" in choice.kinds else intersect(model, state)
    return model, found if model.known is None else as_known(model, state, found)


def as_known(model: Model, known: State, found: State) -> State:
    """The state `found` with what is known of motions as it was: rays draw targets into a single camera."""
    assert model.known is not None
    coefficients = found.coefficients.copy()
    for n in np.unique(model.known.target):
        own = model.basis.targets[int(n)]
        coefficients[own.first : own.first + own.count] = known.coefficients[own.first : own.first + own.count]
    return replace(found, coefficients=coefficients, ground=known.ground)


def graduated(model: Model, state: State, descent: Descent, small: float = SMALL) -> Fit:
    """Levenberg-Marquardt from far: the robust loss bends late at first, so that errors of the start are no outliers.

    Each stage bends at `STAGES.far` times the median residual that it finds, until that is nearly the loss' own bend.
    """
    wanted, done = model.loss, 0
    for _ in range(STAGES.count if wanted.kind != NONE else 0):
        bend = STAGES.far * float(np.median(residual_lengths(model, state)))
        if bend <= 1.5 * wanted.bend:
            break
        eased = replace(model, loss=Loss(kind=HUBER, bend=bend))
        fit = levenberg_marquardt(eased, state, replace(descent, max_iterations=STAGES.short), small=STAGES.coarse)
        model, state, done = replace(fit.model, loss=wanted), fit.state, done + fit.iterations
    left = replace(descent, max_iterations=max(1, descent.max_iterations - done))
    fit = levenberg_marquardt(model, state, left, small=small)
    return replace(fit, iterations=fit.iterations + done)


def cleared(model: Model, state: State, descent: Descent, small: float = SMALL) -> Fit:
    """`graduated`, where the start puts splines behind a camera or into it.

    Where one camera alone sees a target, intersection draws it into the camera, and what is behind cannot come out
    again. Such sightings are left out at first, and come back once the motion without them passes before the camera.
    """
    if all(t.kind == "polynomial" for t in model.basis.targets):
        return graduated(model, state, descent, small)
    whole, hidden = model.frames, too_near(model, state)
    finished = not hidden.any()  # nothing is going to come back
    if not finished:
        model = model.changed(frames=without(whole, whole, hidden))
        state = intersect_weighted(model, state)
    fit = graduated(model, state, descent, small if finished else max(small, STAGES.short_of))
    for n in range(READMITTED):
        seen = fit.model.changed(frames=without(fit.model.frames, whole, np.zeros_like(hidden)))
        again = too_near(seen, fit.state)
        settled = (again == hidden).all()
        if settled and finished:
            break
        hidden = again
        model = fit.model.changed(frames=without(fit.model.frames, whole, hidden))
        last = settled or n == READMITTED - 1
        more = levenberg_marquardt(model, fit.state, descent, small=small if last else max(small, STAGES.short_of))
        fit, finished = replace(more, iterations=fit.iterations + more.iterations), last
        if settled:
            break
    return fit


def too_near(model: Model, state: State) -> Bools:
    """(F, N) sightings whose target is behind their camera, or in it."""
    frames = model.frames
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    away = model.basis.position(time, state.coefficients) - frames.position_m[:, None]
    depth = np.einsum("fni,fij,fnj->fn", frames.ray, frames.cam_from_enu, away, optimize=True)
    out = np.zeros(frames.seen.shape, dtype=bool)
    for c in range(len(frames.cameras)):
        own = depth[frames.of(c)]
        usual = float(np.median(own[frames.seen[frames.of(c)]])) if frames.seen[frames.of(c)].any() else 0.0
        out[frames.of(c)] = own < NEAREST * max(usual, 0.0)
    return out & frames.seen


def without(frames: Frames, whole: Frames, hidden: Bools) -> Frames:
    """The frames with the sightings of `whole` but those `hidden` (F, N)."""
    shown = whole.seen & ~hidden
    return replace(
        frames, seen=shown, gain=whole.gain * shown[..., None, None], ray=whole.ray, rows=whole.rows,
        sigma_px=np.where(shown, whole.sigma_px, np.nan), place_gain=np.where(shown, whole.place_gain, 0.0),
        by_readout=whole.by_readout * shown[..., None] if len(whole.by_readout) else whole.by_readout,
    )  # fmt: skip


def left_out(whole: Frames, frames: Frames, told: Bools | None = None) -> tuple[Finding, ...]:
    """A finding for every camera of whose sightings some, but for those `told` (F, N) already, were never used.

    Where they are most of what the camera saw, it is `left-out`; few cost the answer nothing but its ends.
    """
    if frames is whole:
        return ()
    missing = whole.seen & ~frames.seen if told is None else whole.seen & ~frames.seen & ~told
    out = []
    for c, name in enumerate(frames.cameras):
        part = frames.of(c)
        count = int(missing[part].sum())
        if count:
            out.append(
                Finding(
                    kind="left-out" if 2 * count > whole.seen[part].sum() else "seen-by-one",
                    subject=name,
                    words=f"{count} sightings of {name} are left out: no other camera sees the target then, and its "
                    f"motion before and after would pass behind {name} or through it",
                )
            )
    return tuple(out)


def residual_lengths(model: Model, state: State) -> Floats:
    """(m,) length of every sighting's residual in sigmas."""
    if compiled_descent.is_dense(model):
        return np.asarray(np.sqrt(compiled_descent.squared_lengths(model, state)[model.frames.seen]))
    if _kernels.AVAILABLE:
        blocks, at = blocks_at(model, state)
        return np.asarray(np.sqrt(squared_lengths(model.frames, model.pose, at, blocks)[model.frames.seen]))
    return np.asarray(np.linalg.norm(residuals(model, state)[model.frames.seen], axis=-1))


def residuals(model: Model, state: State) -> Floats:
    """(F, N, 2) residuals in sigmas."""
    return residuals_of(model.frames, slice(None), model, state)
