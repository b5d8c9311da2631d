"""How the shared parameters depend on each other: the correlation matrix as a heat map, and their sigmas."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Results
from pipeline.report.blocks import figure, note, table
from pipeline.report.text.markup import Html, joined, number, tag
from pipeline.report.text.words import fixed, rounded

MOST, LABELLED = 80, 14
SIDE = 620


def correlations(results: Results) -> Html:
    """Heat map of the correlations and a table of plain and robust sigmas."""
    covariance, names = results.solution.shared_covariance, results.solution.shared_names
    if covariance is None or not len(names):
        return note("The covariance of the shared parameters is not known.")
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.nan_to_num(covariance / np.outer(sigma, sigma))
    order = np.arange(len(names))[:MOST]
    shown = tuple(names[i] for i in order)
    return joined(
        _strongest(matrix, names),
        figure(
            _heat_map(matrix[np.ix_(order, order)], shown), caption=_caption(len(names)), legend=_legend(), wide=True
        ),
        tag("details", tag("summary", "Sigmas of the shared parameters"), _sigma_table(results, sigma)),
    )


def _caption(count: int) -> str:
    return "" if count <= MOST else f"The first {MOST} of {count} parameters."


def _legend() -> Html:
    steps = (-1.0, -0.5, 0.0, 0.5, 1.0)
    keys = [tag("li", tag("i", class_=_sign(r), style=f"opacity:{abs(r) or 0.06:g}"), fixed(r, 1)) for r in steps]
    return tag("ul", *keys, class_="legend heat-key")


def _sign(r: float) -> str:
    return "cell minus" if r < 0 else "cell plus"


def _strongest(matrix: Floats, names: tuple[str, ...]) -> Html:
    rows, cols = np.tril_indices(len(names), -1)
    if not len(rows):
        return Html("")
    order = np.argsort(-np.abs(matrix[rows, cols]), kind="stable")[:3]
    pairs = [f"{names[cols[i]]} with {names[rows[i]]} ({fixed(float(matrix[rows[i], cols[i]]), 2)})" for i in order]
    return note(f"Strongest correlations: {'; '.join(pairs)}.")


def _heat_map(matrix: Floats, names: tuple[str, ...]) -> Html:
    n = len(names)
    margin = 8 + 6.6 * max(len(w) for w in names)
    cell = float(np.clip((SIDE - margin) / n, 15.0, 38.0))
    size, letters = cell * n, min(12.0, cell * 0.8)
    marks = []
    for i in range(n):
        marks.append(
            tag(
                "text",
                names[i],
                x=margin - 6,
                y=cell * (i + 0.5),
                class_="ytick",
                text_anchor="end",
                style=f"font-size:{letters:.1f}px",
            )
        )
        marks += [_cell(matrix[i, j], margin + j * cell, i * cell, cell, n <= LABELLED) for j in range(i + 1)]
        at = f"translate({margin + (i + 0.5) * cell + letters / 3:.1f} {size + 6:.1f}) rotate(-90)"
        marks.append(tag("text", names[i], transform=at, text_anchor="end", style=f"font-size:{letters:.1f}px"))
    box = f"0 0 {margin + size + 4:.0f} {size + margin:.0f}"
    label = f"Correlation matrix of {n} shared parameters"
    svg = tag(
        "svg",
        tag("title", label),
        *marks,
        viewBox=box,
        role="img",
        class_="heat",
        style=f"max-width:{margin + size:.0f}px",
    )
    return tag("div", svg, class_="scroll", tabindex=0, role="region", aria_label=label)


def _cell(r: float, x: float, y: float, side: float, labelled: bool) -> Html:
    strength = min(abs(float(r)), 1.0)
    square = tag(
        "rect", x=x, y=y, width=side - 1, height=side - 1, class_=_sign(r), fill_opacity=number(max(strength, 0.06))
    )
    if not labelled:
        return square
    words = tag(
        "text",
        fixed(float(r), 2),
        x=x + side / 2,
        y=y + side / 2,
        class_="value" + " strong" * (strength > 0.75),
    )
    return tag("g", square, words)


def _sigma_table(results: Results, sigma: Floats) -> Html:
    names, robust = results.solution.shared_names, results.solution.shared_covariance_robust
    head = ["parameter", "sigma"] + (["robust (sandwich)", "robust / plain"] if robust is not None else [])
    rows = []
    for i, name in enumerate(names):
        row = [name, rounded(float(sigma[i]), 3)]
        if robust is not None:
            other = float(np.sqrt(max(robust[i, i], 0)))
            row += [rounded(other, 3), fixed(other / float(sigma[i]), 2) if sigma[i] > 0 else ""]
        rows.append(row)
    return table(head, rows, caption="Sigmas in SI units and radians")
