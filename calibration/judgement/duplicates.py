"""The same picture twice is one observation: copies, other sizes of a file, a burst from a tripod."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.boards.view import BoardView

SAME_PX = 0.25
"""RMS distance of the corners of two views up to which they are one picture. Copies differ by 0, by 0.03 where saved
anew; between two photos a hand moves by pixels. Doubled, a tripod's shots after a touch count once too."""


def without_copies(views: Sequence[BoardView]) -> tuple[list[BoardView], list[tuple[BoardView, BoardView]]]:
    """The views of which none is a copy of an earlier one, and each copy with the one that is used."""
    kept: list[BoardView] = []
    copies: list[tuple[BoardView, BoardView]] = []
    for view in views:
        first = next((other for other in kept if _same(view, other)), None)
        if first is None:
            kept.append(view)
        else:
            copies.append((view, first))
    return kept, copies


def _same(one: BoardView, other: BoardView) -> bool:
    """Whether the corners that both show lie at the same places, and hardly one shows what the other does not."""
    if one.image_size != other.image_size:
        return False
    common, mine, theirs = np.intersect1d(one.index, other.index, return_indices=True)
    if len(common) < max(3, 0.9 * max(len(one.index), len(other.index))):
        return False
    apart = one.corners[mine] - other.corners[theirs]
    return bool(np.sqrt(np.mean(np.sum(apart**2, axis=1))) < SAME_PX)
