"""Which cameras' measured poses are off by errors that last, how large these are and how long they last.

Where a flight file or an instrument gives a correlation time, the moving part of the error is a Gauss-Markov process of
that time (`observation/pose_wander.py`), and only what it does between its knots stays new in every frame.

Where nothing is said the measured poses do: what is new in every frame makes them rough (`pose_roughness`). Where they
are clearly smoother than the claim, the rest of it is taken to last, from the first start on; what nothing makes would
leave the scene free to shrink, since errors of frames that stand in for parallax cost less the nearer targets are.

Then the flight does, in two ways. An error that lasts hides in motions and clocks, so that it is
seldom seen itself; but it is missing among what is new in every frame. With A the derivatives of a frame's residuals by
its pose, r those residuals and S the sigmas of what is new, r ~ N(0, I + A S S A'): where that is clearly likelier with
smaller S than the instrument's moving part claims, the rest of that part is taken to last. And frames' own errors that
agree with their neighbours last, whatever their size. How long, and how large, is what makes the data most likely,

    log p(data) = - cost - 1/2 log det N + 1/2 log det P - 1/2 sum log det (I + S A'A S) + const   (Laplace's form)

with N the normal matrix, P the process's precision, the sum over frames.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.records import CameraInput, Finding, Problem
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State, pose_error
from pipeline.solver.methods.goodness_of_fit import misfit
from pipeline.solver.methods.parameters import is_still, pose_errors
from pipeline.solver.observation.clocks import FOCAL, POS, ROT, common_time_s
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.pose_roughness import roughness
from pipeline.solver.observation.pose_wander import between_knots, wander_knots, without_wander
from pipeline.solver.observation.residuals import linearise

AGREEMENT, LAG_S = 4.0, 0.2
"""Sigmas of agreement between frames a lag apart from which on errors are taken to last."""
SHARES = (1.0, 0.7, 0.5, 0.3, 0.1)
"""Shares of the claimed sigma that may be new in every frame."""
MISSING = 8.0
"""Log likelihood by which a smaller share must win: one flight in thousands by chance."""
SMOOTH, LEAST = 0.7, 0.03
"""Share of the claimed sigma below which measured poses are smoother than it; the least that is new: a lens shakes."""
LOOKED_AT = 300
"""Frames of a camera that are looked at for that."""
FIRST_TAU_S = 10.0
"""Correlation time before the data say. Receivers of one frequency wander by decimetres to metres in tens of seconds
(multipath, ionosphere); attitude filters forget in about as long. Twice as long makes errors more like constants, which
have a prior of their own."""
TIMES, SIZES, STEPS = (1 / 3, 3.0), (0.4, 2.5), 2
"""What correlation time and size are multiplied by as long as it helps, so many times at most."""
CLEARLY = 3.0
"""Log likelihood that a process must be worth where no part of the claim is missing: twenty times as likely."""
EXPLAINED = 2.0
"""Chi-square per degree of freedom up to which a process of the first size is taken to explain a misfit."""
Descend = Callable[[Model, State], Fit]


@dataclass(frozen=True, kw_only=True)
class Process:
    """Of the cameras it is tried for: size over what is missing (or claimed), and the correlation time; zero: none."""

    attitude: float = 0.0
    position: float = 0.0
    attitude_tau_s: float = FIRST_TAU_S
    position_tau_s: float = FIRST_TAU_S


MISSED = Process(attitude=1.0, position=1.0)
"""What is missing lasts as claimed: its size and time hide in motions and clocks, where likelihood sees them badly."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Parts:
    """Of a camera's moving errors, shares of the claimed sigma: `new` in every frame, and `lasting` (6,).

    process   how these last; None: as is tried
    between   whether what the process does between its knots is new in every frame, too
    """

    new: Floats
    lasting: Floats
    process: Process | None = None
    between: bool = True


def with_wandering_poses(problem: Problem, fit: Fit, descend: Descend) -> tuple[Fit, tuple[Finding, ...]]:
    """The adjustment with the processes that the data ask for besides those of its start, and what they are."""
    fit, smooth = _best_of_smooth(problem, fit, smooth_parts(problem), descend)
    found, more, process = _asked_for(problem, fit, smooth, descend)
    every = {**smooth, **more}
    return found, tuple(_told(problem.cameras[c], every[c], process if c in more else MISSED) for c in every)


