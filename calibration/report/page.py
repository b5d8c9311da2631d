"""A calibration for people: one self-contained page."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from calibration.judgement.result import CalibratedView, Calibration

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
FISHEYE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
ARROW = 40
STRONG = 0.9
COLOURS = {"good": "#1a7f37", "usable": "#9a6700", "poor": "#cf222e"}
STYLE = """
body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:64rem;padding:0 1rem;color:#1f2328}
h1{font-size:1.6rem;margin:0}h2{font-size:1.15rem;margin:2rem 0 .5rem}.verdict{font-weight:700}
table{border-collapse:collapse;width:100%}th,td{padding:.25rem .6rem;text-align:right;border-bottom:1px solid #d8dee4}
th:first-child,td:first-child{text-align:left}svg{width:100%;height:auto;background:#f6f8fa;border:1px solid #d8dee4}
.note{color:#59636e;font-size:.9rem}.bar{fill:#0969da}.held{fill:none;stroke:#1f2328}li{margin:.3rem 0}
.photos{display:grid;grid-template-columns:repeat(auto-fill,minmax(16rem,1fr));gap:1rem}
figure{margin:0}figure img{width:100%;height:auto}figcaption{font-size:.8rem;color:#59636e;overflow-wrap:anywhere}
"""


def calibration_page(
    found: Calibration, *, title: str = "Camera calibration", pictures: Mapping[str, bytes] | None = None
) -> str:
    """One HTML page without outside parts: verdict, intrinsics, residuals over the image, a row per view.

    `pictures` are JPEGs by the names of views (`pictures`).
    """
    width, height = found.camera.image_size
    known = found.direction_sigma
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<meta name="viewport" content="width=device-width,initial-scale=1"><style>{STYLE}</style></head><body>
<h1>{escape(title)}</h1>
<p>{width} x {height}, {escape(found.lens)}, {len(found.views)} views of a {escape(found.board.name)} board.
Verdict: <span class="verdict" style="color:{COLOURS[found.verdict]}">{found.verdict}</span>.</p>
<p>Reprojection error {found.rms_px:.3f} px RMS; views predicted from all the others {found.held_out_px:.3f} px; a
direction is known to {known.typical_px:.2f} px typically, {known.worst_px:.2f} px at worst (one sigma) where boards
were seen{_elsewhere(found)}.</p>
{_list("What is wrong", found.warnings)}{_list("What to photograph next", found.advice)}
<h2>Intrinsics</h2>{_intrinsics(found)}
{_correlated(found)}
<h2>Where the corners were</h2>
<p class="note">Residuals drawn {ARROW} times as long. Everything outside of the dots is extrapolated.</p>
{_image(found)}
<h2>Views</h2>
<p class="note">Bars: error of each view; outlined: the same when the view is predicted from all others.</p>
{_bars(found.views)}{_views(found)}
{_pictures(found, pictures or {})}
</body></html>
"""


def _names(found: Calibration) -> Sequence[str]:
    every = FISHEYE_NAMES if found.camera.model == "fisheye" else NAMES
    return every[: 4 + len(found.camera.distortion)]


def _elsewhere(found: Calibration) -> str:
    beyond = found.direction_sigma.beyond_px
    return "" if beyond != beyond else f", up to {beyond:.2f} px elsewhere" if beyond < 100 else ", nowhere else"


def _list(heading: str, words: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(w)}</li>" for w in words)
    return f"<h2>{heading}</h2><ul>{items}</ul>" if words else ""


def _intrinsics(found: Calibration) -> str:
    values = [*found.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], *found.camera.distortion]
    rows = "".join(
        f"<tr><td>{name}</td><td>{value:.6g}</td><td>{f'{sigma:.2g}' if sigma > 0 else 'held'}</td></tr>"
        for name, value, sigma in zip(_names(found), values, found.sigma, strict=True)
    )
    return f"<table><tr><th></th><th>value</th><th>one sigma</th></tr>{rows}</table>"


def _correlated(found: Calibration) -> str:
    """Pairs of parameters that can hardly be told apart."""
    names, rho = _names(found), found.correlation
    pairs = [
        f"{names[i]} and {names[j]} ({rho[i, j]:+.2f})"
        for i in range(len(names))
        for j in range(i)
        if abs(rho[i, j]) > STRONG
    ]
    return f'<p class="note">Known together better than apart (correlation): {", ".join(pairs)}.</p>' if pairs else ""


def _pictures(found: Calibration, pictures: Mapping[str, bytes]) -> str:
    """The photos with their corners, those that were not used last."""
    words = {v.name: f"{v.rms_px:.3f} px" for v in found.views} | {r.name: r.reason for r in found.rejected}
    figures = "".join(
        f'<figure><img alt="{escape(name)}" src="data:image/jpeg;base64,{b64encode(pictures[name]).decode()}">'
        f"<figcaption>{escape(name)}: {escape(said)}</figcaption></figure>"
        for name, said in words.items()
        if name in pictures
    )
    note = f'<p class="note">Corners found, and residuals drawn {ARROW} times as long.</p>'
    return f'<h2>Photos</h2>{note}<div class="photos">{figures}</div>' if figures else ""


def _image(found: Calibration) -> str:
    width, height = found.camera.image_size
    dot = width / 500
    marks = []
    for view in found.views:
        for (x, y), (dx, dy) in zip(view.corners, view.residual_px, strict=True):
            marks.append(
                f'<path d="M{x:.1f} {y:.1f}l{ARROW * dx:.1f} {ARROW * dy:.1f}"/>'
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{dot:.1f}"/>'
            )
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="corners and residuals over the image">'
        f'<g fill="#0969da" stroke="#cf222e" stroke-width="{dot / 2:.2f}">{"".join(marks)}</g></svg>'
    )


def _bars(views: Sequence[CalibratedView]) -> str:
    top = max(max(v.rms_px, v.held_out_px) for v in views) or 1.0
    step = 1000 / len(views)

    def bar(i: int, kind: str, error: float, name: str) -> str:
        tall = 140 * error / top
        return (
            f'<rect class="{kind}" x="{i * step + 2:.1f}" y="{150 - tall:.1f}" width="{max(step - 4, 1):.1f}" '
            f'height="{tall:.1f}"><title>{escape(name)}: {error:.3f} px</title></rect>'
        )

    bars = "".join(bar(i, "bar", v.rms_px, v.name) + bar(i, "held", v.held_out_px, v.name) for i, v in enumerate(views))
    return f'<svg viewBox="0 0 1000 160" role="img" aria-label="error of each view">{bars}</svg>'


def _views(found: Calibration) -> str:
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td>{v.rms_px:.3f}</td><td>{v.held_out_px:.3f}</td><td>{np.abs(v.residual_px).max():.2f}</td>"
        f"<td>{v.tilt_deg:.0f}</td><td>{v.distance_m:.2f}</td><td>{v.blur_px[1]:.1f}</td></tr>"
        for v in found.views
    )
    out = "".join(f'<tr><td>{escape(r.name)}</td><td colspan="6">{escape(r.reason)}</td></tr>' for r in found.rejected)
    heads = ("view", "RMS px", "held out px", "largest px", "tilt, degrees", "distance m", "blur px")
    return f"<table><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr>{rows}{out}</table>"
