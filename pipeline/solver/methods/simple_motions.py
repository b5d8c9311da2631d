"""Whether free motions are what poses did: targets that all look lively, and all go simply once a claim is larger.

Splines and polynomials of high order follow whatever cameras have wrong that changes in time, and fit as well as if
targets moved so; no residual is left to tell it. But that several targets wind where one error of one camera would let
every one of them go straight or along a parabola is no accident. So where several targets are given more than order
`SIMPLE`, all are tried with that and one claim enlarged:

    biases    all cameras' constant errors, or
    lasting   the attitude's or the position's moving error of one camera, as a process

Where they then fit as well as before, by as many degrees of freedom as they save, and do not without, that is
said; nothing is changed. Real turns and stops, each at its own time and place, no error of a camera explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from pipeline.records import Finding, Problem
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.goodness_of_fit import data_cost, redundancy_left
from pipeline.solver.methods.lone_stretches import Lone
from pipeline.solver.methods.model_selection import Descend, adjusted, unit
from pipeline.solver.methods.parameters import MotionChoice, is_still
from pipeline.solver.methods.wandering_poses import with_lasting
from pipeline.solver.observation.clocks import POS, ROT, common_time_s

SIMPLE = 2
"""Order of the motions that are tried. Higher ones follow turns that are real."""
LEAST = 3
"""Targets from which on it is looked at: a turn of a camera, three unknowns, follows what one does, and most of two."""
LONGEST_S, LARGEST = 60.0, 1_000_000
"""Flights longer than this are not looked at: what goes along a parabola for a minute is rare; nor are sightings times
claims beyond so many: two million take a minute."""
ENLARGED, LASTING = 10.0, 30.0
"""By how many times biases' sigmas, and the sigma of what is new in every frame, are enlarged."""
HOLDS = 1e-4
"""Chance at which simple motions that are true would be refused: a doubt costs a look, none costs the flight."""
CLEARLY = 30.0
"""Chi-square by which the enlarged claim must better the same simple motions: twice as much misses small errors, half
as much is reached by motions that are nearly simple."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Claim:
    """One claim enlarged: which camera's (none: all), what of it, and the model with it."""

    camera: int | None
    what: str
    model: Model
    state: State


def simple_motions(
    problem: Problem, choice: MotionChoice, fit: Fit, descend: Descend, alone: Lone
) -> tuple[Finding, ...]:
    """A finding where one enlarged claim lets all targets go simply that do not now; `choice` is in force."""
    free = [
        n for n, t in enumerate(problem.targets)
        if t.is_asked and (choice.kinds[n] == "spline" or choice.orders[n] > SIMPLE)
    ]  # fmt: skip
    if len(free) < LEAST or fit.status != "converged" or _is_large(fit):
        return ()
    orders, left, cost = dict.fromkeys(free, SIMPLE), redundancy_left(fit), data_cost(fit)

    def worse(model: Model, state: State) -> tuple[float, Fit]:
        start = replace(fit, model=model, linear=replace(fit.linear, model=model, state=state))
        simple = adjusted(choice, start, orders, descend, alone)
        return (np.inf if simple.status == "stalled" else 2 * (data_cost(simple) - cost) / unit(fit)), simple

    plain, held = worse(fit.model, fit.state)[0], []
    for claim in _claims(problem, fit):
        excess, simple = worse(claim.model, claim.state)
        if excess + CLEARLY < plain and excess <= chdtri(max(redundancy_left(simple) - left, 3.0), HOLDS):
            held.append(_bias(problem, simple) if claim.camera is None else _lasting(problem, claim, simple))
    return (_told([problem.targets[n].target for n in free], held),) if held else ()


def _is_large(fit: Fit) -> bool:
    frames = fit.model.frames
    time = common_time_s(frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    claims = 1 + 2 * len(frames.cameras)
    return float(np.ptp(time)) > LONGEST_S or claims * int(frames.seen.sum()) > LARGEST


def _claims(problem: Problem, fit: Fit) -> Iterator[_Claim]:
    """The claims that are tried, the simplest first."""
    model, state = fit.model, fit.state
    precision = model.priors.camera_precision.copy()
    for part in (ROT, POS):
        precision[:, part] /= ENLARGED**2
    loose = model.changed(priors=replace(model.priors, camera_precision=precision))
    yield _Claim(camera=None, what="bias", model=loose, state=state)
    for c, camera in enumerate(problem.cameras):
        for what, part, size in (
            ("attitude", ROT, camera.sigma.attitude_rad),
            ("position", POS, camera.sigma.position_m),
        ):
            if size > 0 and not is_still(camera):
                changed = with_lasting(model, state, c, part, LASTING * size)
                yield _Claim(camera=c, what=what, model=changed[0], state=changed[1])


def _told(targets: Sequence[str], held: Sequence[tuple[str, str]]) -> Finding:
    cameras = tuple(dict.fromkeys(camera for camera, _ in held))
    errors = ", or ".join(f"{camera} {error}" for camera, error in held)
    return Finding(
        kind="motions-or-poses",
        subject=", ".join(cameras),
        words=f"{', '.join(targets)} are given motions that wind, but all go along parabolas or simpler where one "
        f"claim is larger: {errors}; what they do may be what poses did",
        carried_by=", ".join(f"cameras.{camera}.sigma" for camera in cameras),
    )


def _bias(problem: Problem, simple: Fit) -> tuple[str, str]:
    """The camera whose constant error is the most of its own claim, and that error."""
    off, precision = simple.state.camera - simple.model.priors.camera_mean, simple.model.priors.camera_precision
    pulls = ENLARGED * np.sqrt(np.stack([(off**2 * precision)[:, part].sum(axis=1) for part in (ROT, POS)]))
    kind, c = np.unravel_index(int(np.argmax(pulls)), pulls.shape)
    size = float(np.linalg.norm(off[c, (ROT, POS)[kind]]))
    error = f"{np.degrees(size):.2g} degrees off" if kind == 0 else f"{size:.2g} m off"
    return problem.cameras[c].camera, f"{error} throughout ({pulls[kind, c]:.1f} sigmas of its claim)"


def _lasting(problem: Problem, claim: _Claim, simple: Fit) -> tuple[str, str]:
    """The camera, and the moving error that it then has."""
    assert claim.camera is not None
    assert simple.model.wander is not None
    own = simple.state.wander[simple.model.wander.of(claim.camera)]
    turned, moved = (float(np.sqrt((own[:, part] ** 2).sum(axis=1).mean())) for part in (ROT, POS))
    error = f"{np.degrees(turned):.2g} degrees" if claim.what == "attitude" else f"{moved:.2g} m"
    return problem.cameras[claim.camera].camera, f"{error} off by errors that last for seconds"
