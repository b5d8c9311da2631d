"""One flight drawn: the true trajectory and every approach's, from above and from the side (paper Fig. 9 and 11)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Approach, Path3D
from pipeline.experiments.flying.paths import FlownPath
from pipeline.experiments.pages.curves import tone
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import chart, line, panel
from pipeline.report.text.markup import Html, tag


def path_figure(drawing: Path3D, path: FlownPath, approaches: Sequence[Approach]) -> Html:
    """From above and from the south, equal scales."""
    views = (("from above", 0, 1, "east, m", "north, m"), ("from the south", 0, 2, "east, m", "up, m"))
    lines = [("truth", "line truth", path.true_m)]
    lines += [(approaches[i].name, f"line {tone(i, approaches[i].ours)}", found_m) for i, found_m in path.found_m]
    drawn = [_view(drawing, lines, *view) for view in views]
    legend = tag("ul", *(_key(name, class_) for name, class_, _ in lines), class_="legend")
    return tag("figure", legend, tag("div", *drawn, class_="panels"), tag("figcaption", drawing.caption))


def _view(
    drawing: Path3D, lines: Sequence[tuple[str, str, Floats]], title: str, i: int, j: int, x_label: str, y_label: str
) -> Html:
    all_m = np.concatenate([path_m for _, _, path_m in lines])
    p = panel(span(all_m[:, i]), span(all_m[:, j]), equal=True)
    marks = [line(p, path_m[:, i], path_m[:, j], class_=class_) for _, class_, path_m in lines]
    return chart(p, marks, label=f"{drawing.caption}, {title}", x_label=x_label, y_label=y_label, title=title)


def _key(name: str, class_: str) -> Html:
    sample = tag("svg", tag("path", d="M1 6H23", class_=class_), width=24, height=12, aria_hidden="true")
    return tag("li", sample, name)