def _asked_for(
    problem: Problem, fit: Fit, smooth: Mapping[int, Parts], descend: Descend
) -> tuple[Fit, Mapping[int, Parts], Process]:
    """The same with what the data ask for of cameras that are not among the `smooth` ones; the process of these."""
    nothing: tuple[Fit, Mapping[int, Parts], Process] = fit, {}, MISSED
    asked = [
        c for c, camera in enumerate(problem.cameras)
        if not is_still(camera) and _is_asked(camera) and c not in smooth
    ]  # fmt: skip
    looked = {c: _missing(problem.cameras[c], fit, c) for c in asked}
    parts = {c: part for c, part in looked.items() if part is not None}
    agreed = {c: _all(problem.cameras[c]) for c in asked if c not in parts and agreement(fit, c) > AGREEMENT}
    both = {**parts, **agreed}

    def tried(process: Process, fit: Fit = fit) -> Fit:
        return _with(problem, fit, {**smooth, **both}, process, descend)

    if not both:
        return nothing
    if parts:
        found = tried(MISSED)
        return (found, both, MISSED) if likelihood(found) > likelihood(fit) + CLEARLY and _helped(found) else nothing
    chosen, found = max(((p, tried(p)) for p in _first(both)), key=lambda trial: likelihood(trial[1]))
    best = likelihood(found)
    if best <= likelihood(fit) + CLEARLY or not _helped(found):
        return nothing
    for key, factors in _refined(both, chosen):
        for factor in factors:
            for _ in range(STEPS):
                other = replace(chosen, **{key: getattr(chosen, key) * factor})
                trial = tried(other, found)
                if likelihood(trial) <= best + 0.5:
                    break
                best, found, chosen = likelihood(trial), trial, other
    return found, both, chosen


def _helped(fit: Fit) -> bool:
    """Whether a process explains the misfit: where it does not, a mistake does, which it would only hide."""
    return misfit(fit)[0] < EXPLAINED


def _is_given(camera: CameraInput) -> bool:
    return (camera.sigma.attitude_tau_s or 0) > 0 or (camera.sigma.position_tau_s or 0) > 0


def _is_asked(camera: CameraInput) -> bool:
    return camera.sigma.attitude_tau_s is None or camera.sigma.position_tau_s is None


def _all(camera: CameraInput) -> Parts:
    """All of the moving part may last, on top of what is new."""
    lasting = np.zeros(6)
    lasting[ROT] = float(camera.sigma.attitude_tau_s is None and camera.sigma.attitude_rad > 0)
    lasting[POS] = float(camera.sigma.position_tau_s is None and camera.sigma.position_m > 0)
    return Parts(new=np.ones(6), lasting=lasting)


def _missing(camera: CameraInput, fit: Fit, c: int) -> Parts | None:
    """What is missing among the errors that are new in every frame; None: nothing, or too little to tell."""
    r, turned, moved = _new_in_frames(fit, c)
    free = _all(camera).lasting
    turns, moves = SHARES if free[ROT].any() else (1.0,), SHARES if free[POS].any() else (1.0,)
    worth = {(a, b): _frames_likelihood(r, turned * a, moved * b) for a in turns for b in moves}
    best = max(worth, key=lambda share: worth[share])
    if worth[best] - worth[1.0, 1.0] < MISSING:
        return None
    new = np.repeat(best, 3)
    return Parts(new=new, lasting=np.sqrt(1 - new**2) * free)


def _new_in_frames(fit: Fit, c: int) -> tuple[Floats, Floats, Floats]:
    """Residuals (f, 2 N) without the frames' own errors, and derivatives (f, 2 N, 3) by claimed sigmas of these."""
    model, state = fit.model, fit.state
    part = model.frames.of(c)
    rows = np.unique(np.linspace(part.start, part.stop - 1, min(LOOKED_AT, part.stop - part.start)).astype(np.int64))
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)[rows]
    position = model.basis.position(time, state.coefficients)
    focal = np.full(len(rows), state.camera[c, FOCAL])
    line = linearise(model.frames, rows, position, pose_error(model, state, rows), focal)  # type: ignore[arg-type]
    seen = model.frames.seen[rows]
    residual = line.residual
    root = np.sqrt(model.loss.weight((residual**2).sum(-1)) * seen)[..., None]
    by_own = line.by_pose * model.pose.spread[c] * root[..., None]
    r = residual * root - (by_own @ state.own[rows][:, None, :, None])[..., 0]
    flat = by_own.reshape(len(rows), -1, 6)
    return r.reshape(len(rows), -1), flat[..., ROT], flat[..., POS]


def _frames_likelihood(r: Floats, turned: Floats, moved: Floats) -> float:
    """Of residuals (f, 2 N) that are white but for a turn and a move of each frame."""
    both = np.concatenate([turned, moved], axis=2)
    inner = np.swapaxes(both, 1, 2) @ both + np.eye(6)
    pull = (np.swapaxes(both, 1, 2) @ r[..., None])[..., 0]
    square = (r**2).sum() - (pull * np.linalg.solve(inner, pull[..., None])[..., 0]).sum()
    return float(-0.5 * square - 0.5 * np.linalg.slogdet(inner)[1].sum())


