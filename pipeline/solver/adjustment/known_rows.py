"""What is known of motions apart from sightings, as a share of the normal equations.

Added on top of what sightings say (`assembly.add_priors`, `compiled_descent`), outside of everything compiled: a flight
without ground and landmarks has no such rows and pays nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.solver.observation.known_motion import KnownRows, linearised_rows

if TYPE_CHECKING:
    from pipeline.solver.adjustment.model import Model, State


def rows_of(model: Model, state: State) -> list[KnownRows]:
    """The rows at a point; none where nothing is known."""
    if model.known is None or not model.motion_free:
        return []
    return linearised_rows(
        model.known, model.basis, state.coefficients, state.ground, model.order.coefficient, model.order.ground
    )


def known_square(model: Model, state: State) -> float:
    """Squared residuals of the rows and of the ground's errors, in sigmas."""
    if model.known is None:
        return 0.0
    errors = float(((state.ground / model.known.shared_sigma_m) ** 2).sum())
    return errors + sum(float((rows.residual**2).sum()) for rows in rows_of(model, state))


def add_known(
    model: Model, state: State, band: Floats, border: Floats, corner: Floats, gradient: Floats | None = None
) -> float:
    """Adds the rows and the priors of the ground's errors, in place; returns what they cost.

    band (w + 1, n) lower form, border (n, q), corner (q, q) whole, gradient (n + q,)
    """
    if model.known is None:
        return 0.0
    n, cost = border.shape[0], 0.0
    for rows in rows_of(model, state):
        cost += 0.5 * float((rows.residual**2).sum())
        if gradient is not None:
            free = rows.places >= 0
            np.add.at(gradient, rows.places[free], (rows.columns * rows.residual[:, None])[free])
        _add_products(rows, n, band, border, corner)
    precision = model.known.shared_sigma_m**-2.0
    free = model.order.ground >= 0
    place = model.order.ground[free]
    corner[place - n, place - n] += precision[free]
    if gradient is not None:
        gradient[place] += (precision * state.ground)[free]
    return cost + 0.5 * float((precision * state.ground**2).sum())


def _add_products(rows: KnownRows, n: int, band: Floats, border: Floats, corner: Floats) -> None:
    i, j = np.broadcast_arrays(rows.places[:, :, None], rows.places[:, None, :])
    value = rows.columns[:, :, None] * rows.columns[:, None, :]
    free = (i >= 0) & (j >= 0)
    i, j, value = i[free], j[free], value[free]
    inside = (i < n) & (j <= i)
    np.add.at(band, (i[inside] - j[inside], j[inside]), value[inside])
    across = (i < n) & (j >= n)
    np.add.at(border, (i[across], j[across] - n), value[across])
    low = (i >= n) & (j >= n)
    np.add.at(corner, (i[low] - n, j[low] - n), value[low])
