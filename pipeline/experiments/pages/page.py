"""An outcome as one self-contained HTML page: the paper's tables and figures, ours marked, its numbers beside ours."""

from __future__ import annotations

import math
from importlib.resources import files

from calibration.foundation.palette import palette
from pipeline.experiments.declare import Axes, Curve, Drawing, Grid, Path3D
from pipeline.experiments.pages.curves import curve_figure
from pipeline.experiments.pages.paths import path_figure
from pipeline.experiments.statistics.figures import Figure, figure_of, words
from pipeline.experiments.statistics.summary import Outcome
from pipeline.experiments.statistics.verdict import sentence, verdict, where
from pipeline.report.text.markup import Html, joined, tag

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def render_page(outcome: Outcome) -> str:
    """The page. It depends on the outcome alone: the same runs give the same bytes."""
    e = outcome.experiment
    flown = outcome.runs.shape[1]
    head = joined(
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"{e.title} \u2013 runningfix"),
        tag("link", rel="icon", href="data:,"),
        tag("style", Html("\n" + palette() + files(__package__).joinpath("page.css").read_text(encoding="utf-8"))),
    )
    body = joined(
        tag("p", " \u2013 ".join(filter(None, (f"runningfix experiment {e.name}", e.paper))), class_="kicker"),
        tag("h1", e.title),
        tag("p", e.about),
        tag("p", tag("b", "Geometry"), f" (ours: the paper does not publish its own): {e.geometry}."),
        tag("p", f"{flown} runs for every cell, seed {outcome.seed}. Figures are means \u00b1 their standard error; "
            "ratios stand with their 95 % interval."),
        *(_drawing(outcome, d) for d in e.drawings),
        _verdict(outcome),
        tag("h2", "What to know"),
        tag("ul", *(tag("li", r) for r in (*e.remarks, ABOUT_BOUND))),
    )  # fmt: skip
    page = tag("html", tag("head", head), tag("body", tag("main", body)), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


ABOUT_BOUND = (
    "Bound: the least mean error that any method can have on average under this noise, from the inverse of the Fisher "
    "information of sightings and priors at the truth (Bayesian Cram\u00e9r-Rao). A method that is told nothing of an "
    "error, or a wrong start that happens to lie near the truth, can be lucky below it in single cells."
)


def _drawing(outcome: Outcome, drawing: Drawing) -> Html:
    if isinstance(drawing, Grid):
        return grid_table(outcome, drawing)
    if isinstance(drawing, Axes):
        return axes_table(outcome, drawing)
    if isinstance(drawing, Curve):
        return curve_figure(outcome, drawing)
    assert isinstance(drawing, Path3D)
    return path_figure(drawing, outcome.paths[drawing.cell], outcome.experiment.approaches)


def grid_table(outcome: Outcome, grid: Grid) -> Html:
    """Approaches down, cells across; below them the bound."""
    e = outcome.experiment
    factors = list(dict.fromkeys(f for c in e.cells for f in c.values))
    top = [
        tag(
            "tr", tag("th", factor.replace("_", " "), scope="row"),
            *(tag("th", str(c.values.get(factor, ""))) for c in e.cells),
        )
        for factor in factors
    ]  # fmt: skip
    rows, limits = [], [float("nan")] * len(e.cells)
    for a, approach in enumerate(e.approaches):
        cells = []
        for c in range(len(e.cells)):
            entry = outcome.entry(c, a)
            if entry is None:
                cells.append(tag("td", "", class_="n"))
                continue
            figure = figure_of(outcome, entry, grid.measure)
            if not math.isfinite(limits[c]):
                limits[c] = figure.bound
            cells.append(number_cell(figure))
        rows.append(tag("tr", tag("th", approach.name, scope="row"), *cells, class_="ours" if approach.ours else None))
    if any(math.isfinite(v) for v in limits):
        rows.append(
            tag(
                "tr",
                tag("th", "bound", scope="row"),
                *(tag("td", words(v), class_="n") for v in limits),
                class_="limit",
            )
        )
    whole = tag("table", tag("caption", grid.caption), tag("thead", *top), tag("tbody", *rows))
    return tag("div", whole, class_="scroll", tabindex=0, role="region", aria_label=grid.caption)


def number_cell(figure: Figure) -> Html:
    """Value, its error or interval, and the paper's number where it prints one."""
    parts: list[Html | str] = [words(figure.value)]
    if math.isfinite(figure.error) and math.isfinite(figure.value):
        parts.append(tag("small", f" \u00b1 {words(figure.error, 2)}"))
    if math.isfinite(figure.low) and figure.low < figure.high:
        parts.append(tag("small", f" ({words(figure.low)} to {words(figure.high)})"))
    if math.isfinite(figure.published):
        parts.append(tag("span", f"paper {words(figure.published)}", class_="published"))
    return tag("td", *parts, class_="n")


def axes_table(outcome: Outcome, axes: Axes) -> Html:
    """Root mean square errors by axis and in space, and the mean, in the form of the paper's Tables 3 and 4."""
    names = ("\u03c3x east", "\u03c3y north", "\u03c3z up", "\u03c3 in space", "mean", "median", "paper \u03c3")
    top = tag("tr", tag("th", "method", scope="col"), *(tag("th", n, scope="col", class_="n") for n in names))
    rows, limit = [], None
    for a, approach in enumerate(outcome.experiment.approaches):
        entry = outcome.entry(axes.cell, a)
        if entry is not None:
            figures = (*entry.axes_m, entry.rms_m, entry.error_m.mean, entry.median_m, entry.published)
            cells = (tag("td", words(v), class_="n") for v in figures)
            rows.append(
                tag("tr", tag("th", approach.name, scope="row"), *cells, class_="ours" if approach.ours else None)
            )
            limit = (*entry.bound_axes_m, entry.bound_rms_m, entry.bound_m, float("nan"), float("nan"))
    if limit is not None:
        rows.append(
            tag(
                "tr", tag("th", "bound", scope="row"), *(tag("td", words(v), class_="n") for v in limit), class_="limit"
            )
        )
    whole = tag("table", tag("caption", axes.caption), tag("thead", top), tag("tbody", *rows))
    return tag("div", whole, class_="scroll", tabindex=0, role="region", aria_label=axes.caption)


def _verdict(outcome: Outcome) -> Html:
    """Where the reference is not better than another method, beyond the Monte Carlo error."""
    e, found = outcome.experiment, verdict(outcome)
    lines = [
        tag(
            "li",
            f"{where(outcome, entry)}: {e.approaches[entry.approach].name} is nearer the truth by "
            f"{words(-entry.worse_m.mean)} \u00b1 {words(entry.worse_m.error, 2)} m on the same flights",
        )
        for entry in found.worse
    ]  # fmt: skip
    lines += [
        tag(
            "li",
            f"{where(outcome, entry)}: no nearer than {e.approaches[entry.approach].name}, which is above the bound",
        )
        for entry in found.missed
    ]  # fmt: skip
    text = tag("p", f"{sentence(outcome)}.")
    return joined(tag("h2", f"Is {e.reference} the best?"), text, tag("ul", *lines) if lines else "")
