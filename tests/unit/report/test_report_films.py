"""Frames beside the slider, and the ground under the maps."""

from __future__ import annotations

import base64
import dataclasses
import json
import re

import pytest

from pipeline.report import render_report
from tests.scenes.report import fake_results, with_films


@pytest.fixture(scope="module")
def results():
    return with_films(fake_results(seconds=8))


def test_every_frame_is_in_the_page_with_its_moment_and_marks(results):
    page = render_report(results)
    told = json.loads(re.search(r'id="films">([^<]*)<', page)[1])
    assert [film["camera"] for film in told] == ["uav1", "uav2"]
    for film, own in zip(told, results.films, strict=True):
        assert film["frame"] == list(own.frame)
        assert film["t"] == pytest.approx(own.time_s, abs=1e-3)
        assert [base64.b64decode(src) for src in film["src"]] == list(own.jpeg)
        name, colour, x, y = film["marks"][0][0]
        assert (name, colour) == (own.marks[0][0][0], 0)
        assert (x, y) == pytest.approx((own.marks[0][0][1] * 160, own.marks[0][0][2] * 90), abs=0.06)
    assert page.count('class="film"') == 2


def test_the_ground_lies_where_the_map_is(results):
    page = render_report(results)
    grounds = re.findall(r'<image href="data:image/webp[^>]*>', page)
    assert len(grounds) == len(results.ground_pictures) == page.count('class="map"')
    for ground in grounds:
        x, y, wide = (float(re.search(rf'{name}="([^"]*)"', ground)[1]) for name in (" x", " y", "width"))
        assert (x, y, wide) == pytest.approx((0, 0, 960), abs=0.01)
    assert "The ground is made of stripes." in page


def test_a_ground_made_for_another_map_is_not_shown(results):
    other = tuple(dataclasses.replace(g, west_m=g.west_m + 1) for g in results.ground_pictures)
    assert "image/webp" not in render_report(dataclasses.replace(results, ground_pictures=other))


def test_without_films_nothing_stands_in_their_place():
    page = render_report(fake_results(seconds=4))
    assert 'class="film"' not in page
    assert 'id="ground"' not in page
