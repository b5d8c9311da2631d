from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.report.text.markup import Html, data_script, number, path, specks, tag


def test_plain_text_is_escaped_and_markup_is_not():
    assert tag("p", "<b> & 'c'") == "<p>&lt;b&gt; &amp; &#x27;c&#x27;</p>"
    assert tag("p", tag("b", "x")) == "<p><b>x</b></p>"
    assert isinstance(tag("p"), Html)


def test_attributes_are_escaped_renamed_and_left_out():
    assert tag("i", class_='a"b', aria_label="x<y", hidden=True, title=None) == (
        '<i class="a&quot;b" aria-label="x&lt;y" hidden></i>'
    )


@pytest.mark.parametrize(
    ("value", "words"), [(1.0, "1"), (1.25, "1.25"), (-0.001, "0"), (1234.5, "1234.5"), (-2.999, "-3"), (100.0, "100")]
)
def test_numbers_are_short(value, words):
    assert number(value) == words


def test_a_path_lifts_the_pen_at_nan():
    xy = np.array([[0, 0], [1, 1], [np.nan, 1], [2, 2], [3, 3.04]])
    assert path(xy) == "M0 0L1 1M2 2L3 3"
    assert specks(xy) == "M0 0h0M1 1h0M2 2h0M3 3h0"


def test_data_cannot_leave_its_script():
    name = '</script><script>alert("\u2028")</script>&'
    script = data_script("x", {"name": name})
    inside = script.removeprefix('<script type="application/json" id="x">').removesuffix("</script>")
    assert not set("<>&") & set(inside)
    assert inside.isascii()
    assert json.loads(inside) == {"name": name}


def test_data_refuses_nan():
    with pytest.raises(ValueError):
        data_script("x", [float("nan")])
