from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.report.charts.axes import Scale, nice_step, round_ticks, span


@given(st.floats(-1e6, 1e6), st.floats(1e-4, 1e7), st.integers(3, 9))
def test_ticks_are_round_inside_and_few(low, width, count):
    ticks = round_ticks(low, low + width, count)
    values = np.array([v for v, _ in ticks])
    step = nice_step(width, count)
    assert f"{step:.0e}"[0] in "125"
    assert np.all(values >= low - 1e-5 * step)
    assert np.all(values <= low + width + 1e-5 * step)
    assert count / 2 - 1 <= len(values) <= 2 * count + 1


def test_tick_labels_have_the_digits_of_their_step():
    assert [w for _, w in round_ticks(-0.3, 0.3, 6)] == [
        "\u22120.3",
        "\u22120.2",
        "\u22120.1",
        "0",
        "0.1",
        "0.2",
        "0.3",
    ]


def test_a_scale_maps_its_ends_and_grows_on_a_logarithm():
    linear = Scale(low=2, high=4, start=100, end=0)
    assert linear.at(2) == 100
    assert linear.at(3) == 50
    log = Scale(low=0.1, high=1000, start=0, end=400, log=True)
    assert log([0.1, 1, 10, 1000]) == pytest.approx([0, 100, 200, 400])
    assert [v for v, _ in log.ticks()] == pytest.approx([0.1, 1, 10, 100, 1000])


def test_a_span_stands_what_data_can_be():
    assert span(np.full(3, np.nan)) == (0.0, 1.0)
    low, high = span(np.array([5.0, 5.0]), least=2.0)
    assert (low, high) == (4.0, 6.0)
    low, high = span(np.array([0.0, np.nan]), np.array([10.0]), pad=0.1)
    assert (low, high) == (-1.0, 11.0)
