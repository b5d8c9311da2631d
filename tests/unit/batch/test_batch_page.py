"""The page lists flights by verdict, what has no result first; whatever they are called."""

from pipeline.batch import FlightOutcome
from pipeline.batch.dataset import worst
from pipeline.batch.page import batch_page

POSITION = {"target": "car", "typical_sigma_m": 0.5}


def outcome(name, **others):
    return FlightOutcome(**{"name": name, "source": f"/{name}", "status": "done", "verdict": "good", **others})


def test_flights_stand_under_their_verdicts_what_cannot_be_used_first():
    error = {"where": "<x>", "seen": "seen", "expected": "expected", "advice": "advice"}
    page = batch_page(
        [
            outcome("fine", positions=(POSITION,), offsets=({"camera": "c", "offset_s": 0, "offset_sigma_s": 0.0123},)),
            outcome("wrong", verdict="bad", reasons=("the clocks contradict",)),
            outcome("late", status="timeout", verdict="", error=error),
        ],
        5,
    )
    assert page.index("No result: 1 (1 timeout)") < page.index("Bad: 1") < page.index("Good: 1")
    assert "&lt;x&gt;: seen; expected expected" in page
    assert 'href="flights/fine/report.html"' in page
    assert 'href="flights/late/report.html"' not in page
    assert "12.3 ms" in page
    assert "0.50 m" in page
    assert "2 are still to come" in page


def test_the_worst_sigma_is_unknown_where_one_is():
    assert worst([0.1, 0.3]) == 0.3
    assert worst([0.1, None]) is None
    assert worst([]) is None
