"""Pieces of a file: which of its bytes are read where not all of them are."""

from __future__ import annotations

import numpy as np

Pieces = tuple[tuple[int, int], ...]
"""First byte and end of each, in the order of the file, none touching another."""
SAMPLES = 64
SAMPLE_BYTES = 1 << 18


def sampled(size: int, head: int) -> Pieces:
    """The first `head` bytes of a file of `size`, and SAMPLES pieces evenly over the rest, of which one ends it."""
    head = min(head, size)
    ends = np.linspace(head, size, SAMPLES + 1)[1:].astype(int).tolist()
    return joined(((0, head), *((max(0, end - SAMPLE_BYTES), end) for end in ends)))


def joined(pieces: Pieces) -> Pieces:
    """The same bytes in order, what overlaps or touches as one piece."""
    found: list[tuple[int, int]] = []
    for begin, end in sorted(pieces):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        elif end > begin:
            found.append((begin, end))
    return tuple(found)


def bytes_in(pieces: Pieces) -> int:
    """How many bytes they hold."""
    return sum(end - begin for begin, end in pieces)


def share_read(pieces: Pieces, at: int) -> float:
    """The share of their bytes before `at`, 0 to 1."""
    return sum(min(max(at - begin, 0), end - begin) for begin, end in pieces) / bytes_in(pieces)
