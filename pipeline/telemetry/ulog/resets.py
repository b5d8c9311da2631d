"""Where PX4's estimator set its state anew in flight: poses step there, as its own counters say."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.geometry import rotation
from pipeline.telemetry.log.series import METRES_PER_DEGREE
from pipeline.telemetry.ulog.columns import Topic, floats, topic_time

LEAST_M, LEAST_RAD = 1.0, np.radians(2.0)
"""Smaller steps are within what the instruments are worth."""


def reset_notes(topics: dict[str, Topic]) -> tuple[str, ...]:
    """One sentence for positions, heights and attitudes that were set anew by more than they are worth."""
    notes = []
    place, turn = topics.get("vehicle_global_position"), topics.get("vehicle_attitude")
    if place is not None:
        lat, lon = floats(place, "lat"), floats(place, "lon")
        across = METRES_PER_DEGREE * np.hypot(_step(lat), np.cos(np.radians(lat)) * _step(lon))
        for what, counter, size in (
            ("position", "lat_lon_reset_counter", across),
            ("height", "alt_reset_counter", np.abs(_step(floats(place, "alt")))),
        ):
            notes += _said(what, counter, place, size > LEAST_M, [f"{metres:.1f} m" for metres in size])
    if turn is not None:
        q = np.stack([floats(turn, f"q[{i}]") for i in range(4)], axis=1)
        angle = np.zeros(len(q))
        angle[1:] = np.linalg.norm(rotation.turn(q[:-1], q[1:]), axis=1)
        angle[2:] = np.abs(angle[2:] - angle[1:-1])
        said = [f"{degrees:.1f} degrees" for degrees in np.degrees(angle)]
        notes += _said("attitude", "quat_reset_counter", turn, angle > LEAST_RAD, said)
    return tuple(notes)


def _step(value: Floats) -> Floats:
    """By how much each value (n,) is off where the one before it went on."""
    step = np.zeros(len(value))
    step[1:] = np.diff(value)
    step[2:] -= np.diff(value)[:-1]
    return step


def _said(what: str, counter: str, topic: Topic, large: Bools, size: list[str]) -> list[str]:
    counts = floats(topic, counter)
    at = np.flatnonzero(np.concatenate([[False], np.diff(counts) != 0]) & np.isfinite(counts) & large)
    if not len(at):
        return []
    time = topic_time(topic)
    steps = ", ".join(f"{size[i]} at log time {time[i]:.1f} s" for i in at[:3].tolist())
    more = f" and {len(at) - 3} times more" if len(at) > 3 else ""
    return [f"PX4's estimator set its {what} anew, by {steps}{more} ({counter}): poses on both sides are apart by that"]
