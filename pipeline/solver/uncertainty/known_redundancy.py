"""What the squares of rows beside sightings, and of the ground's errors, sum to on average if all claims are true."""

from __future__ import annotations

import numpy as np

from pipeline.solver.adjustment.known_rows import rows_of
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.uncertainty.covariance import Covariance


def known_redundancy(model: Model, state: State, covariance: Covariance) -> float:
    """One for each row less its leverage, the ground's errors' priors less what they leave open; zero without rows."""
    if model.known is None:
        return 0.0
    total = float(len(model.known.target))
    for rows in rows_of(model, state):
        held = np.where(rows.places >= 0, rows.places, rows.places[:, :1])
        columns = np.where(rows.places >= 0, rows.columns, 0.0)
        spread = covariance.pairs(held[:, :, None], held[:, None, :])
        total -= float(np.einsum("ki,kij,kj->", columns, spread, columns))
    place = model.order.ground[model.order.ground >= 0]
    left = 1 - covariance.pairs(place, place) / model.known.shared_sigma_m[model.order.ground >= 0] ** 2
    return max(total + float(np.maximum(left, 0).sum()), 0.0)
