"""Flags of gimbals come from logs that define their own messages: what is no number is no flag."""

import numpy as np

from calibration.foundation.arrays import whole_numbers
from pipeline.telemetry.gimbals.frames import EARTH, HEADING, frame_of_flags, states_frame


def test_what_is_no_number_is_no_flag():
    odd = np.array([np.nan, np.inf, -np.inf, 1e300, 1 << 32, 16.0])
    assert whole_numbers(odd).tolist() == [0, 0, 0, 0, 0, 16]
    assert frame_of_flags(odd).tolist() == [HEADING] * 5 + [EARTH]
    assert states_frame(np.array([np.inf, 64.0])).tolist() == [False, True]