def _frames_determinant(fit: Fit, c: int) -> float:
    """Sum of log det (I + S A'A S) of a camera's frames."""
    _, turned, moved = _new_in_frames(fit, c)
    both = np.concatenate([turned, moved], axis=2)
    part = fit.model.frames.of(c)
    value = np.linalg.slogdet(np.swapaxes(both, 1, 2) @ both + np.eye(6))[1].mean()
    return float(value * (part.stop - part.start))


def _first(both: Mapping[int, Parts]) -> list[Process]:
    turns, moves = (any(p.lasting[part].any() for p in both.values()) for part in (ROT, POS))
    out = [Process(position=1.0)] if moves else []
    out += [Process(attitude=1.0)] if turns else []
    return [*out, Process(attitude=1.0, position=1.0)] if turns and moves else out


def _refined(both: Mapping[int, Parts], chosen: Process) -> list[tuple[str, tuple[float, ...]]]:
    out: list[tuple[str, tuple[float, ...]]] = []
    for key, part in (("position", POS), ("attitude", ROT)):
        if getattr(chosen, key) > 0 and any(p.lasting[part].any() for p in both.values()):
            out += [(key, SIZES), (f"{key}_tau_s", TIMES)]
    return out


def agreement(fit: Fit, camera: int) -> float:
    """How far the errors of a camera's frames agree with those a lag later, in sigmas of no agreement."""
    frames, part = fit.model.frames, fit.model.frames.of(camera)
    own = fit.state.own[part] * np.asarray(frames.seen[part].any(axis=1), float)[:, None]
    step = float(np.median(np.diff(frames.video_s[part]))) if len(own) > 1 else 1.0
    lag = max(1, round(LAG_S / max(step, 1e-9)))
    if len(own) < 4 * lag + 8:
        return 0.0
    product = (own[:-lag] * own[lag:]).sum(axis=1)
    return float(product.sum() / max(float(np.sqrt((product**2).sum())), 1e-300))


def likelihood(fit: Fit) -> float:
    """Logarithm of the data's likelihood up to a constant; minus infinity where it is not determined."""
    factor, wander = factorise(fit.linear.system), fit.model.wander
    if factor is None or fit.status == "stalled":
        return -np.inf
    known = 0.0
    for c in range(len(fit.model.frames.cameras)):
        if fit.model.pose.spread[c].any():
            known -= _frames_determinant(fit, c)
    for _, _, matrix in wander.penalties if wander is not None else ():
        known += float(np.linalg.slogdet(matrix)[1])
    return float(-fit.cost - 0.5 * factor.log_determinant() + 0.5 * known)


def _ways(model: Model, smooth: Mapping[int, Parts]) -> tuple[Mapping[int, Parts], ...]:
    """What smooth poses' errors may do, the first of which is begun with: last; last, and be new in every frame by what
    the process does between its knots; be new in every frame after all. Only motions that are free to bend follow what
    goes on between knots, so that the first is for these."""
    changing = {c: replace(part, between=True) for c, part in smooth.items()}
    bends = any(t.kind == "spline" for t in model.basis.targets)
    return (smooth, changing, {}) if bends else (changing, {})


def _best_of_smooth(
    problem: Problem, fit: Fit, smooth: Mapping[int, Parts], descend: Descend
) -> tuple[Fit, Mapping[int, Parts]]:
    """The likeliest of what smooth poses' errors may do, from a fit of the first."""
    if not smooth:
        return fit, smooth
    first, *others = _ways(fit.model, smooth)
    best, least, chosen = fit, likelihood(fit), first
    for parts in others:
        trial = _with(problem, fit, parts, MISSED, descend)
        worth = likelihood(trial)
        if worth > least + CLEARLY:
            best, least, chosen = trial, worth, parts
    return best, chosen


def begun(problem: Problem, model: Model, state: State) -> tuple[Model, State]:
    """A start with the processes that are known before the data are looked at: given ones, and smooth poses'."""
    parts = _ways(model, smooth_parts(problem))[0]
    if not parts and not any(_is_given(camera) for camera in problem.cameras):
        return model, state
    return _processed(problem, model, state, parts, MISSED)


def with_lasting(model: Model, state: State, camera: int, part: slice, sigma: float) -> tuple[Model, State]:
    """The model in which the errors `part` of one camera's poses last too, of that sigma; all else as it is."""
    had = model.wander or without_wander(model.frames)
    sigmas, tau_s = had.sigma.copy(), had.tau_s.copy()
    sigmas[camera, part], tau_s[camera, part] = sigma, FIRST_TAU_S
    wander = wander_knots(model.frames, sigmas, tau_s)
    carried = _carried(model, state, model.frames, wander.knot_s, wander.first)
    return model.changed(wander=wander), replace(state, wander=carried)


