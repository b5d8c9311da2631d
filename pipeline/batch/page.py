"""The page that lists flights by verdict: what cannot be used first, each with its reason and a link to its report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.resources import files

from calibration.foundation.palette import palette
from pipeline.batch.dataset import said, worst
from pipeline.batch.flying import RESULTS
from pipeline.batch.outcome import FlightOutcome
from pipeline.report.text.markup import Html, joined, tag

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
GROUPS = (
    ("failed", "No result", "They were refused or stopped; each says why."),
    ("bad", "Bad", "Do not use these: not converged, or they contradict themselves."),
    ("care", "Care", "Read the reasons before you rely on them."),
    ("good", "Good", "Nothing speaks against them."),
)


def batch_page(outcomes: Sequence[FlightOutcome], total: int) -> str:
    """The page of a batch of `total` flights, of which these are known."""
    groups = {name: [o for o in outcomes if group_of(o) == name] for name, _, _ in GROUPS}
    head = joined(
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", "Flights \u2013 runningfix"),
        tag("link", rel="icon", href="data:,"),
        tag("style", Html("\n" + palette() + files(__package__).joinpath("page.css").read_text(encoding="utf-8"))),
    )
    counts = [
        tag("li", tag("b", str(len(groups[name]))), f" {words.lower()}", class_=name) for name, words, _ in GROUPS
    ]
    left = f" {total - len(outcomes)} are still to come." if total > len(outcomes) else ""
    body = joined(
        tag("p", "runningfix batch", class_="kicker"),
        tag("h1", f"{len(outcomes)} flights"),
        tag("ul", *counts, class_="counts"),
        tag("p", f"Every figure is in catalogue.parquet, every trajectory below trajectory/.{left}"),
        *(_group(name, words, what, groups[name]) for name, words, what in GROUPS if groups[name]),
    )
    page = tag("html", tag("head", head), tag("body", tag("main", body)), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def group_of(outcome: FlightOutcome) -> str:
    """Under which heading a flight stands."""
    return outcome.verdict if outcome.status == "done" else "failed"


def _group(name: str, words: str, what: str, outcomes: Sequence[FlightOutcome]) -> Html:
    ordered = sorted(outcomes, key=lambda o: o.name)
    rows = [_failed(o) if name == "failed" else _solved(o) for o in ordered]
    last = "why" if name == "failed" else "reasons"
    middle = ("status",) if name == "failed" else ("offset \u03c3", "position \u03c3")
    top = tag("tr", *(tag("th", text) for text in ("flight", *middle, "seconds", last)))
    kinds = Counter(o.status for o in outcomes) if name == "failed" else {}
    more = " (" + ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) + ")" if kinds else ""
    table = tag("div", tag("table", tag("thead", top), tag("tbody", *rows)), class_="scroll")
    return joined(tag("h2", f"{words}: {len(outcomes)}{more}", class_=name), tag("p", what), table)


def _failed(o: FlightOutcome) -> Html:
    why = joined(said(o), tag("br"), tag("span", o.error.get("advice", ""), class_="soft"))
    cells = (tag("td", o.name, title=o.source), tag("td", o.status), _number(o.seconds, "s", 1), tag("td", why))
    return tag("tr", *cells)


def _solved(o: FlightOutcome) -> Html:
    offset = worst(offset.get("offset_sigma_s") for offset in o.offsets)
    position = worst(position.get("typical_sigma_m") for position in o.positions)
    link = tag("a", o.name, href=f"{RESULTS}/{o.name}/report.html", title=o.source)
    return tag(
        "tr", tag("td", link), _number(None if offset is None else 1e3 * offset, "ms", 1), _number(position, "m", 2),
        _number(o.seconds, "s", 1), tag("td", "; ".join(o.reasons)),
    )  # fmt: skip


def _number(value: float | None, unit: str, places: int) -> Html:
    return tag("td", "unknown" if value is None else f"{value:.{places}f} {unit}", class_="n")
