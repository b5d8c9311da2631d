"""Li's iteration (paper section 2.3): the motion at known times, then every camera's offset at the known motion.

Frame rates stay as they are given. The two halves are the intersection (paper eq. 8) and, per camera, a small
Levenberg-Marquardt in its offset alone, repeated until no offset moves any more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.adjustment.levenberg_marquardt import Descent, Fit, Progress, levenberg_marquardt
from pipeline.solver.adjustment.log_poses import Renew
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.intersection import intersected
from pipeline.solver.observation.clocks import OFFSET

STILL_S = 1e-6
"""Offsets that move less than this in a round have stopped."""


def alternate(
    model: Model, start: State, max_rounds: int, progress: Progress | None = None, renew: Renew | None = None
) -> Fit:
    """Alternate from `start`; `model` has the paper's residual and frees the offsets that may move.

    `renew` takes the model's data anew at a point, where they depend on it.
    """
    model, state = intersected(model, start, renew)
    clocks_only = model.changed(motion_free=False)
    if not model.priors.camera_free.any():
        return Fit(model=model, linear=linear(model, state), status="converged", iterations=1)
    for round_ in range(1, max_rounds + 1):
        offsets = levenberg_marquardt(clocks_only, state, Descent(renew=renew))
        moved = np.abs(offsets.state.camera[:, OFFSET] - state.camera[:, OFFSET]).max()
        model, state = intersected(replace(model, frames=offsets.model.frames), offsets.state, renew)
        if progress is not None:
            progress(round_, offsets.cost)
        if moved < STILL_S:
            return Fit(model=model, linear=linear(model, state), status="converged", iterations=round_)
    return Fit(model=model, linear=linear(model, state), status="iteration-limit", iterations=max_rounds)
