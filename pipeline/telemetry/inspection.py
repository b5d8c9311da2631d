"""What is in a log, what its clocks are worth, and what it lacks for camera poses: facts first, then words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.camera_pose.interpolate import MAX_GAP_S
from pipeline.telemetry.camera_pose.sigma import log_sigma, position_worth
from pipeline.telemetry.camera_pose.truth import truth_words
from pipeline.telemetry.clocks.own_clock import counts_from_1970
from pipeline.telemetry.gimbals.frames import FRAME_NAMES
from pipeline.telemetry.log.flight_log import FlightLog
from pipeline.telemetry.log.missing import missing_attitude, missing_gimbal, missing_position


@dataclass(frozen=True, kw_only=True)
class SeriesFacts:
    """One series: source, samples (valid ones), log time it covers, median rate, longest gap and gaps not bridged."""

    what: str
    source: str
    samples: int
    valid: int
    begin_s: float
    end_s: float
    rate_hz: float
    longest_gap_s: float
    gaps: int


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """A log in facts and words.

    series   position, attitude, gimbal: those that are there
    missing  what camera poses lack, each with what to do about it
    flight_file  lines for a camera's table of the flight file, as far as the log tells them
    words    the whole as lines for people
    """

    file: str
    format: str
    messages: int
    counts: Mapping[str, int]
    corrupt_packets: int
    series: tuple[SeriesFacts, ...]
    missing: tuple[str, ...]
    flight_file: tuple[str, ...]
    words: tuple[str, ...]


def inspect_log(log: FlightLog) -> Inspection:
    """Everything a person should know of a log before flying it through the pipeline."""
    named = (("position", log.position), ("attitude", log.attitude), ("gimbal", log.gimbal))
    series = tuple(_facts(what, s.source, s.time_s, s.time_s[s.valid]) for what, s in named if s is not None)
    missing, keys = _missing(log), _flight_file(log)
    to_write = ("for the flight file:", *(f"  {line}" for line in keys))
    return Inspection(
        file=log.path.name,
        format=log.format,
        messages=sum(log.counts.values()),
        counts=log.counts,
        corrupt_packets=log.corrupt_packets,
        series=series,
        missing=missing,
        flight_file=keys,
        words=(
            *_head(log),
            *map(_series_words, series),
            *_more(log),
            *log.notes,
            *position_worth(log).notes,
            *truth_words(log),
            *missing,
            *to_write,
        ),
    )


def _facts(what: str, source: str, time_s: Floats, valid_s: Floats) -> SeriesFacts:
    step = np.diff(valid_s)
    moving = step[step > np.finfo(float).tiny]
    nothing = float("nan")
    return SeriesFacts(
        what=what,
        source=source,
        samples=len(time_s),
        valid=len(valid_s),
        begin_s=float(valid_s[0]) if len(valid_s) else nothing,
        end_s=float(valid_s[-1]) if len(valid_s) else nothing,
        rate_hz=float(1 / np.median(moving)) if len(moving) else nothing,
        longest_gap_s=float(step.max()) if len(step) else nothing,
        gaps=int((step > MAX_GAP_S).sum()),
    )


def _missing(log: FlightLog) -> tuple[str, ...]:
    checks = (
        (log.position, missing_position, "missing"),
        (log.attitude, missing_attitude, "missing, unless a gimbal says all"),
        (log.gimbal, missing_gimbal, 'missing for mount = "gimbal"'),
    )
    found = []
    for series, error, lead in checks:
        if series is None or series.valid.sum() < 2:
            said = error(log, log.path.name)
            found.append(f"{lead}: {said.expected}. {said.advice[0].upper()}{said.advice[1:]}.")
    return tuple(found)


def _flight_file(log: FlightLog) -> tuple[str, ...]:
    """Lines for a camera's table."""
    inside = bool(np.isfinite(log.video_start_s))
    lines = [f'video = "{log.path.name}"', 'telemetry = "video"'] if inside else [f'telemetry = "{log.path.name}"']
    if len(log.systems) > 1:
        lines.append(f"system = {log.system}   # of {', '.join(map(str, log.systems))}")
    if log.gimbal is not None and log.gimbal.valid.sum() >= 2:
        lines.append('mount = "gimbal"   # else the camera\'s angles in the body: { roll_deg, pitch_deg, yaw_deg }')
        if log.gimbals:
            lines.append(f"gimbal = {log.gimbals[0]}   # of {', '.join(map(str, log.gimbals))}")
    else:
        lines.append("mount = { roll_deg = 0, pitch_deg = 0, yaw_deg = 0 }   # the camera in the body: fill in")
    if np.isfinite(log.video_start_s):
        lines.append("# no start: the video tells it")
    elif len(log.camera_event_s):
        lines.append('start = "camera-event"   # if the first exposure is frame 0; else "auto"')
    elif log.format == "dji srt":
        lines.append("start = 0.0   # of the video that the subtitles belong to")
    else:
        utc = "a UTC time, or " if log.utc is not None else ""
        lines.append(f'start = "auto"   # or {utc}seconds of log time')
    if log.position is not None and log.position.datum == "home":
        lines.append('takeoff = { height = 0.0, datum = "msl" }   # how high the take-off place is: fill in')
    return tuple(lines)


