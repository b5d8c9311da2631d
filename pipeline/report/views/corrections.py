"""What the adjustment took from every prior: corrections in prior sigmas, drawn and as a table.

The figures are the judgement's own; what it marks is marked here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pipeline.records import Correction, Results
from pipeline.report.blocks import figure, key, note, table
from pipeline.report.charts.plot import Panel, chart, panel
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.text.words import PLUS_MINUS, SIGMA, fixed

PLACE = "place"
NAMES = {
    "rotation_bias_x_rad": "attitude x (nods)",
    "rotation_bias_y_rad": "attitude y (pans)",
    "rotation_bias_z_rad": "attitude z (rolls)",
    "position_bias_east_m": "position east",
    "position_bias_north_m": "position north",
    "position_bias_up_m": "position up",
    "focal_scale": "focal length",
    "offset_s": "time offset",
    "frame_rate": "frame rate",
    "start_s": "start in the log",
    "readout_s": "readout",
    "place_x_px": "place across",
    "place_x_drift_px": "place across, drift",
    "place_y_px": "place down",
    "place_y_drift_px": "place down, drift",
}
UNITS = {
    "attitude": ("\u00b0", 180 / math.pi), "position": ("\u00a0m", 1.0), "focal": ("\u00a0%", 100.0),
    "offset": ("\u00a0s", 1.0), "frame-rate": ("\u00a0Hz", 1.0), "start": ("\u00a0s", 1.0),
    "readout": ("\u00a0ms", 1e3), "place": ("\u00a0px", 1.0),
}  # fmt: skip
"""Of each block as people read it, and how many of them the record's unit is."""
SHOWN, MOST_SHOWN = 4.0, 12.0
"""Prior sigmas to each side that a drawing shows at least and at most; what lies further is drawn at its edge."""


def corrections(results: Results) -> Html:
    """One drawing for each camera and a table; where tracked points sit on their targets is folded."""
    taken = results.solution.corrections
    if not taken:
        words = f"The method {results.solution.method} knows no priors, so nothing was taken from any."
        return note(words)
    main = [c for c in taken if c.block != PLACE or c.beyond]
    places = [c for c in taken if c.block == PLACE]
    cameras = list(dict.fromkeys(c.camera for c in main))
    keys = (
        key("pull", "correction, and how well it is known", "M1 6H23"),
        key("pull beyond", f"beyond 3{SIGMA}", "M1 6H23"),
        key("shade", f"1, 2, 3{SIGMA} of the prior", "M1 2H23V10H1Z"),
    )
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")
    reach = min(max([SHOWN, *(abs(c.in_sigmas) + 0.5 for c in main)]), MOST_SHOWN)
    drawings = [_pulls(camera, [c for c in main if c.camera == camera], reach) for camera in cameras]
    caption = f"In sigmas of each prior: zero is what the log, the mount or the calibration said. {_AXES}"
    return joined(
        _summary(taken), figure(*drawings, legend=legend, caption=caption), _table(main, "What was taken from priors"),
        _folded(places),
    )  # fmt: skip


_AXES = "Camera axes: x right, y down, z forward."


def _summary(taken: Sequence[Correction]) -> Html:
    """What a reader should know first."""
    far = [c for c in taken if c.beyond]
    furthest = max(taken, key=lambda c: abs(c.in_sigmas))
    most = f"{named(furthest)} of {furthest.camera}, {fixed(abs(furthest.in_sigmas), 1)}{SIGMA}"
    if not far:
        return note(f"All {len(taken)} parameters stayed within 3 sigmas of their priors; the furthest is {most}.")
    share = f"{len(far)} of {len(taken)} parameters lie"
    return note(f"{share} beyond 3 sigmas of their priors, where 3 of 1000 are to be expected; the furthest is {most}.")


def named(of: Correction) -> str:
    """A parameter as people say it; of a place, with its target."""
    inner = of.parameter.removeprefix(f"{of.camera}.")
    target, _, last = inner.rpartition(".")
    return f"{NAMES.get(last, last)} on {target}" if target else NAMES.get(last, last)


def _pulls(camera: str, rows: list[Correction], reach: float) -> Html:
    n = len(rows)
    p = panel((-reach, reach), (-n + 0.5, 0.5), height=52 + 21 * n, left=128)
    marks = [_shade(p, k) for k in (3, 2, 1)]
    marks.append(tag("path", d=f"M{p.x.at(0):.1f} 0V{p.inner[1]:.1f}", class_="level"))
    marks += [_pull(p, row, -float(i), reach) for i, row in enumerate(rows)]
    ticks = [(-float(i), named(row)) for i, row in enumerate(rows)]
    said = "; ".join(f"{named(row)} {fixed(row.in_sigmas, 2)}" for row in rows)
    return chart(
        p, [tag("g", *marks, class_="c-ink")], label=f"Corrections of {camera} in prior sigmas: {said}", title=camera,
        x_label="prior sigmas", y_ticks=ticks, x_count=8,
    )  # fmt: skip


def _shade(p: Panel, sigmas: float) -> Html:
    low, high = p.x.at(-sigmas), p.x.at(sigmas)
    return tag("rect", x=low, width=high - low, y=0, height=p.inner[1], class_="shade")


def _pull(p: Panel, row: Correction, level: float, reach: float) -> Html:
    """A dot at the correction with a line as long as one sigma of what is left, both in prior sigmas."""
    if not math.isfinite(row.in_sigmas):
        return Html("")
    half = row.sigma / row.prior_sigma if row.prior_sigma > 0 and math.isfinite(row.sigma) else 0.0
    at = min(max(row.in_sigmas, -reach), reach)
    y = p.y.at(level)
    low, high = p.x.at(max(at - half, -reach)), p.x.at(min(at + half, reach))
    return tag(
        "g",
        tag("path", d=f"M{low:.1f} {y:.1f}H{high:.1f}", class_="whisker"),
        tag("circle", cx=p.x.at(at), cy=y, r=4.0, class_="blob"),
        class_="pull beyond" if row.beyond else "pull",
    )


def _table(rows: Sequence[Correction], caption: str) -> Html:
    head = ("camera", "parameter", "correction", f"prior 1{SIGMA}", f"left 1{SIGMA}", f"in prior {SIGMA}")
    return table(head, [_row(r) for r in rows], caption=caption, words=2)


def _row(of: Correction) -> list[str]:
    unit, many = UNITS[of.block]
    value, prior, left = of.value * many, of.prior_sigma * many, of.sigma * many
    least = min(prior, left)
    places = max(0, 1 - math.floor(math.log10(least))) if 1e-12 < least < math.inf else 4
    return [
        of.camera,
        named(of),
        f"{fixed(value, places)}{unit}",
        f"{PLUS_MINUS}\u2009{fixed(prior, places)}{unit}",
        f"{PLUS_MINUS}\u2009{fixed(left, places)}{unit}",
        _in_sigmas(of),
    ]


def _in_sigmas(of: Correction) -> Html:
    words = fixed(of.in_sigmas, 2)
    if not of.beyond:
        return Html(words)
    mark = tag("span", "!", class_="mark", aria_hidden="true")
    spoken = tag("span", "beyond 3 sigmas: ", class_="sr")
    return tag("span", spoken, mark, "\u00a0", tag("strong", words), class_="care marked")


def _folded(places: Sequence[Correction]) -> Html:
    if not places:
        return Html("")
    heading = "Where tracked points sit on their targets"
    return tag("details", tag("summary", heading), _table(places, "Shifts of tracked points"))
