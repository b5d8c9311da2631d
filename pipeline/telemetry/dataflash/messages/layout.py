"""What a DataFlash log says about its own messages.

FMT (kind 128) names kind, length, name, a letter per field and the fields' names; a definition that differs from an
earlier one holds for what comes after it. Letters c, C, e, E are hundredths and L is 1e-7 degrees; values are scaled by
division, as ArduPilot's tools do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.telemetry.log.mapped_file import Bytes

LETTERS = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "g": "<f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "d": "<f8",
    "M": "i1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
DIVISOR = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
FMT_KIND, FMT_BYTES, FMT_HEAD = 128, 89, b"\xa3\x95\x80"
HEAD_BYTES = 3
CHUNK = 1 << 20
TRIED = 64
"""Messages that are asked for their length where a definition contradicts itself."""


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
    def letters_bytes(self) -> int:
        """What its letters take, header included; 0 where one is unknown or fields and letters do not match."""
        if not len(self.letters) == len(self.fields) == len(set(self.fields)) or not set(self.letters) <= set(LETTERS):
            return 0
        return HEAD_BYTES + sum(np.dtype(LETTERS[letter]).itemsize for letter in self.letters)

    @property
    def readable(self) -> bool:
        """Whether its fields can be read: they fit into its declared length."""
        return 0 < self.letters_bytes <= self.length

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The whole message of the declared length, header included; what the letters leave is padding."""
        form = np.dtype([("head", "S3"), *((name, LETTERS[letter]) for name, letter in self.members)])
        if form.itemsize >= self.length:
            return form
        assert form.names is not None
        assert form.fields is not None
        return np.dtype(
            {
                "names": list(form.names),
                "formats": [form.fields[name][0] for name in form.names],
                "offsets": [form.fields[name][1] for name in form.names],
                "itemsize": self.length,
            }
        )

    @property
    def numbers(self) -> tuple[str, ...]:
        """Fields that are single numbers, neither texts nor arrays."""
        return tuple(name for name, letter in self.members if letter not in "nNZa")

    @property
    def time_bytes(self) -> int:
        """8 where the message starts with microseconds since boot, 4 with milliseconds, else 0."""
        first = (self.fields[0] if self.fields else "", self.letters[:1])
        return {("TimeUS", "Q"): 8, ("TimeMS", "I"): 4}.get(first, 0)


def layouts_of(data: Bytes, *, upto: int) -> dict[int, Layout]:
    """Every kind that the first `upto` bytes define; the first definition that can be read holds."""
    found: dict[int, Layout] = {}
    for begin in range(0, min(upto, len(data)), CHUNK):
        part = data[begin : begin + CHUNK + FMT_BYTES - 1]
        at = part.find(FMT_HEAD, 0, CHUNK + 2)
        while at >= 0:
            layout = layout_of(data, part[at : at + FMT_BYTES])
            if layout is not None and not (layout.kind in found and found[layout.kind].readable):
                found[layout.kind] = layout
            at = part.find(FMT_HEAD, at + 3, CHUNK + 2)
    return found


def layout_of(data: Bytes, message: bytes) -> Layout | None:
    """What one FMT of a log defines; None for a broken one.

    Where length and letters disagree the messages of its kind tell which of the two is true: the one at which the next
    message stands. The declared length is stepped over even if its letters do not fit; where no message tells, the
    definition is broken.
    """
    if len(message) < FMT_BYTES:
        return None
    kind, length = message[3], message[4]
    name, letters, fields = (  # up to the first zero: what stands behind it is no text
        part.split(b"\0")[0].decode("latin-1") for part in (message[5:9], message[9:25], message[25:89])
    )
    layout = Layout(kind=kind, name=name, length=length, letters=letters, fields=tuple(fields.split(",")))
    if not (name.isascii() and name.isalnum()) or not all(layout.fields) or length < HEAD_BYTES:
        return None
    told = layout.letters_bytes
    if told == length:
        return layout
    declared, by_letters = (_followed(data, kind, bytes_) for bytes_ in (length, told))
    if by_letters > declared:
        return replace(layout, length=told)
    return layout if declared else None


def bears_itself_out(message: bytes) -> bool:
    """Whether an FMT is whole by what it says: printable text, and a length that its letters come to."""
    layout = layout_of(b"", message)
    return layout is not None and layout.letters_bytes == layout.length and all(map(str.isprintable, layout.fields))


def _followed(data: Bytes, kind: int, length: int) -> int:
    """How many of the first messages of a kind would be followed by another message if they had this length."""
    head, found, at = bytes([*FMT_HEAD[:2], kind]), 0, 0
    for _ in range(TRIED if length else 0):
        at = data.find(head, at)
        if at < 0:
            break
        found += data[at + length : at + length + 2] == FMT_HEAD[:2]
        at += HEAD_BYTES
    return found


def is_damage(before: bytes, after: bytes) -> bool:
    """Whether a definition differs from an earlier one only as a damaged one would: by a bit or two."""
    differ = int.from_bytes(before, "big") ^ int.from_bytes(after, "big")
    return differ.bit_count() <= 2
