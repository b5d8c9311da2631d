"""Places of a DataFlash log's messages: undamaged segments at once, damaged ones with care."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Ints, distinct
from calibration.foundation.compiled import AVAILABLE
from pipeline.telemetry.dataflash.messages.chain import SEGMENT_BYTES, chain, first_message
from pipeline.telemetry.dataflash.messages.doubt import is_whole
from pipeline.telemetry.dataflash.messages.layout import FMT_BYTES, FMT_HEAD, FMT_KIND, Layout, bears_itself_out
from pipeline.telemetry.log.byte_ranges import Pieces, share_read
from pipeline.telemetry.log.mapped_file import Bytes, taken
from pipeline.telemetry.log.tables import Progress

CAREFUL = 256
"""Messages that are read with care from a damage on, before the quick way is tried again."""
NEAR = 16
"""Neighbours on each side that a doubtful message is compared with."""
MOST_JUDGED = 10_000
"""Doubtful messages beyond these are not believed: at half a millisecond each, a file is judged in some seconds."""
AT, CORRUPT, LAST_TIMED, LAST_CORRUPT = 0, 1, 2, 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Where the wanted messages are.

    place, kind, resumed  (n,) of each: first byte, kind, and where the next one stands if it is doubtful, else 0
    counts    (256,) of every kind, doubtful ones left out
    corrupt   how many segments are no message, and `cut` whether the last is one that the end of the file cuts off
    """

    place: Ints
    kind: npt.NDArray[np.uint8]
    resumed: Ints
    counts: Ints
    corrupt: int
    cut: bool


def scan_dataflash(
    data: Bytes, layouts: Mapping[int, Layout], wanted: tuple[str, ...], pieces: Pieces, progress: Progress
) -> Places:
    """Places of the wanted messages in `pieces` of a log, those included that a closer look may not believe.

    A piece is read from the first of its messages that others follow to the last that begins in it.
    """
    length, time_bytes, counts = np.zeros((3, 256), dtype=np.int64)
    listed = np.zeros(256, dtype=np.bool_)
    for kind, layout in layouts.items():
        length[kind], time_bytes[kind] = layout.length, layout.time_bytes
        listed[kind] = layout.readable and (layout.name in wanted or kind == FMT_KIND)
    source = np.frombuffer(data, np.uint8)
    state = np.array([0, 0, -1, -1], dtype=np.int64)
    found: list[tuple[Ints, npt.NDArray[np.uint8], Ints]] = []
    for begin, stop in pieces:
        if state[AT] < begin:
            state[AT] = first_message(source, begin, stop, length)
        while state[AT] < min(stop, len(data) - 2):
            quick = chain(source, int(state[AT]), min(stop, int(state[AT]) + SEGMENT_BYTES), length)
            counts += np.bincount(quick.kind, minlength=256)
            keep = listed[quick.kind]
            found.append((quick.place[keep], quick.kind[keep], np.zeros(int(keep.sum()), dtype=np.int64)))
            timed = np.flatnonzero(time_bytes[quick.kind[::-1]])[:1]
            if len(timed):
                state[LAST_TIMED] = quick.place[-1 - int(timed[0])]
            state[AT] = quick.stop
            if quick.damaged:
                found.append(_with_care(data, source, length, time_bytes, listed, counts, state))
            if progress is not None:
                progress(share_read(pieces, int(state[AT])))
    rest = 0 < len(data) - state[AT] < 3
    corrupt, broken = int(state[CORRUPT]) + int(rest), int(state[AT] if rest else state[LAST_CORRUPT])
    place, kinds, resumed = (np.concatenate(part) for part in zip(*found, strict=True)) if found else _nothing()
    return Places(
        place=place,
        kind=kinds,
        resumed=resumed,
        counts=counts,
        corrupt=corrupt,
        cut=corrupt > 0 and _cut_off(source, broken, length),
    )


def _cut_off(source: npt.NDArray[np.uint8], at: int, length: Ints) -> bool:
    """Whether what begins at `at` is a message of a known kind of which the end of the file leaves less than all."""
    head, left = source[at : at + 3].tolist(), len(source) - at
    return head[:2] == [0xA3, 0x95][:left] and (left < 3 or bool(length[head[2]] > left))


def _nothing() -> tuple[Ints, npt.NDArray[np.uint8], Ints]:
    return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.uint8), np.empty(0, dtype=np.int64)


def _with_care(
    data: Bytes, source: npt.NDArray[np.uint8], length: Ints, time_bytes: Ints, listed: npt.NDArray[np.bool_],
    counts: Ints, state: Ints,
) -> tuple[Ints, npt.NDArray[np.uint8], Ints]:  # fmt: skip
    """Places, kinds and where the next message stands behind doubtful ones, of CAREFUL messages; moves `state` on."""
    from pipeline.telemetry.dataflash.messages.scan import scan_messages  # here, for numba is slow to import

    start, resumed = np.empty((2, CAREFUL), dtype=np.int64)
    kinds = np.empty(CAREFUL, dtype=np.uint8)
    bytes_of = source if AVAILABLE else data
    n = scan_messages(bytes_of, len(data), length, time_bytes, listed, counts, start, kinds, resumed, state)
    return start[:n], kinds[:n], resumed[:n]


def _undefined(head: bytes, layouts: Mapping[int, Layout]) -> bool:
    """Whether a message begins here of a kind whose definition is lost: no garbage, for what stands before it."""
    return head[:2] == FMT_HEAD[:2] and len(head) == 3 and head[2] not in layouts


def judged(source: npt.NDArray[np.uint8], layouts: Mapping[int, Layout], found: Places) -> Places:
    """The messages to believe: all that are not doubtful, and of those the ones that their neighbours bear out."""
    believed = found.resumed == 0
    doubtful = np.flatnonzero(~believed)[:MOST_JUDGED]
    of_kind = {int(k): np.flatnonzero(believed & (found.kind == k)) for k in distinct(found.kind[doubtful])}
    for i in doubtful.tolist():
        at = int(found.place[i])
        if found.kind[i] == FMT_KIND:
            believed[i] = bears_itself_out(source[at : at + FMT_BYTES].tobytes())
            continue
        layout, same = layouts[int(found.kind[i])], of_kind[int(found.kind[i])]
        if _undefined(source[at + layout.length :][:3].tobytes(), layouts):
            believed[i] = True
            continue
        middle = int(np.searchsorted(same, i))
        near = found.place[same[max(0, middle - NEAR) : middle + NEAR]]
        around = taken(source, near, layout.length).view(layout.dtype)
        believed[i] = is_whole(source, at, int(found.resumed[i]), layout, around)
    return replace(
        found,
        place=found.place[believed],
        kind=found.kind[believed],
        resumed=np.zeros(int(believed.sum()), dtype=np.int64),
        counts=found.counts + np.bincount(found.kind[believed & (found.resumed > 0)], minlength=256),
    )
