"""`runningfix detect`: a video -> what moves in it, as pictures and as boxes for the flight file."""

from __future__ import annotations

import json
import re
import time
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

import cv2

from calibration.foundation.errors import TrackingError, UsageError
from calibration.foundation.files import write_whole
from pipeline.cli.console import Console
from pipeline.tracking import Proposal, contact_sheet, propose_targets, video_head

SHEET, BOXES = "contact.png", "boxes.toml"


def run(arguments: Namespace, console: Console) -> int:
    """Writes the contact sheet and the boxes, and says the boxes."""
    if arguments.most < 1:
        raise UsageError(where="--most", seen=str(arguments.most), expected="1 or more", advice="--most 12")
    begin = time.perf_counter()
    video = arguments.video
    found = propose_targets(
        video, most=arguments.most, progress=lambda done, total: console.progress("detect", done, total)
    )
    if not found:
        raise TrackingError(
            where=str(video),
            seen="nothing that moves on its own",
            expected="targets that move against what is behind them for half a second or more",
            advice="draw the boxes yourself: `runningfix label flight.toml`",
        )
    camera = arguments.camera or video.stem
    names = [f"{camera}-{k + 1}" for k in range(len(found))]  # names of no other video's
    text = boxes_toml(found, names, camera)
    sheet = contact_sheet(found, names, video_head(video).frame_rate)
    write_whole(arguments.output / SHEET, cv2.imencode(".png", sheet)[1].tobytes())
    write_whole(arguments.output / BOXES, text)
    seconds = time.perf_counter() - begin
    look = f"# look at {arguments.output / SHEET}, keep the tables of what you want"
    console.result(summary(found, names, arguments, seconds), f"{look}\n\n{text}")
    return 0


def boxes_toml(found: Sequence[Proposal], names: Sequence[str], camera: str) -> str:
    """Tables to paste into a flight file."""
    tables = []
    for proposal, name in zip(found, names, strict=True):
        box = proposal.box
        sides = f"[{box.x:g}, {box.y:g}, {box.width:g}, {box.height:g}]"
        tables.append(f"[targets.{_key(name)}]\nboxes.{_key(camera)} = {{ frame = {box.frame}, box = {sides} }}\n")
    return "\n".join(tables)


def _key(name: str) -> str:
    """A TOML key: bare where it may be."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def summary(found: Sequence[Proposal], names: Sequence[str], arguments: Namespace, seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    return {
        "status": "done",
        "command": "detect",
        "targets": [
            {
                "name": name, "frame": p.box.frame, "box": [p.box.x, p.box.y, p.box.width, p.box.height],
                "last_frame": p.last_frame, "fixes": p.fixes, "way_px": p.way_px,
            }
            for p, name in zip(found, names, strict=True)
        ],
        "warnings": [],
        "seconds": {"detect": round(seconds, 3)},
        "files": [str(arguments.output / SHEET), str(arguments.output / BOXES)],
    }  # fmt: skip
