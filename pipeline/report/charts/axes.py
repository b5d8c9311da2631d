"""Scales with round ticks: data units to pixels of a drawing, linear or logarithmic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats
from pipeline.report.text.words import MINUS, NARROW


@dataclass(frozen=True, kw_only=True)
class Scale:
    """low .. high in data units onto start .. end in pixels."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, values: npt.ArrayLike) -> Floats:
        """Pixels of `values`."""
        at = np.asarray(values, float)
        low, high = self.low, self.high
        if self.log:
            at, low, high = np.log10(np.maximum(at, low * 1e-3)), math.log10(low), math.log10(high)
        return np.asarray(self.start + (at - low) / (high - low) * (self.end - self.start))

    def at(self, value: float) -> float:
        """Pixel of one value."""
        return float(self(value))

    def ticks(self, count: int = 5) -> list[tuple[float, str]]:
        """Round values inside with their labels, about `count` of them."""
        return _log_ticks(self.low, self.high) if self.log else round_ticks(self.low, self.high, count)


def nice_step(span: float, count: int) -> float:
    """The step of 1, 2 or 5 times a power of ten that divides `span` into about `count` parts."""
    raw = math.log10(span / max(count, 1))
    power = 10.0 ** math.floor(raw)
    return min((m * power for m in (1, 2, 5, 10)), key=lambda step: abs(math.log10(step) - raw))


def round_ticks(low: float, high: float, count: int = 5, step: float = 0.0) -> list[tuple[float, str]]:
    """Multiples of `step`, or of a nice one, within low .. high, labelled."""
    step = step or nice_step(high - low, count)
    places = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    return [(i * step, tick_words(i * step, places)) for i in range(first, last + 1)]


def tick_words(value: float, places: int) -> str:
    """A tick's label; far from one, as a power of ten."""
    if value and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("-", MINUS)
    words = f"{value:,.{places}f}".replace(",", NARROW)
    return "0" if float(f"{value:.{places}f}") == 0 else words.replace("-", MINUS)


def _log_ticks(low: float, high: float) -> list[tuple[float, str]]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = last - first
    parts = (1, 2, 5) if decades <= 1 else (1,)
    every = max(1, math.ceil(decades / 6))
    values = [m * 10.0**p for p in range(first, last + 1, every) for m in parts]
    return [
        (v, tick_words(v, max(0, -math.floor(math.log10(v) + 1e-9))))
        for v in values
        if low * 0.9999 <= v <= high * 1.0001
    ]


def span(*values: npt.ArrayLike, pad: float = 0.06, least: float = 1e-9) -> tuple[float, float]:
    """Range of all finite values with a margin of `pad` on both sides; never empty."""
    arrays = [np.asarray(v, float).ravel() for v in values]
    pool = np.concatenate([np.zeros(0), *arrays])
    pool = pool[np.isfinite(pool)]
    if not len(pool):
        return 0.0, 1.0
    low, high = float(pool.min()), float(pool.max())
    middle, half = (low + high) / 2, (high - low) / 2
    half = max(half * (1 + 2 * pad), least / 2, abs(middle) * 1e-9, 1e-12)
    return middle - half, middle + half
