"""What one flight may take: time and memory."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from calibration.foundation.errors import UsageError

POLL_S = 0.05
"""Between two looks at a worker's memory. Twice as long: a flight that is ended has taken twice as much too much."""
LOOK_AROUND_S = 0.5
"""Between two looks at all processes of the machine for those that a worker started: each costs milliseconds. Twice as
long: what these are ended for has taken twice as much too much."""
HEADROOM_BYTES = 1 << 30
"""Above the limit the operating system itself refuses more: for what is taken at once, between two looks."""
ATTEMPTS = 2
"""Of a flight whose process ended by itself: once may be chance (a machine out of memory), twice is the flight."""
USABLE_SHARE = 0.8
"""Of the machine's memory that all workers together may have by default; the rest is for files being read."""
UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Of one flight: seconds, and bytes of memory that its process and those it starts have together."""

    time_s: float = 3600.0
    memory_bytes: int = 4 << 30


def memory_bytes(text: str) -> int:
    """Bytes of a size such as 2G or 800M. Raises UsageError where it is none."""
    found = re.fullmatch(r"(\d{1,12}(?:\.\d{1,6})?)([KMGT]?)(?:i?B)?", text.strip(), re.IGNORECASE)
    size = 0 if found is None else int(float(found[1]) * UNITS[found[2].upper()])
    if size < 1:
        raise UsageError(where="--memory", seen=text, expected="a size such as 2G or 800M", advice="--memory 2G")
    return size


def share_of_memory(jobs: int) -> int:
    """What each of so many workers may have of this machine's memory."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return max(1, int(USABLE_SHARE * whole / jobs))
