from html.parser import HTMLParser

from calibration import RejectedView, calibrate
from calibration.report.page import calibration_page
from pipeline.synthetic.board_views import camera
from tests.scenes.calibration import BOARD, computed_views


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.outside = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "path", "circle", "rect", "br"):
            self.open.append(tag)
        self.outside += [v for k, v in attrs if k in ("src", "href") and v]

    def handle_endtag(self, tag):
        if tag not in ("path", "circle", "rect"):
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
