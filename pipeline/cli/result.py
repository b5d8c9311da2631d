"""What a solve found, for people: the verdict with its reasons, then one table of everything that was determined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

Plain: TypeAlias = Mapping[str, Any]
"""A part of `solution.json`."""

GRADES = {
    "good": "good: nothing speaks against it",
    "care": "care: read the reasons before you rely on it",
    "bad": "BAD: do not use this; every file says so",
}
STYLES = {"good": "green", "care": "yellow", "bad": "bold red"}
MARKS = {"good": "-", "care": "!", "bad": "x"}


def shown(solution: Plain) -> RenderableType:
    """A solution as it is printed."""
    return Group(*_verdict(solution["verdict"]), "", determined(solution), "", *_how_it_ended(solution))


def _how_it_ended(solution: Plain) -> list[RenderableType]:
    lines: list[RenderableType] = [
        f"{solution['method']}: {solution['status']} after {solution['iterations']} iterations, chi-square "
        f"{solution['chi_square']:.1f} for {solution['degrees_of_freedom']} degrees of freedom. {solution['message']}"
    ]
    return lines + [_indented(finding["words"], 2) for finding in solution.get("findings", [])]


def _verdict(verdict: Plain) -> list[RenderableType]:
    """The grade, and every reason with what to do about it."""
    style = STYLES[verdict["grade"]]
    lines: list[RenderableType] = [Text.assemble("verdict    ", (GRADES[verdict["grade"]], style))]
    for reason in verdict["reasons"]:
        named = reason["subject"] and reason["subject"] not in reason["words"]
        words = f"{reason['subject']}: {reason['words']}" if named else reason["words"]
        lines.append(
            Padding(Text.assemble((MARKS[reason["grade"]], STYLES[reason["grade"]]), " ", words), (0, 0, 0, 2))
        )
        if reason["advice"]:
            lines.append(_indented(reason["advice"], 4))
    return lines


def _indented(words: RenderableType, columns: int) -> Padding:
    return Padding(words, (0, 0, 0, columns), expand=False)


def determined(solution: Plain) -> Table:
    """One row for every offset, frame rate, correction and target; sigma is one standard deviation."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 3, 0, 0))
    for name in ("", "", "found", "one sigma"):
        table.add_column(name, overflow="fold")
    for clock in solution["clocks"]:
        if clock["offset_sigma_s"] != 0:
            table.add_row("offset", clock["camera"], f"{clock['offset_s']:+.4f} s", told(clock["offset_sigma_s"], "s"))
        if clock["frame_rate_sigma"] != 0:
            rate = f"{clock['frame_rate']:.4f} Hz"
            table.add_row("frame rate", clock["camera"], rate, told(clock["frame_rate_sigma"], "Hz"))
    for bias in solution.get("biases", []):
        for name, key, unit in (("orientation", "rotation", "deg"), ("position", "position", "m")):
            row = _vector(bias, key, unit)
            if row is not None:
                table.add_row(f"{name} correction", bias["camera"], *row)
    for motion in solution["motions"]:
        table.add_row("position", motion["target"], _motion(motion), told(motion["typical_sigma_m"], "m"))
    for mark in solution.get("landmarks", []):
        table.add_row("check point" if mark["kind"] == "check" else "landmark", mark["landmark"], *_landmark(mark))
    for one in solution.get("ground", []):
        table.add_row("ground", one["target"], f"{one['off_m']:+.2f} m off", told(one["sigma_m"], "m"))
    return table


def _landmark(mark: Plain) -> tuple[str, str]:
    """How far it is from its coordinates, where it has some, and the sigma of that."""
    if "off_m" not in mark:
        return "unknown place", told(math.hypot(*(s or math.nan for s in mark["sigma_m"])), "m")
    off, sigma = math.hypot(*mark["off_m"]), math.hypot(*(s or math.nan for s in mark["off_sigma_m"]))
    return f"{off:.3g} m from its coordinates ({mark['error_over_sigma']:.2f} sigmas)", told(sigma, "m")


def _vector(bias: Plain, key: str, unit: str) -> tuple[str, str] | None:
    """Length of a correction and the sigma of its largest part; None where it was held."""
    sigma = bias.get(f"{key}_sigma_{unit}")
    value = bias.get(f"{key}_{unit}")
    if value is None or sigma is None or not any(sigma):
        return None
    worst = None if any(s is None for s in sigma) else max(sigma)
    return f"{math.hypot(*value):.3g} {unit}", told(worst, unit)


def _motion(motion: Plain) -> str:
    if motion["kind"] == "polynomial":
        return f"polynomial of order {motion['degree']}"
    return str(motion["kind"])


def told(sigma: float | None, unit: str) -> str:
    """Three figures, or that it is not known."""
    return "unknown" if sigma is None or not math.isfinite(sigma) else f"{sigma:.3g} {unit}"
