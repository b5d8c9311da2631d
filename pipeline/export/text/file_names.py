"""Names of files of which there is one for each target: the first has the plain name, every other its own in it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pipeline.records import Trajectory


def names_of_others(trajectories: Sequence[Trajectory], suffix: str) -> dict[str, Trajectory]:
    """File name -> every trajectory but the first; characters that are not plain become underscores."""
    files: dict[str, Trajectory] = {}
    for trajectory in trajectories[1:]:
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", trajectory.target)
        name, count = f"trajectory-{plain}.{suffix}", 1
        while name.lower() in (taken.lower() for taken in files):
            count += 1
            name = f"trajectory-{plain}-{count}.{suffix}"
        files[name] = trajectory
    return files
