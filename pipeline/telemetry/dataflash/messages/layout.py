"""What a DataFlash log says about its own messages.

FMT (kind 128) names kind, length, name, a letter per field and the fields' names. Letters c, C, e, E are hundredths
and L is 1e-7 degrees; values are scaled by division, as ArduPilot's tools do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.telemetry.log.mapped_file import Bytes

LETTERS = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "g": "<f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "d": "<f8",
    "M": "i1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
DIVISOR = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
FMT_KIND, FMT_BYTES, FMT_HEAD = 128, 89, b"\xa3\x95\x80"
CHUNK = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How one kind of message is laid out."""

    kind: int
    name: str
    length: int
    letters: str
    fields: tuple[str, ...]

    @property
    def members(self) -> list[tuple[str, str]]:
        """Fields and their letters."""
        return list(zip(self.fields, self.letters, strict=True))

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The whole message, header included."""
        return np.dtype([("head", "S3"), *((name, LETTERS[letter]) for name, letter in self.members)])

    @property
    def numbers(self) -> tuple[str, ...]:
        """Fields that are single numbers, neither texts nor arrays."""
        return tuple(name for name, letter in self.members if letter not in "nNZa")

    @property
    def time_bytes(self) -> int:
        """8 where the message starts with microseconds since boot, 4 with milliseconds, else 0."""
        first = (self.fields[0], self.letters[0]) if self.fields else ("", "")
        return {("TimeUS", "Q"): 8, ("TimeMS", "I"): 4}.get(first, 0)


def layouts_of(data: Bytes, *, upto: int) -> dict[int, Layout]:
    """Every kind that the first `upto` bytes define consistently; the first definition holds."""
    found: dict[int, Layout] = {}
    for begin in range(0, min(upto, len(data)), CHUNK):
        part = data[begin : begin + CHUNK + FMT_BYTES - 1]
        at = part.find(FMT_HEAD, 0, CHUNK + 2)
        while at >= 0:
            layout = _layout(part[at : at + FMT_BYTES])
            if layout is not None:
                found.setdefault(layout.kind, layout)
            at = part.find(FMT_HEAD, at + 3, CHUNK + 2)
    return found


def _layout(message: bytes) -> Layout | None:
    """What one FMT defines; None where it contradicts itself (a broken one)."""
    if len(message) < FMT_BYTES:
        return None
    kind, length = message[3], message[4]
    try:
        name, letters, fields = (
            part.rstrip(b"\0").decode("ascii") for part in (message[5:9], message[9:25], message[25:89])
        )
        layout = Layout(kind=kind, name=name, length=length, letters=letters, fields=tuple(fields.split(",")))
        named = name.isalnum() and all(layout.fields)
        return layout if named and layout.dtype.itemsize == length else None
    except (UnicodeDecodeError, KeyError, ValueError):
        return None
