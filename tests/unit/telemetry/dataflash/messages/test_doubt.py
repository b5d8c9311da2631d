"""Judging doubtful DataFlash messages: fields together are what each is alone, whatever they are."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.telemetry.dataflash.messages.doubt import _numbers, is_whole
from pipeline.telemetry.dataflash.messages.layout import Layout


def layout(letters: str) -> Layout:
    fields = tuple(f"F{i}" for i in range(len(letters)))
    made = Layout(kind=1, name="X", length=0, letters=letters, fields=fields)
    return Layout(kind=1, name="X", length=made.dtype.itemsize, letters=letters, fields=fields)


@pytest.mark.parametrize("seed", range(5))
def test_fields_together_are_each_alone(seed):
    rng, form = np.random.default_rng(seed), layout("QbHifgdNZ")
    around, cases = (np.frombuffer(rng.bytes(n * form.length), form.dtype) for n in (31, 50))  # NaN among them
    around = around.copy()
    around["F6"], around["F5"] = np.nan, 1.0
    together = _numbers(cases, around, form.numbers)
    assert list(form.numbers) == sorted(together)
    for name in form.numbers:
        np.testing.assert_array_equal(_numbers(cases, around, (name,))[name], together[name])
    np.testing.assert_allclose(together["F6"], -64 * np.log(2.0))  # nothing around it says anything


@pytest.mark.parametrize("letters", ["N", "QN", "Q"])
def test_a_message_like_those_around_it_is_whole_before_garbage_and_noise_is_not(letters):
    form, rng = layout(letters), np.random.default_rng(1)
    around = np.zeros(32, form.dtype)
    for name, letter in form.members:
        around[name] = b"steady" if letter == "N" else 1000 * np.arange(32)
    own = np.frombuffer(around[15].tobytes(), np.uint8)
    garbage = rng.integers(0, 256, 60, dtype=np.uint8)
    assert is_whole(np.concatenate([own, garbage]), 0, form.length + 20, form, around)
    assert not is_whole(np.concatenate([garbage, garbage]), 0, form.length + 20, form, around)
    assert not is_whole(np.concatenate([own, garbage]), 0, form.length + 20, form, around[:0])
