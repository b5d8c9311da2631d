"""Drawings of the records on matplotlib axes (extra `plot`); the caller's own axes, or new ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.foundation.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from calibration.judgement.result import Calibration

ELLIPSES = 12
"""One-sigma ellipses along each way, at most; more hide it."""


def trajectories(table: pd.DataFrame, ax: Axes | None) -> Axes:
    """Each target's way from above, with one-sigma ellipses of the horizontal position."""
    shown = _ground(ax)
    for target, rows in table.groupby("target", sort=False):
        (line,) = shown.plot(rows.east_m, rows.north_m, label=str(target))
        for _, row in rows.iloc[:: max(1, len(rows) // ELLIPSES)].iterrows():
            _ellipse(shown, row, line.get_color())
    return _named(shown)


def plan(table: pd.DataFrame, by: str, ax: Axes | None) -> Axes:
    """Ways from above, one for each value of a column."""
    shown = _ground(ax)
    for name, rows in table.groupby(by, sort=False):
        shown.plot(rows.east_m, rows.north_m, label=str(name))
    return _named(shown)


def image_ways(table: pd.DataFrame, ax: Axes | None) -> Axes:
    """Each track in its picture; rows count downwards."""
    shown = _axes(ax)
    for (camera, target), rows in table.groupby(["camera", "target"], sort=False):
        shown.plot(rows.x_px, rows.y_px, label=f"{camera} {target}")
    shown.set(xlabel="x (px)", ylabel="y (px)", aspect="equal")
    if not shown.yaxis_inverted():
        shown.invert_yaxis()
    return _named(shown)


def way(x: pd.Series[float], y: pd.Series[float], x_label: str, y_label: str, ax: Axes | None) -> Axes:
    """One way."""
    shown = _axes(ax)
    shown.plot(x, y)
    shown.set(xlabel=x_label, ylabel=y_label)
    return shown


def heights(names: Sequence[str], values: Sequence[float], label: str, ax: Axes | None) -> Axes:
    """A bar for each name."""
    shown = _axes(ax)
    shown.bar(list(names), [value if np.isfinite(value) else 0.0 for value in values])
    shown.set(ylabel=label)
    return shown


def residuals(found: Calibration, ax: Axes | None) -> Axes:
    """Corners of every photo with their residuals as arrows, as long as matplotlib finds readable."""
    shown = _axes(ax)
    xy = np.concatenate([view.corners for view in found.views])
    off = np.concatenate([view.residual_px for view in found.views])
    shown.quiver(xy[:, 0], xy[:, 1], off[:, 0], off[:, 1], np.linalg.norm(off, axis=1), angles="xy", cmap="viridis")
    width, height = found.camera.image_size
    shown.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="x (px)", ylabel="y (px)")
    return shown


def _ellipse(ax: Axes, row: Any, colour: Any) -> None:
    from matplotlib.patches import Ellipse

    covariance = np.array([[row.cov_ee, row.cov_en], [row.cov_en, row.cov_nn]], dtype=float)
    if not np.isfinite(covariance).all():
        return
    values, vectors = np.linalg.eigh(covariance)
    axes = 2 * np.sqrt(np.maximum(values, 0))
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    ax.add_patch(Ellipse((row.east_m, row.north_m), axes[1], axes[0], angle=angle, fill=False, color=colour, alpha=0.5))


def _ground(ax: Axes | None) -> Axes:
    shown = _axes(ax)
    shown.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    return shown


def _named(ax: Axes) -> Axes:
    if ax.get_legend_handles_labels()[0]:
        ax.legend()
    return ax


def _axes(ax: Axes | None) -> Axes:
    """The caller's axes, or new ones. Raises UsageError where matplotlib is not installed."""
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError:
        raise UsageError(
            where="plot()",
            seen="the package 'matplotlib' is not installed",
            expected="matplotlib, which draws",
            advice="pip install 'runningfix[plot]'",
        ) from None
    return pyplot.subplots()[1]
