"""Who saw what when: one row for each camera and target. And the table of targets."""

from __future__ import annotations

import numpy as np

from pipeline.records import LOST, REACQUIRED, ImageTrack, Motion, Results, Trajectory
from pipeline.report.blocks import figure, key, note, swatch, table
from pipeline.report.charts.axes import round_ticks
from pipeline.report.data import participants
from pipeline.report.data.visibility import losses, state_intervals
from pipeline.report.text.markup import Html, joined, number, tag
from pipeline.report.text.words import UNKNOWN, fixed, rounded, utc, whole
from pipeline.report.views.summary import typical_sigma_m

UNITS = 1000


def timeline_figure(results: Results) -> Html:
    """Bars of tracked, lost and reacquired time in common time."""
    tracks = [t for t in results.tracks if len(t.frame)]
    if not tracks:
        return note("No image tracks are recorded.")
    times = [participants.frame_times(results, t.camera, t.frame[[0, -1]]) for t in tracks]
    low, high = float(np.nanmin(times)), float(np.nanmax(times))
    high = high if high > low else low + 1
    rows: list[Html] = []
    for camera in participants.cameras(results):
        own = [t for t in tracks if t.camera == camera]
        if own:
            rows.append(tag("p", camera, class_="camera-row"))
            rows += [_row(results, t, low, high) for t in own]
    keys = (
        key("spell", "tracked", "M1 6H23"),
        key("spell again", "tracked again after a loss"),
        key("spell lost", "lost"),
    )
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")
    board = tag(
        "div", *rows, _axis(low, high), class_="timeline", role="group", aria_label="When each camera saw each target"
    )
    return figure(board, legend=legend, wide=True, caption="Common time in seconds.")


def _row(results: Results, track: ImageTrack, low: float, high: float) -> Html:
    bars = []
    for interval in state_intervals(results, track):
        a, b = ((t - low) / (high - low) * UNITS for t in (interval.start_s, interval.end_s))
        kind = {LOST: "spell lost", REACQUIRED: "spell again"}.get(interval.state, "spell")
        bars.append(tag("path", d=f"M{number(a, 1)} 5H{number(max(b, a + 1), 1)}", class_=kind))
    seen = int(np.count_nonzero(track.seen))
    words = f"{track.target} in {track.camera}: {seen} fixes in {len(track.frame)} frames"
    drawing = tag(
        "svg", tag("title", words), *bars, viewBox=f"0 0 {UNITS} 10", preserveAspectRatio="none", role="img",
        class_=participants.tone(results, track.target),
    )  # fmt: skip
    return tag(
        "div", tag("span", track.target, class_="who"), drawing, tag("span", whole(seen), class_="n"), class_="row"
    )


def _axis(low: float, high: float) -> Html:
    places = [((v - low) / (high - low), words) for v, words in round_ticks(low, high, 6)]
    labels = [tag("span", words, style=f"left:{100 * at:.2f}%") for at, words in places]
    return tag(
        "div",
        tag("span", "", class_="who"),
        tag("div", *labels, class_="ticks"),
        tag("span", "fixes", class_="n"),
        class_="row axis",
    )


def targets_table(results: Results) -> Html:
    """One row for each target: how it was modelled, seen, how sure it is and how fast it went."""
    head = (
        "target",
        "motion",
        "seen, s",
        "fixes",
        "losses",
        "median sigma, m",
        "distance, m",
        "median speed",
        "fastest",
    )
    sigmas = typical_sigma_m(results)
    rows = [_target_row(results, t, sigmas) for t in results.trajectories if len(t.time_s)]
    out = table(head, rows, caption="Motion, sightings and speed of each target", words=2)
    if results.utc_s is not None:
        out = joined(out, note(f"Common time 0 is {utc(results.utc_s)}."))
    return out


def _target_row(results: Results, track: Trajectory, sigmas: dict[str, float]) -> list[str]:
    known = participants.well_known(results, track)
    speed = np.linalg.norm(track.velocity_mps, axis=1)[known]
    steps = np.linalg.norm(np.diff(track.position_enu_m, axis=0), axis=1)[known[1:]]
    fixes = len(participants.rows_of(results.solution.sightings, target=track.target))
    motion = next((m for m in results.solution.motions if m.target == track.target), None)
    return [
        swatch(results, track.target),
        _motion_words(motion),
        f"{fixed(float(track.time_s[0]), 1)} \u2013 {fixed(float(track.time_s[-1]), 1)}",
        whole(fixes),
        whole(losses(results, track.target)),
        rounded(sigmas.get(track.target, float("nan"))),
        rounded(float(np.nansum(steps)), 3),
        _speed_words(float(np.nanmedian(speed))) if np.isfinite(speed).any() else UNKNOWN,
        _speed_words(float(np.nanmax(speed))) if np.isfinite(speed).any() else UNKNOWN,
    ]


def _motion_words(motion: Motion | None) -> str:
    if motion is None:
        return "point by point"
    if motion.kind == "polynomial":
        return f"polynomial of order {motion.degree}"
    return f"spline of {len(motion.coefficients)} coefficients"


def _speed_words(speed_mps: float) -> str:
    return f"{fixed(speed_mps, 1)} m/s ({fixed(3.6 * speed_mps, 0)} km/h)"
