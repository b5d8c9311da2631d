"""What the adjustment changed about the cameras: constant biases with their sigma, and corrections frame by frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import Bias, PoseTrack, Results
from pipeline.report.blocks import figure, key, note, table
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import Panel, chart, line, panel
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.text.words import SIGMA, plus_minus

TURNS = ("about x (nods)", "about y (pans)", "about z (rolls)")
AXIS_TONES = ("c1", "c2 robust", "c0 up")
SAMPLES = 600


def orientation(results: Results) -> Html:
    """Biases as whiskers and as a table, then the corrections over time where they vary."""
    biases = results.solution.biases
    if not biases:
        return joined(note("No constant error of any camera was estimated."), _over_time(results))
    axes = "Camera axes: x right, y down, z forward. Whiskers are two sigma long on each side."
    drawings = [
        _whiskers(biases, _turn_deg, "Rotation", "degrees", "xyz"),
        _whiskers(biases, _shift_m, "Position", "m", "ENU"),
    ]
    return joined(figure(*drawings, caption=axes), _bias_table(biases), _over_time(results))


def _turn_deg(bias: Bias) -> tuple[Floats, Floats]:
    return np.degrees(bias.rotation_rad), np.degrees(bias.rotation_sigma_rad)


def _shift_m(bias: Bias) -> tuple[Floats, Floats]:
    return bias.position_m, bias.position_sigma_m


def _whiskers(
    biases: tuple[Bias, ...], read: Callable[[Bias], tuple[Floats, Floats]], title: str, unit: str, axes: str
) -> Html:
    values = [read(b) for b in biases]
    reach = span(
        np.zeros(1),
        *(v - 2 * np.nan_to_num(s) for v, s in values),
        *(v + 2 * np.nan_to_num(s) for v, s in values),
        least=1e-3,
    )
    rows = len(biases) * 4 - 1
    p = panel(reach, (-rows + 0.5 - 1, 0.5), height=60 + 17 * (rows + 1), left=96)
    marks, ticks = [tag("path", d=f"M{p.x.at(0):.1f} 0V{p.inner[1]:.1f}", class_="level")], []
    for i, (bias, (value, sigma)) in enumerate(zip(biases, values, strict=True)):
        for k in range(3):
            at = -(4.0 * i + k)
            ticks.append((at, f"{bias.camera} {axes[k]}"))
            if np.isfinite(value[k]):
                marks.append(_whisker(p, float(value[k]), 2 * float(np.nan_to_num(sigma[k])), at))
    label = f"{title} correction of every camera with two-sigma whiskers"
    return chart(
        p, [tag("g", *marks, class_="c-ink")], label=label, title=f"{title} correction", x_label=unit, y_ticks=ticks
    )


def _whisker(p: Panel, value: float, half: float, row: float) -> Html:
    low, high, y = p.x.at(value - half), p.x.at(value + half), p.y.at(row)
    return tag(
        "g",
        tag("path", d=f"M{low:.1f} {y:.1f}H{high:.1f}", class_="whisker"),
        tag("circle", cx=p.x.at(value), cy=y, r=3.5, class_="blob"),
    )


def _bias_table(biases: tuple[Bias, ...]) -> Html:
    head = ("camera", *(f"{t}, deg" for t in TURNS), "east, m", "north, m", "up, m", "focal scale")
    return table(
        head,
        [_bias_row(b) for b in biases],
        caption=f"Constant errors found (true minus measured, {chr(0xB1)} {SIGMA})",
    )


def _bias_row(bias: Bias) -> list[str]:
    turns = [_held_or(v, s) for v, s in zip(*_turn_deg(bias), strict=True)]
    shifts = [_held_or(v, s) for v, s in zip(*_shift_m(bias), strict=True)]
    focal = plus_minus(bias.focal_scale, bias.focal_scale_sigma) if bias.focal_scale_sigma > 0 else "held"
    return [bias.camera, *turns, *shifts, focal]


def _held_or(value: float, sigma: float) -> str:
    return "held" if sigma == 0 and value == 0 else plus_minus(float(value), float(sigma))


def _over_time(results: Results) -> Html:
    """Rotation from measured to refined attitude of each camera, frame by frame, where it is not constant."""
    refined = {p.camera: p for p in results.solution.poses}
    panels = []
    for measured in results.measured_poses:
        if measured.camera in refined:
            frames, turn = _turns_deg(measured, refined[measured.camera])
            if len(frames) > 1 and np.nanmax(np.ptp(turn, axis=0)) > 1e-4:
                panels.append(_turn_panel(results, measured.camera, frames, turn))
    if not panels:
        return Html("")
    keys = (tag("li", key(f"line {tone}", words)) for tone, words in zip(AXIS_TONES, TURNS, strict=True))
    legend = tag("ul", *keys, class_="legend")
    return joined(tag("h3", "Attitude correction frame by frame"), figure(*panels, legend=legend))


def _turns_deg(measured: PoseTrack, refined: PoseTrack) -> tuple[Ints, Floats]:
    common, a, b = np.intersect1d(measured.frame, refined.frame, return_indices=True)
    at = participants.thinned(len(common), SAMPLES)
    before, after = measured.enu_from_cam[a[at]], refined.enu_from_cam[b[at]]
    turn = rotation.log(rotation.multiply(rotation.conjugate(after), before))
    return np.asarray(common[at], np.int64), np.degrees(turn)


def _turn_panel(results: Results, camera: str, frames: Ints, turn_deg: Floats) -> Html:
    time = participants.frame_times(results, camera, frames)
    p = panel(span(time, pad=0), span(turn_deg, np.zeros(1), least=0.01))
    marks = [line(p, time, turn_deg[:, k], f"line {AXIS_TONES[k]}") for k in range(3)]
    return chart(
        p, marks, label=f"Attitude correction of {camera} over time", title=camera,
        x_label="common time, s", y_label="correction, degrees", time=True,
    )  # fmt: skip
