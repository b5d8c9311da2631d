"""Garbage at the end of a DataFlash file: nothing behind it is looked at."""

import numpy as np
import pytest

from pipeline.telemetry.dataflash.messages.scan import broken_header


@pytest.mark.parametrize("span", [1, 2])
def test_a_header_has_no_room_before_the_end(span):
    plain = getattr(broken_header, "py_func", broken_header)  # compiled code does not say that it reads too far
    length = np.zeros(256, dtype=np.int64)
    length[128] = 89
    assert not plain(bytes(span), 0, span, length)