def _head(log: FlightLog) -> list[str]:
    who = "" if log.system is None else f", system {log.system}"
    who += "" if log.component is None else f" component {log.component}"
    lines = [f"{log.path.name}: {log.format}, {sum(log.counts.values())} messages of {len(log.counts)} kinds{who}"]
    if log.corrupt_packets:
        lines.append(f"{log.corrupt_packets} corrupt packets or stretches, none of them used")
    if len(log.systems) > 1:
        lines.append(f"vehicles that give positions: systems {', '.join(map(str, log.systems))}")
    return lines


def _series_words(facts: SeriesFacts) -> str:
    holes = f", {facts.gaps} gaps over {MAX_GAP_S:g} s" if facts.gaps else ""
    return (
        f"{facts.what}: {facts.source}, {facts.valid} of {facts.samples} samples valid,"
        f" log time {facts.begin_s:.1f} to {facts.end_s:.1f} s at {facts.rate_hz:.1f} Hz,"
        f" longest gap {facts.longest_gap_s:.2f} s{holes}"
    )


def _more(log: FlightLog) -> list[str]:
    lines = []
    if log.position is not None:
        lines.append(f"heights: {log.position.datum}, {log.position.height_from}")
    if log.gimbal is not None and len(log.gimbal.frame):
        frames = " or ".join(FRAME_NAMES[int(kind)] for kind in np.unique(log.gimbal.frame))
        lines.append(f"gimbal angles count from {frames}")
    if log.utc is not None:
        at = log.utc.log_epoch_s if counts_from_1970(log) else 0.0
        moment = datetime.fromtimestamp(log.utc.other_s(at), UTC).isoformat(timespec="milliseconds")
        lines.append(
            f"UTC at log time {at:.0f}: {moment} within {log.utc.sigma_s:.2f} s (one sigma), by {log.utc.source}"
        )
    else:
        lines.append('UTC is not known: `start` must be log time, "camera-event" or "auto"')
    if len(log.camera_event_s):
        lines.append(
            f"{len(log.camera_event_s)} camera events by {log.camera_event_source},"
            f" the first at log time {log.camera_event_s[0]:.3f} s"
        )
    if np.isfinite(log.video_start_s):
        lines.append(
            f"frame 0 of its video at log time {log.video_start_s:.3f} s, within {log.video_start_sigma_s:.2f} s"
        )
    if log.accuracy.source:
        stated = log.accuracy
        lines.append(f"accuracy by {stated.source}: {stated.horizontal_m:.2f} m across, {stated.vertical_m:.2f} m up")
    sigma = log_sigma(log)
    lines.append(
        f"sigmas from it: position {sigma.position_bias_m:.2f} m constant and {sigma.position_m:.2f} m moving,"
        f" attitude {np.degrees(sigma.attitude_bias_rad):.2f} degrees constant"
    )
    return lines
