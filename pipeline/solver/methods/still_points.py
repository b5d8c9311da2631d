"""Landmarks and the ground after an adjustment: where they are, and how they agree with what was said of them."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import GroundFit, Landmark, Problem, Sightings, TargetInput
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.uncertainty.covariance import Covariance


def landmarks_of(
    problem: Problem, model: Model, state: State, plain: Covariance | None, robust: Covariance | None,
    sightings: Sightings,
) -> tuple[Landmark, ...]:  # fmt: skip
    """All landmarks of the problem, check points as points whose coordinates took no part."""
    names = np.array(sightings.target, dtype=object)
    out = []
    for n, target in enumerate(problem.targets):
        if target.landmark:
            residual = sightings.residual_px[names == target.target]
            place = model.order.coefficient[model.basis.targets[n].first]
            own, spread = (
                np.full((3, 3), np.nan) if c is None else c.pairs(place[:, None], place[None, :])
                for c in (plain, robust)
            )
            position = state.coefficients[model.basis.targets[n].first]
            out.append(_landmark(target, position, own, _larger(own, spread), residual))
    return tuple(out)


def _larger(plain: Floats, robust: Floats) -> Floats:
    """The one with the larger trace: one sigma everywhere, the larger of plain and robust."""
    return robust if np.isfinite(robust).all() and np.trace(robust) > np.trace(plain) else plain


def _landmark(target: TargetInput, position: Floats, plain: Floats, told: Floats, residual: Floats) -> Landmark:
    surveyed, off, spread = None, None, None
    if target.surveyed is not None:
        surveyed, claimed = np.array(target.surveyed.position_enu_m), np.diag(np.square(target.surveyed.sigma_m))
        off = position - surveyed
        # what took part has spent its claim: the correction has the variance that was taken from it
        spread = claimed + told if target.check else claimed - plain
    kind = "unknown" if surveyed is None else "check" if target.check else "surveyed"
    return Landmark(
        name=target.target, kind=kind, position_enu_m=position, covariance=told, surveyed_enu_m=surveyed,  # type: ignore[arg-type]
        off_m=off, off_covariance=spread, sightings=len(residual),
        residual_px=float(np.sqrt((residual**2).mean())) if len(residual) else float("nan"),
    )  # fmt: skip


def ground_fits(problem: Problem, model: Model, state: State, covariance: Covariance | None) -> tuple[GroundFit, ...]:
    """What the ground is off by along every target's stretch."""
    known, out = model.known, []
    if known is None:
        return ()
    for n, target in enumerate(problem.targets):
        rows = known.of(n)
        rows = rows[known.axis[rows] < 0]
        if not len(rows):
            continue
        acting = known.shared[rows[0], :2]
        acting = acting[acting >= 0]
        place = model.order.ground[acting]
        sigma = np.nan if covariance is None else np.sqrt(covariance.pairs(place[:, None], place[None, :]).sum())
        out.append(
            GroundFit(
                target=target.target, off_m=float(state.ground[acting].sum()), sigma_m=float(sigma), rows=len(rows)
            )
        )
    return tuple(out)
