"""Whether a DataFlash message behind which garbage stands is whole.

g bytes that belong to no message stand before the next one. Either they were put exactly behind the message, or
somewhere inside it, after its byte o: then its rest stands g bytes further on, and what we read there is garbage. All
places are as likely beforehand. With p(.) the probability of a message's fields given those of its kind around it, and
1/256 for each byte of garbage, the odds of whole against broken at o, w = size - o bytes before the end, are

    p(as it stands) / p(with the rest from g bytes further on)  +  DOUBLE p(as it stands) / p(its first o bytes) 256^w

the second term for a whole message whose follower was hit too, so that a rest stands further on all the same. A
number's probability is a Student-t density about its neighbours, as wide as they scatter, times the step from one
number to the next; a text's is that of being one of its neighbours.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats
from pipeline.telemetry.dataflash.messages.layout import LETTERS, Layout

ODDS = 9.0
"""A message is believed where it is this much more likely whole than not."""
DOUBLE = 1e-2
"""How likely a second damage is in the message that follows."""
STRAY = 1e-3
"""Share of a field's values that have nothing to do with their neighbours: modes, counters that wrap, resets."""
HEAD_BYTES = 3


def is_whole(
    data: npt.NDArray[np.uint8],
    at: int,
    resume: int,
    layout: Layout,
    around: npt.NDArray[np.void],
) -> bool:
    """Whether the message of this layout at `at` is whole, the next one standing at `resume`.

    `around` (k,) holds messages of the same kind near it, in their order.
    """
    size, numbers = layout.length, layout.numbers
    garbage = resume - at - size
    if not len(around):
        return False
    cases = np.repeat(data[None, at : at + size], size - HEAD_BYTES + 1, axis=0)  # row 0 as it stands
    for row, o in enumerate(range(HEAD_BYTES, size), start=1):
        cases[row, o:] = data[at + o + garbage : at + size + garbage]
    fields = cases.view(layout.dtype)[:, 0]
    told = _numbers(fields, around, numbers)
    log_p = np.stack([told[n] if n in told else _text(fields[n], around[n]) for n in layout.fields])
    whole, broken = log_p[:, 0].sum(), log_p[:, 1:].sum(axis=0)
    widths = [np.dtype(LETTERS[letter]).itemsize for letter in layout.letters]
    begins = HEAD_BYTES + np.concatenate([[0], np.cumsum(widths)])
    before = np.concatenate([[0.0], np.cumsum(log_p[:, 0])])
    field = np.searchsorted(begins, np.arange(HEAD_BYTES, size), side="right") - 1  # the one with byte o
    cut = before[field] - (size - begins[field]) * np.log(256.0)
    odds = np.logaddexp(whole - broken, whole - cut + np.log(DOUBLE))
    other = np.any(cases[1:] != cases[0], axis=1)  # where it would read the same it does not matter
    return bool(np.sum(np.exp(-np.maximum(odds[other], -50.0))) * ODDS < 1.0)


def _numbers(fields: npt.NDArray[np.void], around: npt.NDArray[np.void], names: tuple[str, ...]) -> dict[str, Floats]:
    """log p of each value (n,) of the named fields, given their neighbours (k,) in order; NaN there is left out."""
    types = [fields.dtype[name] for name in names]
    with np.errstate(invalid="ignore"):  # signalling NaNs
        x, them = (
            np.array([a[name].astype(float) for name in names]).reshape(len(names), len(a)) for a in (fields, around)
        )
    said = np.isfinite(them)
    found = {}
    for number in np.flatnonzero(~said.all(axis=1)).tolist():
        found[names[number]] = _log_p(x[[number]], them[[number]][:, said[number]], [types[number]])[0]
    rest = np.flatnonzero(said.all(axis=1))
    log_p = _log_p(x[rest], them[rest], [types[i] for i in rest.tolist()])
    return found | {names[i]: row for i, row in zip(rest.tolist(), log_p, strict=True)}


def _log_p(x: Floats, them: Floats, types: list[np.dtype[np.generic]]) -> Floats:
    """log p of values (f, n) of fields of these types, given neighbours (f, k)."""
    blind = np.array([-8.0 * kind.itemsize * np.log(2.0) for kind in types])[:, None]
    many = them.shape[1]
    if not x.size or not many:
        return np.broadcast_to(blind, x.shape)
    step = _steps(x, types)
    with np.errstate(over="ignore", invalid="ignore"):
        jump = np.abs(np.diff(them, axis=1)) if many > 1 else np.zeros((len(x), 1))
        least = 0.3 * np.min(_steps(them, types), axis=1)
        scale = np.maximum(np.maximum(np.median(jump, axis=1), 0.25 * np.mean(jump, axis=1)), least)[:, None]
        middle = them[:, (many - 1) // 2 : many // 2 + 1]
        away = np.min(np.abs(x[:, :, None] - middle[:, None]), axis=2) / scale
        density = 0.375 / scale * step / (1.0 + away**2 / 4.0) ** 2.5  # Student-t of 4
        p = np.where(np.isfinite(x), np.minimum(density, 1.0), 0.0)
        seen = np.mean(x[:, :, None] == them[:, None], axis=2)
    return np.asarray(np.log((1 - STRAY) * (0.5 * p + 0.5 * seen) + STRAY * np.exp(blind)))


def _steps(value: Floats, types: list[np.dtype[np.generic]]) -> Floats:
    """From each value (f, n) to the next that its field's type can hold."""
    step = np.ones(value.shape)
    for kind in {kind for kind in types if kind.kind == "f"}:
        rows = [i for i, own in enumerate(types) if own == kind]
        with np.errstate(invalid="ignore", over="ignore"):
            step[rows] = np.abs(np.spacing(value[rows].astype(kind)))
    return step


def _text(value: npt.NDArray[np.generic], near: npt.NDArray[np.generic]) -> Floats:
    """log p of each value (n, ...), given its neighbours (k, ...)."""
    flat, them = (np.ascontiguousarray(a).reshape(len(a), -1).view(np.uint8) for a in (value, near))
    seen = np.mean(np.all(flat[:, None] == them[None], axis=2), axis=1)
    return np.asarray(np.log((1 - STRAY) * seen + STRAY * np.exp(-8.0 * flat.shape[1] * np.log(2.0)) + 1e-300))
