"""What changes along the flight: height, speed, and the uncertainty of each target."""

from __future__ import annotations

import numpy as np

from calibration.arrays import Floats
from pipeline.records import Motion, Results, Trajectory
from pipeline.report import cast
from pipeline.report.axes import span
from pipeline.report.blocks import figure, key, target_legend
from pipeline.report.markup import Html, tag
from pipeline.report.plot import Panel, band, chart, line, panel
from pipeline.report.spells import times_seen
from pipeline.report.words import SIGMA, fixed

SAMPLES = 700
TIME = "common time, s"


def height_and_speed(results: Results) -> Html:
    """Height with its one-sigma band, and speed over the ground, of every target."""
    tracks = [cast.thin_trajectory(t, SAMPLES) for t in results.trajectories if len(t.time_s)]
    keys = [key("band", f"1{SIGMA}", "M1 2H23V10H1Z")]
    if results.truth is not None:
        keys.append(key("truth", "truth"))
    legend = target_legend(results, *keys, only=[t.target for t in tracks])
    caption = "Up is counted from the origin" + (
        "." if results.origin is None else f", {fixed(results.origin.height_m, 1)} m above the WGS84 ellipsoid."
    )
    caption += cast.thinning_words(results, SAMPLES)
    return figure(_height(results, tracks), _speed(results, tracks), legend=legend, caption=caption)


def _height(results: Results, tracks: list[Trajectory]) -> Html:
    sigma = [np.sqrt(np.maximum(t.covariance[:, 2, 2], 0)) for t in tracks]
    up = [t.position_enu_m[:, 2] for t in tracks]
    known = [np.nan_to_num(s) for s in sigma]
    p = panel(
        cast.time_span(results),
        span(
            *(u - s for u, s in zip(up, known, strict=True)),
            *(u + s for u, s in zip(up, known, strict=True)),
            least=1.0,
        ),
    )
    marks = []
    for t, s in zip(tracks, sigma, strict=True):
        z = t.position_enu_m[:, 2]
        inner = [
            band(p, t.time_s, z - s, z + s, "band faint"),
            line(p, t.time_s, z),
            _true_height(results, p, t.target),
        ]
        marks.append(tag("g", *inner, class_=cast.tone(results, t.target)))
    return chart(
        p, marks, label="Height of every target over time", title="Height", x_label=TIME, y_label="up, m", time=True
    )


def _true_height(results: Results, p: Panel, target: str) -> Html:
    known = cast.true_trajectory(results, target)
    if known is None:
        return Html("")
    at = cast.thinned(len(known.time_s), SAMPLES)
    return line(p, known.time_s[at], known.position_enu_m[at, 2], "truth")


def _speed(results: Results, tracks: list[Trajectory]) -> Html:
    speeds = [np.linalg.norm(t.velocity_mps, axis=1) for t in tracks]
    _, top = span(np.zeros(1), *speeds, least=1.0)
    p = panel(cast.time_span(results), (0.0, top))
    marks = [
        tag("g", line(p, t.time_s, v), class_=cast.tone(results, t.target)) for t, v in zip(tracks, speeds, strict=True)
    ]
    return chart(
        p, marks, label="Speed of every target over time", title="Speed", x_label=TIME, y_label="speed, m/s", time=True
    )


def uncertainty_figure(results: Results) -> Html:
    """One panel for each target: sigma of the horizontal and vertical position, plain and cluster-robust."""
    tracks = [cast.thin_trajectory(t, SAMPLES) for t in results.trajectories if len(t.time_s)]
    robust = {m.target: m for m in results.solution.motions_robust}
    panels = [_sigma_panel(results, t, robust.get(t.target)) for t in tracks]
    keys = [key("line", f"horizontal (root of east{chr(0xB2)} + north{chr(0xB2)})"), key("line up", "up")]
    if robust:
        keys.append(key("line robust", "the same, robust (sandwich)"))
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")
    words = ["One sigma of the position."]
    if robust:
        words.append("The robust version trusts the scatter of the residuals instead of the sigmas given.")
    words.append("The strips along the time axis show when each camera saw the target, the first camera lowest.")
    caption = " ".join(words) + cast.thinning_words(results, SAMPLES)
    return figure(*panels, legend=legend, caption=caption)


def _sigma_panel(results: Results, track: Trajectory, robust: Motion | None) -> Html:
    plain = _two_sigmas(track.covariance)
    other = _two_sigmas(robust.position_covariance(track.time_s)) if robust is not None else None
    both = plain if other is None else np.concatenate([plain, other])
    finite = both[np.isfinite(both) & (both > 0)]
    wide = bool(len(finite)) and finite.max() > 12 * np.median(finite)
    low, high = (finite.min() * 0.8, finite.max() * 1.3) if wide else (0.0, span(np.zeros(1), finite, least=1e-3)[1])
    p = panel(cast.time_span(results), (float(low), float(high)), log_y=wide)
    marks = [line(p, track.time_s, plain[:, 0]), line(p, track.time_s, plain[:, 1], "line up")]
    if other is not None:
        marks += [
            line(p, track.time_s, other[:, 0], "line robust"),
            line(p, track.time_s, other[:, 1], "line up robust"),
        ]
    return chart(
        p,
        [tag("g", *marks, class_=cast.tone(results, track.target)), *_seen_strips(results, p, track.target)],
        label=f"Position sigma of {track.target} over time",
        title=track.target,
        x_label=TIME,
        y_label="sigma, m (log)" if wide else "sigma, m",
        time=True,
    )


def _two_sigmas(covariance: Floats) -> Floats:
    """(n, 2): horizontal and vertical one-sigma of positions with covariance (n, 3, 3)."""
    flat = np.sqrt(np.maximum(covariance[:, 0, 0] + covariance[:, 1, 1], 0))
    return np.stack([flat, np.sqrt(np.maximum(covariance[:, 2, 2], 0))], axis=1)


def _seen_strips(results: Results, p: Panel, target: str) -> list[Html]:
    _, h = p.inner
    out = []
    for i, camera in enumerate(cast.cameras(results)[:6]):
        d = "".join(
            f"M{p.x.at(a):.1f} {h - 3 - 4 * i:.1f}H{max(p.x.at(b), p.x.at(a) + 0.5):.1f}"
            for a, b in times_seen(results, camera, target)
        )
        out.append(tag("path", d=d, class_="strip"))
    return out
