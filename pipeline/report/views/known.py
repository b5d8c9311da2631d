"""Landmarks, check points and the ground: how the answer agrees with what was known."""

from __future__ import annotations

import math

import numpy as np

from pipeline.records import Landmark, Results
from pipeline.report.blocks import note, table
from pipeline.report.text.markup import Html, joined
from pipeline.report.text.words import rounded, whole

KINDS = {"surveyed": "surveyed", "unknown": "unknown place", "check": "check point"}
UNKNOWN = "\u2013"


def known_tables(results: Results) -> Html:
    """A row for each landmark, and for each target on the ground; nothing where there are none."""
    solution = results.solution
    parts = []
    if solution.landmarks:
        head = ("landmark", "kind", "sightings", "residual, px", "sigma, m", "east off, m", "north off, m", "up off, m",
                "error over sigma")  # fmt: skip
        rows = [_row(mark) for mark in solution.landmarks]
        parts.append(table(head, rows, caption="Still points: adjusted minus surveyed", words=2))
        if any(mark.kind == "check" for mark in solution.landmarks):
            parts.append(note("Check points took no part: their error over sigma is about one where claims are true."))
    if solution.ground:
        rows = [[g.target, rounded(g.off_m), rounded(g.sigma_m), whole(g.rows)] for g in solution.ground]
        caption = "The ground under each target: found minus said"
        parts.append(table(("target", "off, m", "sigma, m", "places held"), rows, caption=caption))
    return joined(*parts) if parts else Html("")


def _row(mark: Landmark) -> list[str]:
    off = [UNKNOWN] * 3 if mark.off_m is None else [rounded(float(v)) for v in mark.off_m]
    over = rounded(mark.error_over_sigma) if math.isfinite(mark.error_over_sigma) else UNKNOWN
    sigma = rounded(float(np.sqrt((mark.sigma_m**2).sum())))
    return [mark.name, KINDS[mark.kind], whole(mark.sightings), rounded(mark.residual_px), sigma, *off, over]
