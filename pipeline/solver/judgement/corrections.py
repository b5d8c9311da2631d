"""What the adjustment took from every prior, parameter by parameter, as people read it.

The figures are those of the prior tests, in a parameter's own unit; the verdict rests on the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from pipeline.records import Correction, Grade
from pipeline.solver.judgement.prior_tests import PriorTest
from pipeline.solver.judgement.settings import JudgementSettings
from pipeline.solver.methods.results import Outcome, parameter_names, parameter_sigma
from pipeline.solver.observation.clocks import FOCAL, SCALE


def corrections(
    found: Outcome,
    tests: Iterable[PriorTest],
    grade_of: Callable[[PriorTest], Grade],
    settings: JudgementSettings,
) -> tuple[Correction, ...]:
    """One row for each parameter that was tested, camera by camera, in the order of the shared parameters."""
    cameras, rows = found.model.frames.cameras, []
    for test in tests:
        camera, grade = cameras.index(test.camera), grade_of(test)
        rows += [(camera, int(k), _of_one(found, test, i, grade, settings)) for i, k in enumerate(test.columns)]
    return tuple(row for *_, row in sorted(rows, key=lambda r: r[:2]))


def _of_one(found: Outcome, test: PriorTest, i: int, grade: Grade, settings: JudgementSettings) -> Correction:
    model, column = found.model, int(test.columns[i])
    camera = model.frames.cameras.index(test.camera)
    value, prior = float(test.correction[i]), float(test.sigma[i])
    in_sigmas = value / prior
    sigma = float(parameter_sigma(found, model.order.camera[camera, [column]])[0])
    if column == FOCAL:  # estimated as a logarithm
        value, sigma = float(np.expm1(value)), float(np.exp(value)) * sigma
    if column == SCALE:  # estimated as what a frame lasts, relative
        rate = float(model.frames.nominal_rate[camera])
        value, prior, sigma = -rate * value / (1 + value), rate * prior, rate / (1 + value) ** 2 * sigma
        in_sigmas = -in_sigmas
    return Correction(
        camera=test.camera,
        parameter=f"{test.camera}.{parameter_names(model)[column]}",
        block=test.what,
        value=value,
        prior_sigma=prior,
        sigma=sigma,
        in_sigmas=in_sigmas,
        beyond=abs(in_sigmas) > settings.marked_sigmas,
        chi_square=test.statistic,
        freedom=test.freedom,
        grade=grade,
    )
