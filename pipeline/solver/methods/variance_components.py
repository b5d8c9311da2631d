"""How strong the priors of spline motion and of drifting clocks are: estimated from the data.

A prior of N rows rho (so that sum (rho x)^2 / s^2 is its share of twice the cost) has the strength s that makes the
data most likely (marginal likelihood, Laplace's form): at its maximum

    s^2 = sum (rho x)^2 / (N - sum rho Sigma rho' / s^2)

where Sigma is the covariance of x: the squares seen, over the rows that the data rather than the prior decide
(MacKay's fixed point). A few rounds of this and of the adjustment settle both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.model import Model, State, is_on_ground, jerk_penalty
from pipeline.solver.uncertainty.covariance import Covariance

WIDEST_CHANGE = 10.0
"""Factor by which a strength may change in one round."""
WINDOW_S, SHRUNK, SLACK = 3.0, 6.0, 3.0
"""The most likely strength is for a typical moment; brisk moments are what a stiff prior would flatten, so the prior is
given this factor of slack. It costs little elsewhere: where sightings are dense they decide anyway."""
SLACKEST_JERK, STIFFEST_JERK = 300.0, 0.03
"""m / s^2.5: nothing seen by cameras moves more wildly, or need be held more smoothly."""
STIFFEST_EVEN_JERK = 0.003
"""The same where a spline stands in for a polynomial that it may be."""
FASTEST_WALK, SLOWEST_WALK = 0.1, 1e-6
"""s / sqrt(s)."""


def renewed(strength: float, square: float, decided: float, low: float, high: float) -> float:
    """The next strength: `square` is sum (rho x)^2 / s^2 now, `decided` the rows that the data decide."""
    factor = float(np.sqrt(square / max(decided, 1e-3)))
    return float(np.clip(strength * np.clip(factor, 1 / WIDEST_CHANGE, WIDEST_CHANGE), low, high))


def renewed_jerk(model: Model, state: State, covariance: Covariance, *, even: bool = False) -> Floats:
    """(N, S) strengths of the white jerk of every spline, one round on.

    `even`: the most likely strength of the whole flight, without slack: what a simpler motion is held against, since
    slack follows noise, and what follows noise fits better than the truth.

    Flight is not equally lively all the time: the strength is estimated over about WINDOW_S around every span, with
    SHRUNK further rows that say what the whole flight says.
    """
    out = model.priors.jerk.copy()
    for n, t in enumerate(model.basis.targets):
        if t.kind != "spline":
            continue
        first, rows, span = jerk_penalty(model, n)
        value = np.einsum("pax,pax->px", rows, state.coefficients[first[:, None] + np.arange(rows.shape[1])])
        now = out[n, span]
        square = (value**2)[:, counted_axes(model, n)].sum(axis=1) * now**2
        decided = decided_rows(model, n, covariance)
        whole = square.sum() / max(float(decided.sum()), 1e-3)
        if even:
            changed = np.clip(np.sqrt(whole), now / WIDEST_CHANGE, now * WIDEST_CHANGE)
            out[n, span] = np.clip(changed, STIFFEST_EVEN_JERK, SLACKEST_JERK)
            continue
        reach = max(1, round(0.5 * WINDOW_S / float(np.median(2 * model.basis.half_s))))
        near = (_around(square, reach) + SHRUNK * whole) / (np.maximum(_around(decided, reach), 0) + SHRUNK)
        wanted = SLACK * np.sqrt(near)
        changed = np.clip(wanted, now / WIDEST_CHANGE, now * WIDEST_CHANGE)
        out[n, span] = np.clip(changed, STIFFEST_JERK, SLACKEST_JERK)
    return out


def decided_rows(model: Model, target: int, covariance: Covariance) -> Floats:
    """(p,) of every span of a spline, how many of its three prior rows the data rather than the prior decide."""
    first, rows, _ = jerk_penalty(model, target)
    place = model.order.coefficient[first[:, None] + np.arange(rows.shape[1])]
    spread = covariance.pairs(place[:, :, None, :], place[:, None, :, :])
    axes = counted_axes(model, target)
    return np.asarray(len(axes) - np.einsum("pax,pabx,pbx->px", rows, spread, rows)[:, axes].sum(axis=1))


def counted_axes(model: Model, target: int) -> list[int]:
    """The axes along which a spline's strength is estimated: not up, where the ground says how it goes."""
    return [0, 1] if is_on_ground(model, target) else [0, 1, 2]


def _around(value: Floats, reach: int) -> Floats:
    """Sums of `value` (p,) over `reach` places to each side."""
    total = np.concatenate([[0.0], np.cumsum(value)])
    at = np.arange(len(value))
    return np.asarray(total[np.minimum(at + reach + 1, len(value))] - total[np.maximum(at - reach, 0)])


def renewed_walk(model: Model, state: State, covariance: Covariance) -> Floats:
    """(C,) rates at which the drifting clocks walk, one round on."""
    out = model.priors.drift_rate.copy()
    for c in range(len(out)):
        own = model.drift.of(c)
        if own.stop - own.start < 4:
            continue
        knots, place = model.drift.knot_s[own], model.order.drift[own]
        scale = 1 / (out[c] * np.sqrt(np.diff(knots)))
        step = np.diff(state.deviation[own]) * scale
        spread = _step_variances(covariance, place) * scale**2
        out[c] = renewed(out[c], float((step**2).sum()), len(step) - float(spread.sum()), SLOWEST_WALK, FASTEST_WALK)
    return out


def _step_variances(covariance: Covariance, place: Ints) -> Floats:
    """Variances of the differences of neighbouring unknowns."""
    a, b = place[:-1], place[1:]
    return np.asarray(covariance.pairs(a, a) + covariance.pairs(b, b) - 2 * covariance.pairs(a, b))


def with_strengths(model: Model, jerk: Floats, walk: Floats) -> Model:
    """The model with other strengths of its priors."""
    return replace(model, priors=replace(model.priors, jerk=jerk, drift_rate=walk))
