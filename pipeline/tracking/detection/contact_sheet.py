"""A contact sheet: one row of pictures for each proposed target, so that a person sees what was proposed."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.tracking.detection.propose import PICTURE_PX, PICTURES_S, Proposal
from pipeline.tracking.video.frames import Image

WORDS_PX, GAP_PX = 230, 4
PAPER, INK, FAINT = (250, 250, 250), (30, 30, 30), (120, 120, 120)


def contact_sheet(proposals: Sequence[Proposal], names: Sequence[str], frame_rate: float) -> Image:
    """A picture (h, w, 3) with a row for each proposal under its name."""
    width, height = PICTURE_PX
    across = WORDS_PX + len(PICTURES_S) * (width + GAP_PX)
    sheet = np.full((max(1, len(proposals)) * (height + GAP_PX) + 24, across, 3), PAPER, np.uint8)
    for k, second in enumerate(PICTURES_S):
        _write(sheet, f"+{second:g} s", WORDS_PX + k * (width + GAP_PX), 16, FAINT)
    for row, (proposal, name) in enumerate(zip(proposals, names, strict=True)):
        top = 24 + row * (height + GAP_PX)
        box = proposal.box
        lines = (
            f"[{box.x:g}, {box.y:g}, {box.width:g}, {box.height:g}]",
            f"frames {box.frame} to {proposal.last_frame}",
            f"{(proposal.last_frame - box.frame) / frame_rate:.1f} s, {proposal.way_px:.0f} px",
        )
        _write(sheet, name, 10, top + 26, INK, 0.7)
        for k, line in enumerate(lines):
            _write(sheet, line, 10, top + 54 + 22 * k, FAINT)
        for k, picture in enumerate(proposal.pictures):
            left = WORDS_PX + k * (width + GAP_PX)
            sheet[top : top + height, left : left + width] = picture
    return sheet


def _write(sheet: Image, text: str, x: int, y: int, colour: tuple[int, int, int], size: float = 0.45) -> None:
    cv2.putText(sheet, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
