"""Definitions of DataFlash messages that damage left without a part."""

import pytest

from pipeline.telemetry.dataflash.messages.layout import Layout


@pytest.mark.parametrize(
    ("fields", "letters", "size"),
    [(("TimeUS", "X"), "Qf", 8), (("TimeMS",), "I", 4), (("TimeUS",), "", 0), ((), "Q", 0), (("TimeUS",), "I", 0)],
)
def test_whether_a_message_begins_with_a_time(fields, letters, size):
    assert Layout(kind=1, name="X", length=9, letters=letters, fields=fields).time_bytes == size
