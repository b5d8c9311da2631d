"""Where the figures come from: settings in force, inputs with their hashes, versions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.records import Results, Solution
from pipeline.report.blocks import table
from pipeline.report.text.markup import Html, joined, tag


def provenance(results: Results) -> Html:
    """Three tables."""
    settings = [*_flat("", results.settings), *_flat("solver", results.solution.settings)]
    parts = [_method(results)]
    if settings:
        parts.append(table(("setting", "value"), list(dict.fromkeys(settings)), caption="Settings in force", words=2))
    if results.inputs:
        rows = [(n, tag("code", h)) for n, h in sorted(results.inputs.items())]
        parts.append(table(("file", "SHA-256"), rows, caption="Inputs", words=2))
    if results.versions:
        parts.append(table(("package", "version"), sorted(results.versions.items()), caption="Versions", words=2))
    return joined(*parts)


def _method(results: Results) -> Html:
    s = results.solution
    rows = [
        ("method", s.method),
        ("status", s.status),
        ("message", s.message),
        ("iterations", str(s.iterations)),
        ("cost", f"{s.cost:.6g}"),
        ("chi-square", f"{s.chi_square:.6g}"),
        ("degrees of freedom", str(s.degrees_of_freedom)),
        ("test of unit weight", _unit_weight(s)),
    ]
    return table(("solver", ""), rows, caption="How the solver ended", words=2)


def _unit_weight(solution: Solution) -> str:
    """The chi-square test in words."""
    test = solution.unit_weight
    if test is None:
        return "not made: nothing is left over, or residuals have no sigma"
    between = f"{test.low:.3f} to {test.high:.3f} in 95 of 100 flights whose sigmas are true"
    return f"{'passed' if test.passed else 'failed'}: variance factor {test.variance_factor:.3f}, {between}"


def _flat(prefix: str, value: Any) -> list[tuple[str, str]]:
    """Nested settings as dotted names and their values."""
    if isinstance(value, Mapping):
        inner = [_flat(f"{prefix}.{k}" if prefix else str(k), v) for k, v in value.items()]
        return [pair for part in inner for pair in part]
    return [(prefix, "none" if value is None else str(value))]
