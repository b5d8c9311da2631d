"""One clock against another.

Two clocks a, b that both run steadily: b = b0 + rate * (a - a0). Robustly: the offset is the median of b - a, pairs
further from it than the tolerance are outliers, the rest decides offset and rate by least squares.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.log.flight_log import ClockModel

LARGEST_STEP_S = 60.0
MAX_DRIFT = 2e-3
"""No quartz is worse; a larger slope is noise of a short log."""


def settled(time_s: Floats) -> Floats:
    """Times (n,) of messages in the order of the file, NaN where a time is a minute off from all around it."""
    if len(time_s) < 5:
        return time_s
    sevens = np.lib.stride_tricks.sliding_window_view(np.pad(time_s, 3, mode="edge"), 7)
    around = np.partition(sevens, 3, axis=1)[:, 3]
    return np.where(np.abs(time_s - around) < LARGEST_STEP_S, time_s, np.nan)


def fit_clock(
    source: str, log_s: Floats, other_s: Floats, *, tolerance_s: float = 1.0, floor_s: float = 0.0
) -> ClockModel | None:
    """The `other` clock against log time from pairs of readings (n,); None where no majority of them agrees.

    `tolerance_s` separates readings from lies; `floor_s` is the least sigma that the source deserves.
    """
    use = np.isfinite(log_s) & np.isfinite(other_s)
    if not use.any():
        return None
    log, other = (log_s, other_s) if use.all() else (log_s[use], other_s[use])
    log_epoch, epoch = float(np.median(log)), float(np.median(other))
    since = log - log_epoch
    late = other - epoch - since
    offset, rate = float(np.median(late)), 1.0
    good = np.abs(late - offset) < tolerance_s + MAX_DRIFT * np.abs(since)
    if 2 * good.sum() <= len(good):
        return None
    if not good.all():
        since, late = since[good], late[good]
    if len(late) >= 10 and np.ptp(since) > 30.0:
        centred = since - since.mean()
        slope = float(centred @ late / (centred @ centred))
        rate = 1.0 + slope if abs(slope) < MAX_DRIFT else 1.0
    late -= (rate - 1.0) * since
    offset = float(np.median(late))
    scatter = 1.4826 * float(np.median(np.abs(late - offset)))
    return ClockModel(
        source=source,
        epoch_s=epoch + offset,
        log_epoch_s=log_epoch,
        rate=rate,
        sigma_s=max(scatter, floor_s),
        pairs=len(late),
        outliers=len(good) - len(late),
    )
