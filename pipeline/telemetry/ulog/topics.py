"""The topics of a PX4 log (.ulg), read by pyulog (the extra `ulog`): columns of the first instance of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.telemetry.ulog.boots import joined
from pipeline.telemetry.ulog.columns import GPS_TOPICS, Topic, floats
from pipeline.telemetry.ulog.recordings import recordings_of

RECEIVED, PRIMARY = 3, "estimator_selector_status"


@dataclass(frozen=True, kw_only=True, eq=False)
class PX4Log:
    """What pyulog found.

    topics      of each topic the instance that is used; times of later boots go on after those of earlier ones
    instances   every instance of each topic
    counts      messages per topic
    info, parameters  what the log's head says of vehicle and settings
    notes       dropouts, later boots, and what pyulog complains of, of which there are `complaints`
    """

    topics: dict[str, Topic]
    instances: dict[str, dict[int, Topic]]
    counts: dict[str, int]
    info: dict[str, Any]
    parameters: dict[str, float]
    notes: tuple[str, ...]
    complaints: int


def load_topics(path: Path) -> PX4Log:
    """Every topic of a `.ulg` file. Raises InputFileError where pyulog is not installed or cannot read it."""
    recordings = recordings_of(path)
    counts: dict[str, int] = {}
    for recording in recordings:
        for name, each in recording.instances.items():
            counts[name] = counts.get(name, 0) + sum(len(topic["timestamp"]) for topic in each.values())
    instances, boots = joined(recordings)
    complaints = [line for recording in recordings for line in recording.complaints]
    dropouts = sum(recording.dropouts for recording in recordings)
    slow = (f"{dropouts} dropouts: the card was too slow for the log",) if dropouts else ()
    return PX4Log(
        topics={name: _chosen(name, instances) for name in instances},
        instances=instances,
        counts=counts,
        info=recordings[0].info,
        parameters=recordings[0].parameters,
        notes=(*slow, *boots, *(f"pyulog: {line}" for line in dict.fromkeys(complaints))),
        complaints=len(complaints),
    )


def _chosen(name: str, instances: dict[str, dict[int, Topic]]) -> Topic:
    """The first instance of a topic; of receivers the first with a 3D fix, of estimators the one that flew mostly."""
    each = instances[name]
    if name in GPS_TOPICS:
        fixed = (t for _, t in sorted(each.items()) if (floats(t, "fix_type") >= RECEIVED).any())
        return next(fixed, each[min(each)])
    if name.startswith("estimator_") and name != PRIMARY and PRIMARY in instances:
        selected = floats(_chosen(PRIMARY, instances), "primary_instance")
        return each.get(int(np.median(selected)) if np.isfinite(selected).any() else 0, each[min(each)])
    return each[min(each)]


def several_receivers(instances: dict[str, dict[int, Topic]]) -> tuple[str, ...]:
    """A note where several receivers have a fix and no topic says which one the estimator follows."""
    name = next((topic for topic in GPS_TOPICS if topic in instances), "")
    fixed = [i for i, topic in sorted(instances.get(name, {}).items()) if (floats(topic, "fix_type") >= RECEIVED).any()]
    if len(fixed) < 2:
        return ()
    said = ", ".join(map(str, fixed))
    return (f"receivers {said} have a fix in {name}; what is said of the receiver is {fixed[0]}'s",)
