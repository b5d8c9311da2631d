"""Where names go in a drawing: beside their point, inside the frame, not over each other."""

from __future__ import annotations

from collections.abc import Sequence

Box = tuple[float, float, float, float]
OFFSETS = (
    (9, 4),
    (9, -8),
    (9, 16),
    (0, -12),
    (0, 22),
    (-9, 4),
    (-9, -8),
    (-9, 16),
    (14, -22),
    (14, 30),
    (-14, -22),
    (-14, 30),
)


def place(
    points: Sequence[tuple[float, float, str]], width: float, height: float, taken: Sequence[Box] = (), size: float = 16
) -> list[tuple[float, float, str]]:
    """For each (x, y, words) in pixels: x, y and anchor ("start", "middle", "end") of its text."""
    boxes = [*taken, *((x - 4, y - 4, x + 4, y + 4) for x, y, _ in points)]
    placed = []
    for x, y, words in points:
        options = [_option(x, y, dx, dy, words, size) for dx, dy in OFFSETS]
        at, box = min(options, key=lambda o: _cost(o[1], boxes, width, height))
        boxes.append(box)
        placed.append(at)
    return placed


def _option(x: float, y: float, dx: float, dy: float, words: str, size: float) -> tuple[tuple[float, float, str], Box]:
    long = 0.6 * size * len(words)
    anchor = "middle" if dx == 0 else "start" if dx > 0 else "end"
    left = x + dx - (long / 2 if dx == 0 else 0 if dx > 0 else long)
    return (x + dx, y + dy, anchor), (left, y + dy - size, left + long, y + dy + 0.3 * size)


def _cost(box: Box, boxes: Sequence[Box], width: float, height: float) -> float:
    outside = max(0, -box[0]) + max(0, box[2] - width) + max(0, -box[1]) + max(0, box[3] - height)
    left, top, right, bottom = box
    covered = 0.0
    for other_left, other_top, other_right, other_bottom in boxes:
        if other_left < right and left < other_right and other_top < bottom and top < other_bottom:
            wide = min(right, other_right) - max(left, other_left)
            covered += wide * (min(bottom, other_bottom) - max(top, other_top))
    return 50 * outside + covered
