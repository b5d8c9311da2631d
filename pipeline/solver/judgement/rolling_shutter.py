"""Is a camera read out row by row, and nobody said so?

The score test (Rao, Proc. Cambridge Phil. Soc. 44, 1948): at the optimum, with readouts as they were given, one linear
step is taken in which every camera's readout T is free. To first order it is what an adjustment with free readouts
would find, T + dT, and the square of all dT against their covariance is chi-square where all T are true. The covariance
is the plain one and what the cluster-robust one has beyond it, so that residuals which are alike or too large for other
reasons do not count as many.

A log that begins elsewhere, or a clock that is off, moves the whole picture where a readout moves rows against each
other. So both are free in the step as well, given or not: only the rows' differences speak.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Problem, Reason, Solution
from pipeline.solver.adjustment.assembly import Linear, blocks_at, linear
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.model import Model, State, residuals_of
from pipeline.solver.adjustment.renewal import rolled
from pipeline.solver.adjustment.seen_targets import seen_targets
from pipeline.solver.judgement.changes import READOUT_PRIOR_S
from pipeline.solver.judgement.influence import motion_sigmas
from pipeline.solver.judgement.prior_tests import log10_chance, positive_part, whitened_square
from pipeline.solver.judgement.settings import JudgementSettings
from pipeline.solver.judgement.words import readout_words
from pipeline.solver.methods.results import Outcome
from pipeline.solver.observation.clocks import OFFSET, READOUT, SCALE, START
from pipeline.solver.observation.rolling_shutter import add_rows, with_row_numbers
from pipeline.solver.uncertainty.clusters import clusters

CLOCK_PRIOR_S = 0.5
"""What stands for knowing nothing of a start or an offset; twice as much says the same."""
CHUNK_BLOCKS = 1024
"""Blocks whose normal equations are held at once."""


@dataclass(frozen=True, kw_only=True)
class ShutterTest:
    """One camera's readout against what was given.

    given_s, found_s, sigma_s  seconds from the first row to the last
    """

    camera: str
    given_s: float
    found_s: float
    sigma_s: float

    @property
    def z(self) -> float:
        """A standard normal deviate where what was given is true."""
        return abs(self.found_s - self.given_s) / self.sigma_s


@dataclass(frozen=True, kw_only=True)
class ShutterTests:
    """Every camera whose rows are known.

    log10_p  chance of readouts as far from the given ones, all together, as a power of ten
    moves    by how many of its sigmas the motion that moves most would move, root mean square over its time
    """

    cameras: tuple[ShutterTest, ...] = ()
    log10_p: float = 0.0
    moves: float = 0.0


def shutter_tests(problem: Problem, found: Outcome, solution: Solution) -> ShutterTests:
    """The test of every camera whose readout is held."""
    model, state = found.model, found.state
    tested = tuple(c for c in with_row_numbers(problem) if not model.priors.camera_free[c, READOUT])
    if not tested or not model.motion_free:
        return ShutterTests()
    freed = _freed(problem, model, state, tested)
    here = linear(freed, state)
    factor = factorise(here.system)
    if factor is None:
        return ShutterTests()
    step = -factor.solve(here.system.gradient)
    place = freed.order.camera[list(tested), READOUT]
    unit = np.zeros((len(step), len(place)))
    unit[place, np.arange(len(place))] = 1.0
    pull = factor.solve(unit)
    claimed = pull[place]
    variance = claimed + positive_part(counted(freed, state, here, pull) - claimed)
    sigma, given = np.sqrt(np.diag(variance)), state.camera[list(tested), READOUT]
    statistic = whitened_square(step[place] / sigma, variance / np.outer(sigma, sigma))
    cameras = tuple(
        ShutterTest(
            camera=problem.cameras[c].camera, given_s=float(given[k]), found_s=float(given[k] + step[place[k]]),
            sigma_s=float(sigma[k]),
        )
        for k, c in enumerate(tested)
    )  # fmt: skip
    return ShutterTests(
        cameras=cameras, log10_p=log10_chance(statistic, len(tested)), moves=_moves(freed, solution, step)
    )


def counted(model: Model, state: State, here: Linear, pull: Floats) -> Floats:
    """(k, k) covariance of pull' g, g the gradient (n + q,): clusters' gradients as they are, priors as they claim.

    That is the cluster-robust covariance of a few unknowns, whose columns of the inverse are `pull` (n + q, k).
    """
    assert here.data is not None
    cluster = clusters(model, state, residuals_of(model.frames, slice(None), model, state))
    seen = seen_targets(model, *blocks_at(model, state, cluster))
    from_data = pull.T @ here.data[0].times(pull)
    out = pull.T @ here.system.times(pull) - from_data
    each = np.zeros((int(cluster.max()) + 1, pull.shape[1]))
    for part in seen.parts(CHUNK_BLOCKS):
        moved = np.where(part.places[..., None] >= 0, pull[part.places], 0.0)
        by_unknown = part.normals(model).gradient[:, None] @ part.chain()
        np.add.at(each, part.blocks.cluster, (by_unknown @ moved)[:, 0])
    return np.asarray(out + each.T @ each)


def _freed(problem: Problem, model: Model, state: State, cameras: tuple[int, ...]) -> Model:
    """The model with the readouts of some cameras free, and with clocks and starts that nothing holds."""
    priors, frames = model.priors, add_rows(problem, model.frames, cameras)
    free, mean, precision = priors.camera_free.copy(), priors.camera_mean.copy(), priors.camera_precision.copy()

    def loosen(c: int, column: int, sigma_s: float) -> None:
        if not free[c, column]:
            free[c, column], mean[c, column], precision[c, column] = True, state.camera[c, column], sigma_s**-2

    for c, camera in enumerate(problem.cameras):
        if c in cameras:
            loosen(c, READOUT, READOUT_PRIOR_S)
        if not camera.still:
            loosen(c, START, CLOCK_PRIOR_S)
        if camera.camera != problem.reference_camera:
            loosen(c, OFFSET, CLOCK_PRIOR_S)
    if frames.pose_rate is None:  # a start moves these poses, a frame rate does not
        assert frames.rows is not None
        frames, free[:, SCALE] = replace(frames, pose_rate=frames.rows.rate), False
    loosened = replace(priors, camera_free=free, camera_mean=mean, camera_precision=precision)
    changed = model.changed(frames=frames, priors=loosened)
    return replace(changed, frames=rolled(frames, changed, state))


def _moves(model: Model, solution: Solution, step: Floats) -> float:
    """By how many of its sigmas the step moves the motion that it moves most, root mean square over its time."""
    place, claimed = model.order.coefficient, {m.target: m for m in solution.motions if m.covariance_band is not None}
    moved = np.where(place >= 0, step[place], 0.0)
    return max(
        (motion_sigmas(t, moved, [claimed[t.target]]) for t in model.basis.targets if t.target in claimed), default=0.0
    )


def shutter_reasons(problem: Problem, tests: ShutterTests, settings: JudgementSettings) -> list[Reason]:
    """A reason for every camera whose readout is not what was given, the surest first."""
    rates = {c.camera: c.frame_rate for c in problem.cameras}
    if tests.log10_p > settings.readout_care:
        return []
    out = []
    for one in sorted(tests.cameras, key=lambda t: -t.z):
        possible = abs(one.found_s) < 1 / rates[one.camera] + 3 * one.sigma_s
        if one.z < settings.readout_named or abs(one.found_s - one.given_s) < settings.readout_least_s or not possible:
            continue
        told = readout_words(one.camera, one.given_s, one.found_s, one.sigma_s, tests.moves)
        out.append(
            Reason(
                kind="rolling-shutter", subject=one.camera, words=told.words, advice=told.advice, figure=one.z,
                grade="care" if tests.moves > settings.readout_moves else "good",
                measure="readout less the given one, over its sigma",
            )
        )  # fmt: skip
    return out
