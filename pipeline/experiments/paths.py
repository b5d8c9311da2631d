"""One flight drawn: the true trajectory and every approach's, from above and from the side (paper Fig. 9 and 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Experiment, Path3D
from pipeline.experiments.flights import answer, flown
from pipeline.experiments.tones import tone
from pipeline.report.axes import span
from pipeline.report.markup import Html, tag
from pipeline.report.plot import chart, line, panel

SAMPLES = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownPath:
    """True path (n, 3) over the first camera's time, and found paths by approach with their tones."""

    cell: int
    true_m: Floats
    found_m: tuple[tuple[str, str, Floats], ...]


def fly_path(experiment: Experiment, cell: int, seed: int) -> FlownPath:
    """Run 0 of a cell, solved by every approach."""
    flight = flown(experiment, cell, 0, seed)
    scene = flight.scene
    first = scene.cameras[0].frame_time_s(np.array([0, scene.cameras[0].frames - 1]))
    time = np.linspace(first[0], first[1], SAMPLES)
    found = []
    for i, approach in enumerate(experiment.approaches):
        solved, _ = answer(experiment, cell, approach, flight)
        if solved is not None:
            found.append((approach.name, tone(i, approach.ours), solved.motion.position_enu_m(time)))
    true_m = scene.targets[experiment.target].motion.position_enu_m(time)
    return FlownPath(cell=cell, true_m=true_m, found_m=tuple(found))


def path_figure(drawing: Path3D, path: FlownPath) -> Html:
    """From above and from the south, equal scales."""
    views = (("from above", 0, 1, "east, m", "north, m"), ("from the south", 0, 2, "east, m", "up, m"))
    drawn = [_view(drawing, path, *view) for view in views]
    keys = [("truth", "line truth"), *((name, f"line {t}") for name, t, _ in path.found_m)]
    legend = tag("ul", *(_key(name, class_) for name, class_ in keys), class_="legend")
    return tag("figure", legend, tag("div", *drawn, class_="panels"), tag("figcaption", drawing.caption))


def _view(drawing: Path3D, path: FlownPath, title: str, i: int, j: int, x_label: str, y_label: str) -> Html:
    all_m = np.concatenate([path.true_m, *(m for _, _, m in path.found_m)])
    p = panel(span(all_m[:, i]), span(all_m[:, j]), equal=True)
    marks = [line(p, path.true_m[:, i], path.true_m[:, j], class_="line truth")]
    marks += [line(p, m[:, i], m[:, j], class_=f"line {t}") for _, t, m in path.found_m]
    return chart(p, marks, label=f"{drawing.caption}, {title}", x_label=x_label, y_label=y_label, title=title)


def _key(name: str, class_: str) -> Html:
    sample = tag("svg", tag("path", d="M1 6H23", class_=class_), width=24, height=12, aria_hidden="true")
    return tag("li", sample, name)
