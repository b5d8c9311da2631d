"""The drawings of a calibration's page: where boards were, what is known there, residuals, the error of each view."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from calibration.judgement.coverage import FEW_BOARDS, TILES
from calibration.judgement.result import CalibratedView, Calibration
from calibration.judgement.verdict import worth_px

ARROW = 40
"""How many times as long as they are residuals are drawn."""
LEVELS = (0.1, 0.25, 0.5, 1.0)
"""Of what one sighting is worth: where the colours of the map of sigmas change."""
UNKNOWN_PX = 100.0


def coverage_figure(found: Calibration) -> str:
    """The picture coloured by one sigma of a direction, with the number of boards in each of five by five parts."""
    width, height = found.camera.image_size
    small = max(width, height) / 1000
    return (
        f'<figure><svg viewBox="0 0 {width} {height}" role="img" aria-label="{escape(_spoken(found))}">'
        f"{_sigma_cells(found)}{_rules(width, height, small)}{_hull(found, small)}"
        f'<g font-size="{46 * small:.1f}">{_counts(found)}</g></svg>{_legend(found)}'
        "<figcaption>Numbers: boards in each part of the picture, red where fewer than three. Colours: "
        "one sigma of a direction there. Dashed: the part that boards reached; outside of it the lens is extrapolated."
        "</figcaption></figure>"
    )


def _spoken(found: Calibration) -> str:
    rows = "; ".join(" ".join(map(str, row)) for row in found.coverage.boards.tolist())
    return f"boards in each part of the picture, row by row: {rows}"


def _level(sigma_px: float, worth: float) -> int:
    if not sigma_px < UNKNOWN_PX:
        return len(LEVELS) + 1
    return int(np.searchsorted(np.array(LEVELS) * worth, sigma_px))


def _sigma_cells(found: Calibration) -> str:
    """A rectangle about each point of the lattice; those at the edges reach as far as the picture."""
    width, height = found.camera.image_size
    rows, columns = found.sigma_map_px.shape
    x, y = (
        np.clip((np.arange(n + 1) - 0.5) * side / (n - 1), 0, side) for n, side in ((columns, width), (rows, height))
    )
    worth, cells = worth_px(found.camera.image_size), []
    for i in range(rows):
        level = [_level(value, worth) for value in found.sigma_map_px[i].tolist()]
        begin = 0
        for j in range(1, columns + 1):
            if j == columns or level[j] != level[begin]:
                cells.append(
                    f'<rect class="s{level[begin]}" x="{x[begin]:.1f}" y="{y[i]:.1f}" width="{x[j] - x[begin]:.1f}" '
                    f'height="{y[i + 1] - y[i] + 0.5:.1f}"/>'
                )
                begin = j
    return "".join(cells)


def _rules(width: int, height: int, small: float) -> str:
    lines = [f"M{width * k / TILES:.1f} 0V{height}M0 {height * k / TILES:.1f}H{width}" for k in range(1, TILES)]
    return f'<path class="rule" stroke-width="{1.5 * small:.2f}" d="{"".join(lines)}"/>'


def _hull(found: Calibration, small: float) -> str:
    every = np.concatenate([view.corners for view in found.views]).astype(np.float32)
    hull = np.asarray(cv2.convexHull(every)).reshape(-1, 2) + 0.5
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in hull)
    return f'<polygon class="edge" stroke-width="{2 * small:.2f}" points="{points}"/>'


def _counts(found: Calibration) -> str:
    width, height = found.camera.image_size
    return "".join(
        f'<text class="count{" few" if n < FEW_BOARDS else ""}" x="{width * (j + 0.5) / TILES:.1f}" '
        f'y="{height * (i + 0.5) / TILES:.1f}">{n}</text>'
        for i, row in enumerate(found.coverage.boards.tolist())
        for j, n in enumerate(row)
    )


def _legend(found: Calibration) -> str:
    worth = worth_px(found.camera.image_size)
    limits = [f"{share * worth:g}" for share in LEVELS]
    words = [f"below {limits[0]} px", *(f"to {limit} px" for limit in limits[1:]), f"above {limits[-1]} px", "unknown"]
    used = {_level(value, worth) for value in found.sigma_map_px.ravel().tolist()}
    items = "".join(f'<li><i class="s{k}"></i>{word}</li>' for k, word in enumerate(words) if k in used)
    return f'<ul class="legend">{items}</ul>'


def residual_figure(found: Calibration) -> str:
    """Every corner with its residual, and the principal point."""
    width, height = found.camera.image_size
    small, times = max(width, height) / 1000, _times(found)
    dots, lines = [], []
    for view in found.views:
        for (x, y), (dx, dy) in zip(view.corners, view.residual_px, strict=True):
            dots.append(f'<circle cx="{x + 0.5:.1f}" cy="{y + 0.5:.1f}" r="{1.8 * small:.1f}"/>')
            lines.append(f"M{x + 0.5:.1f} {y + 0.5:.1f}l{times * dx:.1f} {times * dy:.1f}")
    cx, cy, arm = found.camera.K[0, 2] + 0.5, found.camera.K[1, 2] + 0.5, 14 * small
    cross = f"M{cx - arm:.1f} {cy:.1f}h{2 * arm:.1f}M{cx:.1f} {cy - arm:.1f}v{2 * arm:.1f}"
    return (
        f'<figure><svg viewBox="0 0 {width} {height}" role="img" aria-label="corners and residuals">'
        f'<g class="dot">{"".join(dots)}</g>'
        f'<path class="residual" stroke-width="{1.3 * small:.2f}" '
        f'd="{"".join(lines)}"/><path class="cross" stroke-width="{2.5 * small:.2f}" d="{cross}"/></svg>'
        f"<figcaption>Corners, and their residuals drawn {times} times as long; the cross is the principal point. "
        "Arrows that agree with their neighbours are what the lens model cannot explain.</figcaption></figure>"
    )


def _times(found: Calibration) -> int:
    """By how much residuals are drawn longer: a typical one becomes a fiftieth of the picture."""
    wanted = 0.02 * max(found.camera.image_size) / max(found.rms_px, 1e-6)
    return next((n for n in (1000, 400, 200, 100, 40, 20) if n <= wanted), 10)


def error_bars(views: Sequence[CalibratedView]) -> str:
    """A bar for the error of each view, outlined what it is where the view is predicted from all others."""
    top = max(max(v.rms_px, v.held_out_px) for v in views) or 1.0
    step = 950 / len(views)

    def bar(i: int, kind: str, error: float, name: str) -> str:
        tall = 180 * error / top
        return (
            f'<rect class="{kind}" x="{50 + i * step + 2:.1f}" y="{190 - tall:.1f}" width="{max(step - 4, 1):.1f}" '
            f'height="{tall:.1f}"><title>{escape(name)}: {error:.3f} px</title></rect>'
        )

    bars = "".join(bar(i, "bar", v.rms_px, v.name) + bar(i, "held", v.held_out_px, v.name) for i, v in enumerate(views))
    return (
        '<figure><svg viewBox="0 0 1000 200" role="img" aria-label="error of each view">'
        f'<path class="axis" d="M50 190H1000"/><text class="tick" x="2" y="24" font-size="20">{top:.2f}</text>'
        f'<text class="tick" x="2" y="192" font-size="20">0 px</text>{bars}</svg><figcaption>Error of each view; '
        "outlined: the same where the view is predicted from all others.</figcaption></figure>"
    )
