"""A calibration for people: one self-contained page, light or dark as the reader's screen is."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files

import numpy as np

from calibration.foundation.palette import palette
from calibration.judgement.result import Calibration
from calibration.report.figures import ARROW, coverage_figure, error_bars, residual_figure

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
FISHEYE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
STRONG = 0.9
"""Correlation from which two parameters are said to be known together only."""
MARKS = {"good": "&#10003;", "usable": "!", "poor": "&#215;"}
MEANING = {
    "good": "Good",
    "usable": "Usable, with what is said below in mind",
    "poor": "Poor: do not use it",
}


def calibration_page(
    found: Calibration, *, title: str = "Camera calibration", pictures: Mapping[str, bytes] | None = None
) -> str:
    """One HTML page without outside parts: verdict, coverage, intrinsics, residuals over the image, a row per view.

    `pictures` are JPEGs by the names of views (`pictures`).
    """
    photos = _pictures(found, pictures or {})
    sections = [
        ("coverage", "Coverage", coverage_figure(found)),
        ("residuals", "Residuals", residual_figure(found) + error_bars(found.views)),
        ("intrinsics", "Intrinsics", _intrinsics(found) + _correlated(found)),
        ("views", "Views", _views(found)),
        *([("photos", "Photos", photos)] if photos else []),
    ]
    links = "".join(f'<li><a href="#{anchor}">{heading}</a></li>' for anchor, heading, _ in sections)
    body = "".join(
        f'<section id="{anchor}"><h2>{heading}</h2>{inside}</section>' for anchor, heading, inside in sections
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="color-scheme" content="light dark">
<title>{escape(title)}</title><style>
{_style()}</style></head><body>
{_header(found, title)}
<nav aria-label="Contents"><ul>{links}</ul></nav>
<main>{body}</main>
<footer><p>Made by runningfix calibrate. This page loads nothing and needs no network.</p></footer>
</body></html>
"""


def _style() -> str:
    return palette() + files(__package__).joinpath("page.css").read_text(encoding="utf-8")


def _header(found: Calibration, title: str) -> str:
    width, height = found.camera.image_size
    kind = "checkerboard" if found.board.marker_m is None else "ChArUco board"
    words = f"{width} x {height}, {found.lens}, {len(found.views)} views of a {found.board.name} {kind}"
    return (
        f'<header><p class="kicker">{escape(words)}</p><h1>{escape(title)}</h1>'
        f'<p class="verdict {found.verdict}"><span class="mark" aria-hidden="true">{MARKS[found.verdict]}</span>'
        f"<span>{escape(_verdict(found))}</span></p>{_tiles(found)}"
        f"{_list('What is wrong', found.warnings, found.verdict)}"
        f"{_list('What to photograph next', found.advice, 'next')}"
        "</header>"
    )


def _verdict(found: Calibration) -> str:
    return f"{MEANING[found.verdict]}." if found.verdict == "poor" else f"{MEANING[found.verdict]}, {found.part}."


def _tiles(found: Calibration) -> str:
    known, beyond = found.direction_sigma, found.direction_sigma.beyond_px
    fx, fy = found.camera.K[0, 0], found.camera.K[1, 1]
    tiles = [
        (f"{fx:.1f} x {fy:.1f}", f"px, &plusmn; {found.sigma[0]:.2g}", "focal length"),
        (f"{known.typical_px:.2f}", "px", "one sigma of a direction, where boards were seen"),
        (f"{known.worst_px:.2f}", "px", "the same, at worst there"),
    ]
    if beyond == beyond:
        tiles.append((f"{beyond:.2f}" if beyond < 100 else "&gt; 100", "px", "the same, where no board was"))
    tiles += [
        (f"{found.rms_px:.3f}", "px", "reprojection error, RMS"),
        (f"{found.held_out_px:.3f}", "px", "error of views predicted from all others"),
    ]
    return (
        '<dl class="tiles">'
        + "".join(f"<div><dt>{what}</dt><dd>{value} <small>{unit}</small></dd></div>" for value, unit, what in tiles)
        + "</dl>"
    )


def _list(heading: str, words: Sequence[str], kind: str) -> str:
    mark = "&#8594;" if kind == "next" else MARKS[kind]
    items = "".join(
        f'<li class="{kind}"><span class="mark" aria-hidden="true">{mark}</span><span>{escape(w)}</span></li>'
        for w in words
    )
    return f'<h3>{heading}</h3><ul class="remarks">{items}</ul>' if words else ""


def _names(found: Calibration) -> Sequence[str]:
    every = FISHEYE_NAMES if found.camera.model == "fisheye" else NAMES
    return every[: 4 + len(found.camera.distortion)]


def _intrinsics(found: Calibration) -> str:
    values = [*found.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], *found.camera.distortion]
    rows = "".join(
        f"<tr><th>{name}</th><td>{value:.6g}</td><td>{f'{sigma:.2g}' if sigma > 0 else 'held'}</td></tr>"
        for name, value, sigma in zip(_names(found), values, found.sigma, strict=True)
    )
    head = "<thead><tr><th></th><th>value</th><th>one sigma</th></tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{rows}</tbody></table></div>'


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
        f'<figure><img alt="{escape(name)}" loading="lazy" src="data:image/jpeg;base64,'
        f'{b64encode(pictures[name]).decode()}"><figcaption>{escape(name)}: {escape(said)}</figcaption></figure>'
        for name, said in words.items()
        if name in pictures
    )
    note = f'<p class="note">Corners found, and residuals drawn {ARROW} times as long.</p>'
    return f'{note}<div class="photos">{figures}</div>' if figures else ""


def _views(found: Calibration) -> str:
    rows = "".join(
        f"<tr><th>{escape(v.name)}</th><td>{v.rms_px:.3f}</td><td>{v.held_out_px:.3f}</td>"
        f"<td>{np.abs(v.residual_px).max():.2f}</td><td>{v.tilt_deg:.0f}</td><td>{v.distance_m:.2f}</td>"
        f"<td>{v.blur_px[1]:.1f}</td></tr>"
        for v in found.views
    )
    out = "".join(
        f'<tr><th>{escape(r.name)}</th><td class="words" colspan="6">not used: {escape(r.reason)}</td></tr>'
        for r in found.rejected
    )
    heads = ("view", "RMS px", "held out px", "largest px", "tilt, degrees", "distance m", "blur px")
    head = f"<thead><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{rows}{out}</tbody></table></div>'
