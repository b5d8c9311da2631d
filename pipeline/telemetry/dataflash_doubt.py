"""Whether a DataFlash message behind which garbage stands is whole.

g bytes that belong to no message stand before the next one. Either they were put exactly behind the message, or
somewhere inside it, after its byte o: then its rest stands g bytes further on, and what we read there is garbage. All
places are as likely beforehand, so with p(.) the probability of fields given the messages of the same kind around,

    odds that it is whole = p(fields as they stand) / sum over o of p(fields with the rest from g bytes further on)

where what is no field's byte has probability 1/256 a byte in all cases alike. A number's probability is a Student-t
density about its neighbours, as wide as they scatter, times the step from one number to the next; a text's is that of
being one of its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from calibration.arrays import Floats

ODDS = 9.0
"""A message is believed where it is this much more likely whole than not."""
STRAY = 1e-3
"""Share of a field's values that have nothing to do with their neighbours: modes, counters that wrap, resets."""
HEAD_BYTES = 3


def is_whole(
    data: npt.NDArray[np.uint8],
    at: int,
    resume: int,
    form: np.dtype[np.void],
    numbers: Sequence[str],
    around: npt.NDArray[np.void],
) -> bool:
    """Whether the message of layout `form` at `at` is whole, the next one standing at `resume`.

    `numbers` names the fields that are numbers; `around` (k,) holds messages of the same kind near it, in their order.
    """
    size = form.itemsize
    garbage = resume - at - size
    if not len(around):
        return False
    cases = np.repeat(data[None, at : at + size], size - HEAD_BYTES + 1, axis=0)  # row 0 as it stands
    for row, o in enumerate(range(HEAD_BYTES, size), start=1):
        cases[row, o:] = data[at + o + garbage : at + size + garbage]
    log_p = np.zeros(len(cases))
    fields = cases.view(form)[:, 0]
    for name in form.names[1:]:
        log_p += _number(fields[name], around[name]) if name in numbers else _text(fields[name], around[name])
    against = log_p[1:] - log_p[0]
    return bool(np.sum(np.exp(np.minimum(against, 50.0))) * ODDS < 1.0)


def _number(value: npt.NDArray[np.generic], near: npt.NDArray[np.generic]) -> Floats:
    """log p of each value (n,), given its neighbours (k,) in order."""
    bits = 8 * value.dtype.itemsize
    x, them = value.astype(float), near.astype(float)
    them = them[np.isfinite(them)]
    blind = np.full(len(x), -bits * np.log(2.0))
    if not len(them):
        return blind
    step = _step(x, value.dtype)
    with np.errstate(over="ignore", invalid="ignore"):
        jump = np.abs(np.diff(them)) if len(them) > 1 else np.array([0.0])
        scale = max(float(np.median(jump)), 0.25 * float(np.mean(jump)), 0.3 * float(np.min(_step(them, value.dtype))))
        middle = them[(len(them) - 1) // 2 : len(them) // 2 + 1]
        away = np.min(np.abs(x[:, None] - middle), axis=1) / scale
        density = 0.375 / scale * step / (1.0 + away**2 / 4.0) ** 2.5  # Student-t of 4
        p = np.where(np.isfinite(x), np.minimum(density, 1.0), 0.0)
        seen = np.mean(x[:, None] == them, axis=1)
    return np.asarray(np.log((1 - STRAY) * (0.5 * p + 0.5 * seen) + STRAY * np.exp(blind)))


def _step(value: Floats, dtype: np.dtype[np.generic]) -> Floats:
    """From each value (n,) to the next that the type can hold."""
    if dtype.kind != "f":
        return np.ones(len(value))
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.abs(np.spacing(value.astype(dtype))), float)


def _text(value: npt.NDArray[np.generic], near: npt.NDArray[np.generic]) -> Floats:
    """log p of each value (n, ...), given its neighbours (k, ...)."""
    flat, them = (np.ascontiguousarray(a).reshape(len(a), -1).view(np.uint8) for a in (value, near))
    seen = np.mean(np.all(flat[:, None] == them[None], axis=2), axis=1)
    return np.asarray(np.log((1 - STRAY) * seen + STRAY * np.exp(-8.0 * flat.shape[1] * np.log(2.0)) + 1e-300))
