"""What changes along the flight: height, speed, and the uncertainty of each target."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Motion, Results, Trajectory
from pipeline.report.blocks import figure, key, note, target_legend
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import Panel, band, chart, known_line, line, panel
from pipeline.report.data import participants
from pipeline.report.data.visibility import times_seen
from pipeline.report.text.markup import Html, tag
from pipeline.report.text.words import SIGMA, fixed

SAMPLES, STRIPS = 700, 6
TIME = "common time, s"


def height_and_speed(results: Results) -> Html:
    """Height with its one-sigma band, and speed over the ground, of every target."""
    tracks = [participants.thin_trajectory(t, SAMPLES) for t in results.trajectories if len(t.time_s)]
    keys = [key("band", f"1{SIGMA}", "M1 2H23V10H1Z")]
    if results.truth is not None:
        keys.append(key("truth", "truth"))
    legend = target_legend(results, *keys, only=[t.target for t in tracks])
    caption = "Up is counted from the origin" + (
        "." if results.origin is None else f", {fixed(results.origin.height_m, 1)} m above the WGS84 ellipsoid."
    )
    caption += participants.thinning_words(results, SAMPLES)
    return figure(_height(results, tracks), _speed(results, tracks), legend=legend, caption=caption)


def _height(results: Results, tracks: list[Trajectory]) -> Html:
    sigma = [np.sqrt(np.maximum(t.covariance[:, 2, 2], 0)) for t in tracks]
    known = [participants.well_known(results, t) for t in tracks]
    edges = [
        (t.position_enu_m[:, 2] + sign * np.nan_to_num(s))[k]
        for t, s, k in zip(tracks, sigma, known, strict=True)
        for sign in (-1, 1)
    ]
    p = panel(participants.time_span(results), span(*edges, least=1.0))
    marks = []
    for t, s, k in zip(tracks, sigma, known, strict=True):
        z = t.position_enu_m[:, 2]
        area = band(p, t.time_s, z - s, z + s, "band faint")
        inner = [area, known_line(p, t.time_s, z, k), _true_height(results, p, t.target)]
        marks.append(tag("g", *inner, class_=participants.tone(results, t.target)))
    label = "Height of every target over time"
    return chart(p, marks, label=label, title="Height", x_label=TIME, y_label="up, m", time=True)


def _true_height(results: Results, p: Panel, target: str) -> Html:
    known = participants.true_trajectory(results, target)
    if known is None:
        return Html("")
    at = participants.thinned(len(known.time_s), SAMPLES)
    return line(p, known.time_s[at], known.position_enu_m[at, 2], "truth")


def _speed(results: Results, tracks: list[Trajectory]) -> Html:
    speeds = [np.linalg.norm(t.velocity_mps, axis=1) for t in tracks]
    known = [participants.well_known(results, t) for t in tracks]
    _, top = span(np.zeros(1), *(v[k] for v, k in zip(speeds, known, strict=True)), least=1.0)
    p = panel(participants.time_span(results), (0.0, top))
    marks = [
        tag("g", known_line(p, t.time_s, v, k), class_=participants.tone(results, t.target))
        for t, v, k in zip(tracks, speeds, known, strict=True)
    ]
    label = "Speed of every target over time"
    return chart(p, marks, label=label, title="Speed", x_label=TIME, y_label="speed, m/s", time=True)


def uncertainty_figure(results: Results) -> Html:
    """One panel for each target: sigma of the horizontal and vertical position, plain and cluster-robust."""
    tracks = [participants.thin_trajectory(t, SAMPLES) for t in results.trajectories if len(t.time_s)]
    if not any(np.isfinite(_plain_covariance(results, t)).any() for t in tracks):
        return note("The uncertainty of the positions is unknown: the solver gave no covariance.")
    robust = {m.target: m for m in results.solution.motions_robust}
    panels = [_sigma_panel(results, t, robust.get(t.target)) for t in tracks]
    keys = [key("line", f"horizontal (root of east{chr(0xB2)} + north{chr(0xB2)})"), key("line up", "up")]
    if robust:
        keys.append(key("line robust", "the same, robust (sandwich)"))
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")
    words = ["One sigma of the position."]
    if robust:
        words.append("The robust version trusts the scatter of the residuals instead of the sigmas given.")
    words.append("The strips above show when each camera saw the target, the first camera on top.")
    caption = " ".join(words) + participants.thinning_words(results, SAMPLES)
    return figure(*panels, legend=legend, caption=caption)


def _sigma_panel(results: Results, track: Trajectory, robust: Motion | None) -> Html:
    plain = _two_sigmas(_plain_covariance(results, track))
    other = _two_sigmas(robust.position_covariance(track.time_s)) if robust is not None else None
    both = plain if other is None else np.concatenate([plain, other])
    finite = both[np.isfinite(both) & (both > 0)]
    wide = bool(len(finite)) and finite.max() > 12 * np.median(finite)
    low, high = (finite.min() * 0.8, finite.max() * 1.3) if wide else (0.0, span(np.zeros(1), finite, least=1e-3)[1])
    strips = min(len(participants.cameras(results)), STRIPS)
    p = panel(participants.time_span(results), (float(low), float(high)), log_y=wide, top=10 + 5 * strips)
    marks = [line(p, track.time_s, plain[:, 0]), line(p, track.time_s, plain[:, 1], "line up")]
    if other is not None:
        marks += [
            line(p, track.time_s, other[:, 0], "line robust"),
            line(p, track.time_s, other[:, 1], "line up robust"),
        ]
    return chart(
        p,
        [tag("g", *marks, class_=participants.tone(results, track.target))],
        label=f"Position sigma of {track.target} over time",
        title=track.target,
        x_label=TIME,
        y_label="sigma, m (log)" if wide else "sigma, m",
        time=True,
        over=_seen_strips(results, p, track.target),
    )


def _plain_covariance(results: Results, track: Trajectory) -> Floats:
    """Of the motion where there is one: a trajectory may carry the robust version."""
    motion = next((m for m in results.solution.motions if m.target == track.target), None)
    return track.covariance if motion is None else motion.position_covariance(track.time_s)


def _two_sigmas(covariance: Floats) -> Floats:
    """(n, 2): horizontal and vertical one-sigma of positions with covariance (n, 3, 3)."""
    flat = np.sqrt(np.maximum(covariance[:, 0, 0] + covariance[:, 1, 1], 0))
    return np.stack([flat, np.sqrt(np.maximum(covariance[:, 2, 2], 0))], axis=1)


def _seen_strips(results: Results, p: Panel, target: str) -> list[Html]:
    """A row of strips above the plot for each camera."""
    out = []
    for i, camera in enumerate(participants.cameras(results)[:STRIPS]):
        y = 5.0 * (i + 1) - p.top
        seen = [(p.x.at(a), p.x.at(b)) for a, b in times_seen(results, camera, target)]
        low, high = 0.0, p.inner[0]
        pairs = [(max(a, low), min(max(b, a + 0.5), high)) for a, b in seen if b > low and a < high]
        out.append(tag("path", d="".join(f"M{a:.1f} {y:.1f}H{b:.1f}" for a, b in pairs), class_="strip"))
    return out
