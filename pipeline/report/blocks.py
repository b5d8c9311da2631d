"""The page's building stones: sections, figures with captions, tables, legends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.records import Results
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, tag

NARROW_COLUMNS = 3
"""A table of more is shown row by row where the screen is a phone's."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of the page: heading, anchor, `short` name for the list of contents; `folded` parts open on demand."""

    anchor: str
    heading: str
    content: Html
    short: str = ""
    folded: bool = False


def section(part: Section) -> Html:
    """The section as an element."""
    heading = tag("h2", part.heading, id=f"{part.anchor}-heading")
    if part.folded:
        inner: Html = tag("details", tag("summary", heading), part.content)
    else:
        inner = joined(heading, part.content)
    return tag("section", inner, id=part.anchor, aria_labelledby=f"{part.anchor}-heading")


def figure(*drawings: Html, caption: str = "", legend: str = "", wide: bool = False) -> Html:
    """Panels side by side where there is room, with what they mean underneath."""
    grid = tag("div", *drawings, class_="panels wide" if wide else "panels")
    return tag("figure", legend, grid, tag("figcaption", caption) if caption else "")


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, caption: str, words: int = 1) -> Html:
    """A table whose first column names its rows; the first `words` columns are text, the others figures."""
    top = tag("tr", *(tag("th", h, scope="col", class_=None if i < words else "n") for i, h in enumerate(head)))
    body = [tag("tr", tag("th", row[0], scope="row"), *_cells(head, row, words)) for row in rows]
    wide = ("cards named" if words > 1 else "cards") if len(head) > NARROW_COLUMNS else None
    whole = tag("table", tag("caption", tag("span", caption)), tag("thead", top), tag("tbody", *body), class_=wide)
    return tag("div", whole, class_="scroll", tabindex=0, role="region", aria_label=caption)


def _cells(head: Sequence[str], row: Sequence[str], words: int) -> list[Html]:
    """Each knows its column's name: on a narrow screen a row becomes a card of names and values."""
    cells = enumerate(zip(head[1:], row[1:], strict=True), start=1)
    return [tag("td", cell, class_=None if i < words else "n", data_of=name) for i, (name, cell) in cells]


def swatch(results: Results, target: str) -> Html:
    """A target's name with its colour before it."""
    return joined(tag("i", class_=f"swatch {participants.tone(results, target)}"), target)


def target_legend(results: Results, *more: Html, only: Sequence[str] | None = None) -> Html:
    """Which colour is which target, and further keys."""
    names = [t for t in participants.targets(results) if only is None or t in only]
    keys = [tag("li", swatch(results, t)) for t in names] + [tag("li", m) for m in more]
    return tag("ul", *keys, class_="legend")


def key(class_: str, words: str, shape: str = "M1 6H23") -> Html:
    """A legend entry: a short stroke drawn in `class_`, then what it means."""
    sample = tag("svg", tag("path", d=shape, class_=class_), width=24, height=12, aria_hidden="true")
    return joined(sample, words)


def note(*content: str) -> Html:
    """A paragraph of explanation."""
    return tag("p", *content, class_="note")
