"""The whole page: one file that needs nothing else, the same bytes for the same results."""

from __future__ import annotations

from importlib.resources import files

from calibration.foundation.palette import palette
from pipeline.records import Results
from pipeline.report.blocks import Section, section
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.views.cameras import orientation
from pipeline.report.views.clocks import timing
from pipeline.report.views.correlation import correlations
from pipeline.report.views.known import known_tables
from pipeline.report.views.over_time import height_and_speed, uncertainty_figure
from pipeline.report.views.overhead_map import map_figure
from pipeline.report.views.pictures import pictures_missing, pictures_section
from pipeline.report.views.provenance import provenance
from pipeline.report.views.residuals import residual_figures
from pipeline.report.views.space import space_section
from pipeline.report.views.summary import header
from pipeline.report.views.timeline import targets_table, timeline_figure
from pipeline.report.views.truth import truth_figures

POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"


def render_report(results: Results) -> str:
    """The report of a solved flight as one self-contained HTML page.

    Loads nothing from anywhere, works from a file, and depends on `results` alone: no clock, no chance.
    """
    parts = _sections(results)
    contents = tag("nav", tag("ul", *(_link(p) for p in parts)), aria_label="Contents")
    body = joined(header(results), contents, tag("main", *(section(p) for p in parts)), _foot(results))
    head = joined(
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", f"{results.title} \u2013 runningfix"),
        tag("link", rel="icon", href="data:,"),
        tag("style", Html("\n" + palette()), _asset("report.css")),
    )
    scripts = [tag("script", _asset(name)) for name in ("space.js", "page.js")]
    page = tag("html", tag("head", head), tag("body", body, *scripts), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _sections(results: Results) -> list[Section]:
    truth = results.comparison or results.truth is not None
    found = [
        Section(anchor="map", heading="Map", content=map_figure(results)),
        Section(anchor="space-view", heading="In 3D", content=space_section(results)),
        Section(anchor="targets", heading="Targets", content=targets_table(results)),
        Section(
            anchor="pictures", heading="Pictures from the videos", short="Pictures", content=pictures_section(results)
        ),
        Section(anchor="known", heading="Landmarks and ground", short="Landmarks", content=known_tables(results)),
        Section(anchor="height", heading="Height and speed", short="Height", content=height_and_speed(results)),
        Section(
            anchor="truth",
            heading="Against the truth",
            short="Truth",
            content=truth_figures(results) if truth else Html(""),
        ),
        Section(anchor="uncertainty", heading="Uncertainty", content=uncertainty_figure(results)),
        Section(anchor="residuals", heading="Image residuals", short="Residuals", content=residual_figures(results)),
        Section(anchor="timing", heading="Timing", content=timing(results)),
        Section(anchor="cameras", heading="Camera corrections", short="Corrections", content=orientation(results)),
        Section(anchor="tracks", heading="Tracks", content=joined(timeline_figure(results), pictures_missing(results))),
        Section(anchor="correlations", heading="Correlations", content=correlations(results)),
        Section(
            anchor="provenance",
            heading="Settings, inputs, versions",
            short="Settings",
            content=provenance(results),
            folded=True,
        ),
    ]
    return [s for s in found if s.content]


def _link(part: Section) -> Html:
    return tag("li", tag("a", part.short or part.heading, href=f"#{part.anchor}"))


def _foot(results: Results) -> Html:
    version = results.versions.get("runningfix", "")
    return tag(
        "footer", tag("p", f"Made by runningfix {version}".strip(), ". This page loads nothing and needs no network.")
    )


def _asset(name: str) -> Html:
    """Text of a file beside this module, to stand inside a style or script element."""
    text = files(__package__).joinpath(name).read_text(encoding="utf-8")
    if "</" in text:
        raise ValueError(f"{name}: must not contain '</'")
    return Html("\n" + text)
