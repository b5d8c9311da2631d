"""Pictures from the videos on the page: whose they are, what is marked where, and what is said where there are none."""

from __future__ import annotations

import base64
import dataclasses
import re

import pytest

from pipeline.records import Results
from pipeline.report import render_report
from pipeline.report.views.pictures import RING, SIDE, pictures_section
from tests.scenes.report import fake_results, picture_of_nothing


@pytest.fixture(scope="module")
def results() -> Results:
    return fake_results(targets=2, seconds=8)


def text(markup: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", markup)).strip()


def of_kind(results: Results, kind: str) -> Results:
    return dataclasses.replace(results, pictures=tuple(p for p in results.pictures if p.kind == kind))


def test_a_target_is_shown_from_all_cameras_side_by_side(results):
    groups = pictures_section(of_kind(results, "first")).split('class="group"')[1:]
    assert [re.search(r"</i>([^<]*)", g)[1] for g in groups] == ["van", "car red"]
    for group in groups:
        assert re.findall(r'class="what">([^<]*)', group) == ["uav1", "uav2"]
        assert group.count(base64.b64encode(picture_of_nothing()).decode()) == 2


def test_the_fix_is_marked_where_it_is_and_the_solution_beside_it(results):
    one = dataclasses.replace(
        of_kind(results, "outlier").pictures[0], corner_px=(99.5, 199.5), size=(80, 80), zoom=0.5,
        fix_px=(139.5, 299.5), predicted_px=(179.5, 259.5),
    )  # fmt: skip
    markup = pictures_section(dataclasses.replace(results, pictures=(one,))).partition("</ul>")[2]
    unit = SIDE / 80 * 0.5
    solved = re.search(r'd="M([\d.]+) ([\d.]+)A[^"]*" class="mark-solved"', markup)
    assert float(solved[1]) + RING == pytest.approx(80 * unit, abs=0.1)
    assert float(solved[2]) == pytest.approx(60 * unit, abs=0.1)
    way = re.search(r'd="M([\d.]+) ([\d.]+)L[^"]*" class="mark-way"', markup)
    assert (float(way[1]), float(way[2])) == pytest.approx((40 * unit, 100 * unit), abs=0.1)
    reticle = [float(v) for v in re.findall(r"[\d.]+", re.search(r'd="([^"]*)" class="mark-fix"', markup)[1])]
    xs, ys = reticle[::2], reticle[1::2]
    assert (min(xs) + max(xs)) / 2 == pytest.approx(40 * unit, abs=0.1)
    assert (min(ys) + max(ys)) / 2 == pytest.approx(100 * unit, abs=0.1)


def test_outliers_and_losses_stand_with_their_residuals(results):
    markup = re.sub(r"<title>.*?</title>", "", pictures_section(results))
    words = text(markup).replace("\u00a0", " ")
    assert "12 px off, 30.0\u03c3, weight 0.08" in words
    assert words.count("last fix") == words.count("found again") - 1 == 4  # one is the heading
    assert "van in uav1, lost for" in words


def test_a_box_is_drawn_only_on_the_frame_that_a_person_drew_it_on(results):
    def boxes(kind: str) -> int:
        return pictures_section(of_kind(results, kind)).partition("</ul>")[2].count('class="mark-box"')

    assert boxes("first") == 4
    assert boxes("outlier") == boxes("lost") == 0


def test_without_pictures_the_section_is_absent_with_a_word(results):
    page = render_report(dataclasses.replace(results, pictures=(), picture_notes=("No camera has a video.",)))
    assert 'id="pictures"' not in page
    assert 'href="#pictures"' not in page
    assert "No camera has a video." in page.partition('id="tracks"')[2].partition("</section>")[0]


def test_what_is_missing_is_said_below_the_pictures(results):
    page = pictures_section(dataclasses.replace(results, picture_notes=("3 further pictures are left out.",)))
    assert text(page).endswith("3 further pictures are left out.")
