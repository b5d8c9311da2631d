"""`runningfix match`: which target of one camera is which of another."""

from __future__ import annotations

import time
from argparse import Namespace
from typing import Any

from pipeline.cli.console import Console
from pipeline.flight import read_flight
from pipeline.stages import MatchRun, run_match


def run(arguments: Namespace, console: Console) -> int:
    """Writes the matched flight file and says what was paired, what is doubtful and what stays alone."""
    begin = time.perf_counter()
    flight = read_flight(arguments.flight)
    found = run_match(flight, arguments.output, write=arguments.write, progress=console.progress)
    for warning in found.warnings:
        console.say(f"note: {warning}")
    console.result(summary(found, time.perf_counter() - begin), words(found))
    return 0


def summary(found: MatchRun, seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    matching = found.matching
    return {
        "status": "done",
        "command": "match",
        "targets": [
            {
                "name": found.names[target.tracks[0]],
                "tracks": {track.camera: track.target for track in target.tracks},
                "pairs": [
                    {"cameras": [p.first.camera, p.second.camera], "margin": p.margin} for p in target.pairs
                ],
            }
            for target in matching.targets
        ],
        "doubtful": [
            {
                "first": {"camera": d.pair.first.camera, "target": d.pair.first.target},
                "second": {"camera": d.pair.second.camera, "target": d.pair.second.target},
                "margin": d.pair.margin,
                "why": d.why,
            }
            for d in matching.doubtful
        ],
        "offsets": [
            {"camera": c.camera, "offset_s": c.offset_s, "offset_sigma_s": c.sigma_s} for c in matching.clocks
        ],
        "warnings": list(found.warnings),
        "seconds": {**{k: round(v, 3) for k, v in found.seconds.items()}, "total": round(seconds, 3)},
        "files": [str(path) for path in found.files],
    }  # fmt: skip


def words(found: MatchRun) -> str:
    """The same for people: a table of the common targets, then doubts, single tracks, clocks, files."""
    matching = found.matching
    cameras = [clock.camera for clock in matching.clocks]
    common = [target for target in matching.targets if len(target.tracks) > 1]
    rows = [["target", *cameras, "margin"]]
    for target in common:
        own = {track.camera: track.target for track in target.tracks}
        least = min(pair.margin for pair in target.pairs)
        rows.append([found.names[target.tracks[0]], *(own.get(c, "-") for c in cameras), f"{least:.1f}"])
    wide = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, wide, strict=True)).rstrip() for row in rows]
    if not common:
        lines = ["no two tracks are surely of one target"]
    for doubt in matching.doubtful:
        pair = doubt.pair
        lines.append(f"doubtful  {pair.first} = {pair.second} (margin {pair.margin:.1f}), left apart; {doubt.why}")
    alone = [str(target.tracks[0]) for target in matching.targets if len(target.tracks) == 1]
    if alone:
        lines.append(f"alone     {', '.join(alone)}")
    for clock in matching.clocks[1:]:
        if clock.offset_s is None or clock.sigma_s is None:
            lines.append(f"offset    {clock.camera}: not known from these tracks")
        else:
            lines.append(f"offset    {clock.camera}: {clock.offset_s:+.2f} +- {clock.sigma_s:.2f} s (one sigma)")
    lines += [f"wrote     {path}" for path in found.files]
    return "\n".join(lines)
