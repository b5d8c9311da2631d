"""What became of one flight: a row of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from calibration.foundation.errors import RunningFixError

STATUSES = ("done", "failed", "timeout", "memory", "crashed")
"""done: it has results, whatever their verdict; failed: refused in words; timeout, memory: beyond a limit; crashed:
its process ended by itself, more than once."""


@dataclass(frozen=True, kw_only=True)
class FlightOutcome:
    """One flight of a batch.

    name       of its folder in the data set; source  where its flight file is
    status     one of STATUSES
    verdict    "good", "care" or "bad", with `reasons`; "" where there is no result
    offsets    of each camera: camera, offset_s, offset_sigma_s
    positions  of each target: target, typical_sigma_m (3D, one sigma)
    seconds    that it took, `solver_seconds` of them in the numerical solve; when it was run, if it was found finished
    error      where, seen, expected, advice of what stopped it; exit_code as `run` would have ended
    files      relative name -> bytes, of its results
    versions   package -> version
    key        a hash of all that decides the outcome
    """

    name: str
    source: str
    status: str
    key: str = ""
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    method: str = ""
    offsets: tuple[Mapping[str, Any], ...] = ()
    positions: tuple[Mapping[str, Any], ...] = ()
    chi_square: float | None = None
    degrees_of_freedom: int | None = None
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    solver_seconds: float = 0.0
    exit_code: int = 0
    error: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, int] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)


def outcome_of(plain: Mapping[str, Any]) -> FlightOutcome:
    """The outcome that `plain` wrote. Raises TypeError or ValueError where it is none."""
    lists = ("reasons", "offsets", "positions", "warnings")
    told: dict[str, Any] = {key: tuple(value) if key in lists else value for key, value in plain.items()}
    found = FlightOutcome(**told)
    if found.status not in STATUSES or not all(isinstance(size, int) for size in found.files.values()):
        raise ValueError("no outcome of a flight")
    return found


def stopped(
    name: str, source: str, error: RunningFixError, *, status: str = "failed", seconds: float = 0.0
) -> FlightOutcome:
    """A flight that has no results, because of `error`."""
    parts = {part: getattr(error, part) for part in ("where", "seen", "expected", "advice")}
    return FlightOutcome(
        name=name, source=source, status=status, error=parts, exit_code=error.exit_code, seconds=seconds
    )
