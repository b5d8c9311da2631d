"""What the adjustment changed about the cameras: what it took from each prior, and corrections frame by frame."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import PoseTrack, Results
from pipeline.report.blocks import figure, key
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import chart, line, panel
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.views.corrections import corrections

TURNS = ("about x (nods)", "about y (pans)", "about z (rolls)")
AXIS_TONES = ("c1", "c2 robust", "c0 up")
SAMPLES = 600


def orientation(results: Results) -> Html:
    """What the adjustment took from each prior, drawn and as a table, then the corrections over time if they vary."""
    return joined(corrections(results), _over_time(results))


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
    return np.asarray(common[at], np.int64), np.degrees(rotation.turn(after, before))


def _turn_panel(results: Results, camera: str, frames: Ints, turn_deg: Floats) -> Html:
    time = participants.frame_times(results, camera, frames)
    p = panel(span(time, pad=0), span(turn_deg, np.zeros(1), least=0.01))
    marks = [line(p, time, turn_deg[:, k], f"line {AXIS_TONES[k]}") for k in range(3)]
    return chart(
        p, marks, label=f"Attitude correction of {camera} over time", title=camera,
        x_label="common time, s", y_label="correction, degrees", time=True,
    )  # fmt: skip
