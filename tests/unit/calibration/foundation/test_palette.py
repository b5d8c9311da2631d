"""One palette for all pages: its names are all that they use, and no page has colours of its own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from calibration.foundation.palette import palette

ROOT = Path(__file__).resolve().parents[4]
PAGES = (
    "pipeline/report/report.css", "pipeline/batch/page.css", "pipeline/experiments/pages/page.css",
    "calibration/report/page.css", "pipeline/label/page.html",
)  # fmt: skip


def names(text: str) -> set[str]:
    return set(re.findall(r"(--[a-z0-9-]+):", text))


def test_dark_has_every_colour_that_light_has():
    light, dark, printed = re.split("@media [^{]*", palette())
    assert names(light) == names(dark) >= names(printed)
    assert len(names(light)) > 25


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_colours_and_defines_none(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    used = set(re.findall(r"var\((--[a-z0-9-]+)", text)) - {"--c", "--who"}  # of one element, set in it
    assert used
    assert used <= names(palette())
    assert ":root" not in text
    assert not re.search(r"--(?!c\b)[a-z0-9-]+:\s*#", text)
