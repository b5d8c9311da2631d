"""trajectory.tum: the TUM format of evo and other SLAM tools: timestamp x y z qx qy qz qw, separated by spaces.

One trajectory per file: the first target is in trajectory.tum, every other NAME in trajectory-NAME.tum. Positions are
local ENU metres. Targets are points, so the rotation is always the identity. Timestamps are POSIX seconds of UTC, as
the format has it, and common time where UTC is not known.
"""

from __future__ import annotations

from pipeline.export.text.cells import fixed
from pipeline.export.text.file_names import names_of_others
from pipeline.records import Results, Trajectory


def tum(results: Results) -> str | None:
    """The first target's trajectory; None where there is none."""
    return _text(results.trajectories[0], results.utc_s) if results.trajectories else None


def tum_of_others(results: Results) -> dict[str, str]:
    """File name -> text of every target but the first."""
    return {name: _text(t, results.utc_s) for name, t in names_of_others(results.trajectories, "tum").items()}


def _text(trajectory: Trajectory, utc_s: float | None) -> str:
    said = " ".join(trajectory.target.split())
    clock = "common time" if utc_s is None else "UTC, POSIX seconds"
    lines = [f"# target {said}; timestamp: {clock}; x y z: local east, north, up in metres; rotation: none, identity"]
    whole = 0 if utc_s is None else round(utc_s * 1e6)
    for time_s, (east, north, up) in zip(trajectory.time_s.tolist(), trajectory.position_enu_m.tolist(), strict=True):
        stamp = _seconds(whole + round(time_s * 1e6))
        lines.append(f"{stamp} {fixed(east, 6)} {fixed(north, 6)} {fixed(up, 6)} 0 0 0 1")
    return "\n".join(lines) + "\n"


def _seconds(micros: int) -> str:
    """Exact decimal text of whole microseconds."""
    seconds, rest = divmod(abs(micros), 1_000_000)
    return f"{'-' if micros < 0 else ''}{seconds}.{rest:06d}"
