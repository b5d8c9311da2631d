import re
from html.parser import HTMLParser

import pytest

from calibration import RejectedView, calibrate
from calibration.report.figures import coverage_figure
from calibration.report.page import calibration_page
from pipeline.synthetic.board_views import camera
from tests.scenes.calibration import BOARD, computed_views


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.outside = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "path", "circle", "rect", "br", "polygon", "img"):
            self.open.append(tag)
        self.outside += [v for k, v in attrs if k in ("src", "href") and v and not v.startswith("#")]

    def handle_endtag(self, tag):
        if tag not in ("path", "circle", "rect", "polygon"):
            assert self.open.pop() == tag


def test_page_is_whole_and_self_contained():
    found = calibrate(computed_views(camera(), 6), BOARD, rejected=[RejectedView(name="<bad>.png", reason="blurred")])
    page, tags = calibration_page(found, title="uav1 & uav2"), Tags()
    tags.feed(page)
    assert tags.open == []
    assert tags.outside == []
    assert "&lt;bad&gt;.png" in page
    assert "uav1 &amp; uav2" in page
    assert "only 6 views" in page
    assert "prefers-color-scheme: dark" in page
    assert page.count('class="count') == 25
    assert found.part in page


def test_the_map_of_sigmas_covers_the_picture_and_says_what_boards_reached():
    found = calibrate(computed_views(camera(), 8), BOARD)
    cells = re.findall(r'<rect class="s(\d)" x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', coverage_figure(found))
    width = found.camera.image_size[0]
    assert max(float(x) + float(w) for _, x, w in cells) == pytest.approx(width, abs=0.1)
    assert sum(float(w) for _, _, w in cells) == pytest.approx(width * len(found.sigma_map_px), rel=0.01)
    assert found.coverage.boards.max() <= 8
    assert f"{found.coverage.area:.0%}" in found.part or found.part == "over the whole picture"
