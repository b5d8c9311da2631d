"""Intervals in which a camera saw a target, lost it, or found it again."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.records import LOST, REACQUIRED, TRACKED, ImageTrack, Results
from pipeline.report.data import participants


@dataclass(frozen=True, kw_only=True)
class StateInterval:
    """From `start_s` to `end_s` (common time) the track was in `state`: TRACKED, REACQUIRED or LOST."""

    start_s: float
    end_s: float
    state: int


def state_intervals(results: Results, track: ImageTrack) -> list[StateInterval]:
    """The track's states in order; a gap in the frames longer than three usual steps counts as lost.

    REACQUIRED stands for the tracked interval that begins with the first fix after a loss.
    """
    if not len(track.frame):
        return []
    time = participants.frame_times(results, track.camera, track.frame)
    steps = np.diff(track.frame)
    usual = max(1, int(np.median(steps))) if len(steps) else 1
    gap = np.append(False, steps > 3 * usual)
    gone = ~track.seen
    changes = np.flatnonzero(np.append(True, (gone[1:] != gone[:-1]) | gap[1:]))
    ends = np.append(changes[1:], len(time))
    out: list[StateInterval] = []
    for first, after in zip(changes, ends, strict=True):
        if gap[first]:
            out.append(StateInterval(start_s=float(time[first - 1]), end_s=float(time[first]), state=LOST))
        last = min(after, len(time) - 1) if not (after < len(time) and gap[after]) else after - 1
        state = LOST if gone[first] else REACQUIRED if track.state[first] == REACQUIRED or gap[first] else TRACKED
        out.append(StateInterval(start_s=float(time[first]), end_s=float(time[last]), state=state))
    return out


def times_seen(results: Results, camera: str, target: str) -> list[tuple[float, float]]:
    """The stretches in which `camera` had a fix on `target`."""
    found = [t for t in results.tracks if t.camera == camera and t.target == target]
    return [(s.start_s, s.end_s) for t in found for s in state_intervals(results, t) if s.state != LOST]


def losses(results: Results, target: str) -> int:
    """How often any camera lost the target and found it again."""
    count = 0
    for track in (t for t in results.tracks if t.target == target):
        states = [s.state for s in state_intervals(results, track)]
        count += sum(1 for a, b in pairwise(states) if a == LOST and b != LOST)
    return count