def smooth_parts(problem: Problem) -> dict[int, Parts]:
    """Of cameras whose measured poses are smoother than errors new in every frame could be: what is new, what lasts."""
    out = {}
    for c, camera in enumerate(problem.cameras):
        rough = None if is_still(camera) or not _is_asked(camera) else roughness(camera.poses)
        if rough is not None:
            free = _all(camera).lasting
            new = np.ones(6)
            for part, most, claim in (
                (ROT, rough[0], camera.sigma.attitude_rad),
                (POS, rough[1], camera.sigma.position_m),
            ):
                if free[part].any() and most < SMOOTH * claim:
                    new[part] = max(most / claim, LEAST)
            if (new < 1).any():
                out[c] = Parts(new=new, lasting=np.sqrt(1 - new**2) * free, process=MISSED, between=False)
    return out


def _with(problem: Problem, fit: Fit, parts: Mapping[int, Parts], process: Process, descend: Descend) -> Fit:
    """The adjustment with all given processes and `process` for the cameras that have `parts`."""
    found = descend(*_processed(problem, fit.model, fit.state, parts, process))
    return replace(found, iterations=fit.iterations + found.iterations)


def _processed(
    problem: Problem, model: Model, state: State, parts: Mapping[int, Parts], process: Process
) -> tuple[Model, State]:
    """The model with all given processes and `process` for the cameras that have `parts`."""
    sigma, tau, given = _sizes(problem, parts, process)
    wander = wander_knots(model.frames, sigma, tau)
    spread = pose_errors(problem, "map").spread.copy()
    for c in range(len(problem.cameras)):
        new = spread[c] * parts[c].new if c in parts else spread[c]
        between = between_knots(wander, c) * (1.0 if c not in parts or parts[c].between else 0.0)
        spread[c] = np.where(
            given[c], np.minimum(spread[c], between), np.hypot(new, np.where(new < spread[c], between, 0))
        )
    pose = replace(model.pose, spread=spread)
    own = (
        state.own
        * np.divide(model.pose.spread, spread, out=np.zeros(spread.shape), where=spread > 0)[model.frames.camera]
    )
    start = replace(state, own=own, wander=_carried(model, state, model.frames, wander.knot_s, wander.first))
    return model.changed(wander=wander if wander.count else None, pose=pose), start


def _sizes(problem: Problem, parts: Mapping[int, Parts], process: Process) -> tuple[Floats, Floats, Bools]:
    """Sigma and correlation time (C, 6), and which of them are given."""
    count = len(problem.cameras)
    sigma, tau, given = np.zeros((count, 6)), np.ones((count, 6)), np.zeros((count, 6), dtype=bool)
    for c, camera in enumerate(problem.cameras):
        known = camera.sigma
        own = parts[c].process or process if c in parts else process
        for part, size, claimed_s, share, tau_s in (
            (ROT, known.attitude_rad, known.attitude_tau_s, own.attitude, own.attitude_tau_s),
            (POS, known.position_m, known.position_tau_s, own.position, own.position_tau_s),
        ):
            if is_still(camera):
                continue
            if claimed_s is not None and claimed_s > 0:
                sigma[c, part], tau[c, part], given[c, part] = size, claimed_s, True
            elif c in parts:
                sigma[c, part], tau[c, part] = share * parts[c].lasting[part] * size, tau_s
    return sigma, tau, given


def _carried(model: Model, state: State, frames: Frames, knot_s: Floats, first: Ints) -> Floats:
    """(K, 6) errors at new knots, read from the old ones."""
    out = np.zeros((len(knot_s), 6))
    if model.wander is None:
        return out
    for c in range(len(frames.cameras)):
        old, new = model.wander.of(c), slice(int(first[c]), int(first[c + 1]))
        if old.stop > old.start:
            for axis in range(6):
                out[new, axis] = np.interp(knot_s[new], model.wander.knot_s[old], state.wander[old, axis])
    return out


def _told(camera: CameraInput, parts: Parts, process: Process) -> Finding:
    words, keys = [], []
    for key, part, unit, size, tau_s in (
        ("position", POS, "m", camera.sigma.position_m * process.position, process.position_tau_s),
        ("attitude", ROT, "degrees", np.degrees(camera.sigma.attitude_rad * process.attitude), process.attitude_tau_s),
    ):
        lasting = float(parts.lasting[part].max(initial=0.0)) * size
        if lasting > 0:
            words.append(f"{key} {lasting:.2g} {unit} for {tau_s:.2g} s")
            keys.append(f"cameras.{camera.camera}.sigma.{key}_tau_s")
    return Finding(
        kind="wandering-poses",
        subject=camera.camera,
        words=f"pose errors of {camera.camera} are not new in every frame; taken to last: " + ", ".join(words),
        carried_by=", ".join(keys),
    )
