"""The undamaged segments of a DataFlash log, without a loop over its messages.

In an undamaged segment every message ends where the next begins. All places where a known header stands are found at
once; where the end of each is the next such place nothing else has to be looked at. Only at the others (the two bytes
of a header happen to stand in one message of a few hundred) is followed where the message ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Ints

HEAD_1, HEAD_2 = 0xA3, 0x95
SEGMENT_BYTES = 1 << 22
IN_A_ROW = 16
"""Messages that follow each other: by chance they never do."""
LOOK, BLOCK = 1 << 13, 1 << 18


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """Messages that follow each other: `place` and `kind` (n,); `stop` is where the next one is due.

    damaged   whether what is due at `stop` needs a closer look; else the segment just ends there
    """

    place: Ints
    kind: npt.NDArray[np.uint8]
    stop: int
    damaged: bool


def chain(data: npt.NDArray[np.uint8], at: int, edge: int, length: Ints) -> Chain:
    """The messages from `at` on, up to the first that begins at `edge` or later, that are followed by a message each.

    `edge` is at most SEGMENT_BYTES further on. `length` (256,) is the whole length of each known kind, 0 of others.
    """
    place, kind = _heads(data, at, edge, length)
    if not len(place) or place[0] != at:
        return Chain(place=place[:0], kind=kind[:0], stop=at, damaged=True)
    end = place + length[kind]
    odd = np.flatnonzero(end[:-1] != place[1:])
    last = len(place) - 1
    true, i, damaged = np.zeros(len(place), dtype=np.bool_), 0, False
    while True:
        stop = int(odd[k]) if (k := int(np.searchsorted(odd, i))) < len(odd) else last
        true[i:stop] = True
        following = int(end[stop])
        after = int(np.searchsorted(place, following))
        filled = bool(np.any(end[stop + 1 : after] == following))
        if after <= last and place[after] == following and not filled:
            true[stop], i = True, after
            continue
        whole = following == len(data) or (following >= edge and _known(data, following, length))
        damaged = filled or not whole
        true[stop] = not damaged
        break
    return Chain(place=place[true], kind=kind[true], stop=int(place[stop]) if damaged else following, damaged=damaged)


def first_message(data: npt.NDArray[np.uint8], at: int, stop: int, length: Ints) -> int:
    """Where, from `at` on, the first of IN_A_ROW messages begins, or of fewer that end the file; `stop` if nowhere."""
    for begin in range(at, stop, LOOK):
        for place in _heads(data, begin, min(begin + LOOK, stop), length)[0].tolist():
            if _followed(data, place, length):
                return int(place)
    return stop


def _followed(data: npt.NDArray[np.uint8], at: int, length: Ints) -> bool:
    for _ in range(IN_A_ROW):
        if not _known(data, at, length):
            return at == len(data)
        at += int(length[data[at + 2]])
    return True


def _heads(data: npt.NDArray[np.uint8], at: int, edge: int, length: Ints) -> tuple[Ints, npt.NDArray[np.uint8]]:
    """Places from `at` to `edge` where a whole message of a known kind can start, and the kinds."""
    found = []
    for begin in range(at, edge, BLOCK):  # small enough to stay near the processor
        part = data[begin : min(begin + BLOCK, edge) + 1]
        head = part[:-1] == HEAD_1
        head &= part[1:] == HEAD_2
        found.append(np.flatnonzero(head) + begin)
    place = np.concatenate(found) if found else np.empty(0, dtype=np.int64)
    place = place[: np.searchsorted(place, len(data) - 2)]
    kind = data[place + 2]
    fits = length[kind] > 0
    last = int(np.searchsorted(place, len(data) - 256))  # further on a message may be cut off
    fits[last:] &= place[last:] + length[kind[last:]] <= len(data)
    return place[fits], kind[fits]


def _known(data: npt.NDArray[np.uint8], at: int, length: Ints) -> bool:
    if at + 3 > len(data) or data[at] != HEAD_1 or data[at + 1] != HEAD_2:
        return False
    return bool(length[data[at + 2]] > 0 and at + length[data[at + 2]] <= len(data))
