"""How well an adjustment fits: its cost without the splines' priors, against what is left over after its unknowns.

A spline's unknowns count as far as the data rather than its prior decide them, so that a stiff spline of many
coefficients is no richer than the parabola that it is.
"""

from __future__ import annotations

import numpy as np

from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import jerk_penalty
from pipeline.solver.methods.variance_components import decided_rows
from pipeline.solver.uncertainty.covariance import Covariance, Inverse


def misfit(fit: Fit) -> tuple[float, float]:
    """Chi-square per degree of freedom, splines' priors left out, and how many sigmas it is above one."""
    left = max(redundancy_left(fit), 1.0)
    factor = 2 * data_cost(fit) / left
    return factor, (factor - 1) * float(np.sqrt(left / 2))


def spline_unknowns(fit: Fit, target: int, covariance: Covariance) -> float:
    """How many unknowns of a spline the data decide: nine of a parabola, and what they move against its prior."""
    return 9.0 + float(decided_rows(fit.model, target, covariance).sum())


def data_cost(fit: Fit) -> float:
    """The cost without what the splines' priors add."""
    cost = fit.cost
    for n, t in enumerate(fit.model.basis.targets):
        if t.kind == "spline":
            first, rows, _ = jerk_penalty(fit.model, n)
            value = np.einsum("pax,pax->px", rows, fit.state.coefficients[first[:, None] + np.arange(rows.shape[1])])
            cost -= 0.5 * float((value**2).sum())
    return cost


def redundancy_left(fit: Fit) -> float:
    """Equations and priors less the unknowns that they decide; a spline's count as far as the data decide them."""
    model, factor = fit.model, factorise(fit.linear.system)
    frames, order = model.frames, model.order
    known = int(((model.priors.camera_precision > 0) & (order.camera >= 0)).sum())
    known += int((order.wander >= 0).sum())
    equations = 0.0 if model.known is None else float(len(model.known.target) + model.known.count)
    own = model.pose.spread[frames.camera] * (1 - model.pose.prior[frames.camera])
    left = 2 * float(frames.seen.sum()) + known + equations - order.n_border - float((own > 0).sum())
    for n, t in enumerate(model.basis.targets):
        if t.kind == "spline":
            left -= 3 * t.count if factor is None else spline_unknowns(fit, n, Inverse(factor=factor))
    return left
