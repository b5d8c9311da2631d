"""What the page says in words, heading by heading, held against a file: a changed sentence shows in the difference.

To accept a change: RUNNINGFIX_ACCEPT=1 pytest tests/golden/report
"""

from __future__ import annotations

import os
import re
from html.parser import HTMLParser
from pathlib import Path

from pipeline.report import render_report
from tests.scenes.report import fake_results

EXPECTED = Path(__file__).parent / "expected" / "report.txt"
LINES = {"h1", "h2", "h3", "h4", "p", "li", "tr", "figcaption", "summary", "caption", "dt", "dd", "title"}


class Words(HTMLParser):
    """The page's text, a line for each block; drawings, scripts and styles speak through their titles only."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.lines: list[str] = [""]
        self.silent = 0
        self.drawing = 0
        self.titled = False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.silent += tag in ("script", "style")
        self.drawing += tag == "svg"
        self.titled |= tag == "title"
        if tag in LINES:
            self.lines.append({"h1": "# ", "h2": "## ", "h3": "### ", "title": "[drawing] "}.get(tag, ""))
        elif tag in ("td", "th"):
            self.lines[-1] += " | "

    def handle_endtag(self, tag):
        self.silent -= tag in ("script", "style")
        self.drawing -= tag == "svg"
        self.titled &= tag != "title"

    def handle_data(self, data):
        if not self.silent and (self.titled or not self.drawing):
            self.lines[-1] += data


def test_the_words_of_the_page():
    lines = Words(render_report(fake_results(targets=2, seconds=8))).lines
    said = "\n".join(line for line in (re.sub(r"\s+", " ", line).strip() for line in lines) if line) + "\n"
    if os.environ.get("RUNNINGFIX_ACCEPT"):
        EXPECTED.write_text(said, encoding="utf-8")
    assert said == EXPECTED.read_text(encoding="utf-8")
