"""Where the messages of a damaged segment of a DataFlash log are.

A message is A3 95 kind payload; its length follows from its kind. There is no checksum, so a message is believed
where another message follows it, or one whose header has a single wrong bit or garbage in it, or one that the end of
the file cuts off. Where other garbage follows it is listed as doubtful: its bytes have to tell (`dataflash_doubt`). Not
believed is one whose last bytes are another message, whole: it was cut off, and what came next happened to fill it up.
Reading starts again where two messages follow each other, or where one carries a time within TIME_SPAN_US of the last.
Numba compiles this file: everything is a bare array.
"""

from __future__ import annotations

from typing import Any

from calibration.foundation.compiled import loop

HEAD_1, HEAD_2 = 0xA3, 0x95
TIME_SPAN_US = 10_000_000
AT, CORRUPT, LAST_TIMED, LAST_CORRUPT = 0, 1, 2, 3


@loop
def known_at(data: Any, size: int, at: int, length: Any) -> bool:
    """Whether a whole message of a known kind can start at `at`."""
    if at + 3 > size or data[at] != HEAD_1 or data[at + 1] != HEAD_2:
        return False
    return bool(length[data[at + 2]] > 0 and at + length[data[at + 2]] <= size)


@loop
def time_us(data: Any, at: int, time_bytes: Any) -> int:
    """The time that a message starts with, microseconds: 8 bytes of them, or 4 of milliseconds; else -1."""
    width = time_bytes[data[at + 2]]
    value = 0
    for i in range(width):
        value += int(data[at + 3 + i]) << (8 * i)
    if width == 0 or value < 0:
        return -1
    return value if width == 8 else value * 1000


@loop
def next_message(data: Any, size: int, at: int, length: Any, time_bytes: Any, last_us: int) -> int:
    """First place from `at` on that can be believed to start a message; `size` if none."""
    while at + 3 <= size:
        if known_at(data, size, at, length):
            end = at + length[data[at + 2]]
            if end == size or known_at(data, size, end, length):
                return at
            time = time_us(data, at, time_bytes)
            if last_us >= 0 and time >= 0 and abs(time - last_us) < TIME_SPAN_US:
                return at
        at += 1
    return size


@loop
def one_bit(value: int) -> bool:
    """Whether exactly one bit is set."""
    return value != 0 and value & (value - 1) == 0


@loop
def broken_header(data: Any, at: int, span: int, length: Any) -> bool:
    """Whether one wrong bit in its header hides a message of `span` bytes at `at`."""
    if span < 3:  # no room for a header: what stands behind may be the end of the file
        return False
    first, second, kind = int(data[at]) ^ HEAD_1, int(data[at + 1]) ^ HEAD_2, int(data[at + 2])
    if first == 0 and second == 0:
        for bit in range(8):  # noqa: SIM110 - numba compiles no generators
            if length[kind ^ (1 << bit)] == span:
                return True
        return False
    return one_bit(first << 8 | second) and length[kind] == span


@loop
def parted_header(data: Any, at: int, resume: int, length: Any) -> bool:
    """Whether garbage stands inside the header of a message at `at` whose end is at `resume`, where the next begins."""
    if data[at] != HEAD_1:
        return False
    for k in range(256):
        if length[k] > 3 and resume - length[k] > at:
            kind = resume - length[k] + 2
            if data[kind] == k and (data[at + 1] == HEAD_2 or data[kind - 1] == HEAD_2):
                return True
    return False


@loop
def filled_up(data: Any, at: int, end: int, size: int, length: Any) -> int:
    """Where in the message from `at` to `end` another begins that ends with it; 0 where none does."""
    heads = 0
    for i in range(at + 3, end - 3):  # all of it, for a loop that may stop early is not vectorised
        heads |= (data[i] == HEAD_1) & (data[i + 1] == HEAD_2)
    if heads:
        for i in range(at + 3, end - 3):
            if known_at(data, size, i, length) and i + length[data[i + 2]] == end:
                return i
    return 0


@loop
def cut_off(data: Any, size: int, at: int, length: Any) -> bool:
    """Whether a message begins at `at` that the end of the file cuts off."""
    left = size - at
    if left <= 0 or data[at] != HEAD_1:
        return left <= 0
    if left == 1:
        return True
    if data[at + 1] != HEAD_2:
        return False
    return left == 2 or length[data[at + 2]] > left


@loop
def scan_messages(
    data: Any, size: int, length: Any, time_bytes: Any, wanted: Any, counts: Any,
    start: Any, kinds: Any, resumed: Any, state: Any,
) -> int:  # fmt: skip
    """Places of the `wanted` kinds from state[AT] on, as many as fit into `start` and `kinds`; returns how many.

    data        (size,) bytes
    length      (256,) whole length of each known kind, 0 of unknown ones
    time_bytes  (256,) 8 where a kind starts with microseconds, 4 with milliseconds, else 0
    wanted      (256,) true for kinds to list
    counts      (256,) is added to, for every kind
    resumed     like `start`: 0, or for a doubtful message, which is not counted, where the next one begins
    state       (4,) where to go on, how many segmentes were no message, the last message with a time and the last
                such segment, or -1
    """
    at, corrupt, timed, broken = state[AT], state[CORRUPT], state[LAST_TIMED], state[LAST_CORRUPT]
    found, room = 0, len(start)
    known = known_at(data, size, at, length)
    while at + 3 <= size and found < room:
        kind, doubtful = data[at + 2], 0
        following = at + length[kind] if known else at + 1
        known_next = following < size and known_at(data, size, following, length)
        inside = filled_up(data, at, following, size, length) if known and known_next else 0
        if inside:
            known, following, known_next = False, inside, True
        elif known and not known_next and not cut_off(data, size, following, length):  # no message: is this one?
            last_us = time_us(data, timed, time_bytes) if timed >= 0 else -1
            resume = next_message(data, size, at + 3, length, time_bytes, last_us)
            known = resume > following and (
                broken_header(data, following, resume - following, length)
                or parted_header(data, following, resume, length)
            )
            doubtful = resume if not known and resume > following else 0
            following = following if known else resume
            known_next = not known and resume < size
        elif not known:
            last_us = time_us(data, timed, time_bytes) if timed >= 0 else -1
            following = next_message(data, size, at + 1, length, time_bytes, last_us)
            known_next = following < size
        if known:
            counts[kind] += 1
            timed = at if time_bytes[kind] > 0 else timed
        else:
            corrupt += 1
            broken = at
        if (known or doubtful) and wanted[kind]:
            start[found], kinds[found], resumed[found] = at, kind, doubtful
            found += 1
        at, known = following, known_next
    state[AT], state[CORRUPT], state[LAST_TIMED], state[LAST_CORRUPT] = at, corrupt, timed, broken
    return found
