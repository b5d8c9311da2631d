"""Arrays as records hold them: float64, checked once, read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Floats1 = npt.NDArray[np.float64]
"""The same, with the number of its axes said: compiled functions that Python calls say it of every array."""
Floats2 = npt.NDArray[np.float64]
Floats3 = npt.NDArray[np.float64]
Floats4 = npt.NDArray[np.float64]
Ints1 = npt.NDArray[np.int64]
Ints2 = npt.NDArray[np.int64]
Bools2 = npt.NDArray[np.bool_]


def frozen(value: npt.ArrayLike, shape: tuple[int | None, ...], name: str, dtype: Any = np.float64) -> Any:
    """A read-only copy of `value` as `dtype`; None in `shape` allows any length.

    Raises ValueError where the shape does not fit: a programmer's mistake, not a user's.
    """
    array = np.array(value, dtype=dtype)
    if array.ndim != len(shape) or any(
        want is not None and have != want for have, want in zip(array.shape, shape, strict=True)
    ):
        raise ValueError(f"{name}: shape {array.shape}, expected {tuple('n' if s is None else s for s in shape)}")
    array.setflags(write=False)
    return array


def settle(record: object, **values: object) -> None:
    """Set fields of a frozen dataclass; for its own `__post_init__` only."""
    for name, value in values.items():
        object.__setattr__(record, name, value)


def whole_numbers(values: Floats) -> Ints:
    """Flags, states and numbers of things (n,), read from elsewhere: what is no number, or beyond 32 bits, is 0."""
    return np.where(np.abs(values) < 1 << 32, values, 0.0).astype(np.int64)


def distinct(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The different values of some (n,) in order, NaN left out.

    np.unique, as np.median, would import numpy's masked arrays first: 30 ms of a command's start.
    """
    ordered = np.sort(values[values == values])
    return ordered[np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])[: len(ordered)])]


def median(values: Floats) -> float:
    """The median of some numbers (n,), of none NaN; NaN where one of them is."""
    last, half = len(values) - 1, len(values) // 2
    if last < 0:
        return float("nan")
    parted = np.partition(values, [max(half - 1, 0), half, last])
    if np.isnan(parted[last]):
        return float("nan")
    return float(parted[half] if last % 2 == 0 else (parted[half - 1] + parted[half]) / 2)
