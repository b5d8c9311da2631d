"""The page as a whole: self-contained, the same bytes, well formed, safe, and standing up to what solvers produce."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from pipeline.records import Motion, Results, Sightings, Trajectory
from pipeline.report import render_report
from tests.scenes.report import fake_results

VOID = {"br", "input", "link", "meta"}


class Outline(HTMLParser):
    """Checks nesting; gathers identifiers, links, headings and what would load something."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.levels: list[int] = []
        self.loads: list[str] = []
        self.unnamed: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        known = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        self._note(tag, known)

    def handle_startendtag(self, tag, attrs):
        self._note(tag, dict(attrs))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def _note(self, tag, known):
        self.ids += [known["id"]] if "id" in known else []
        if tag == "a":
            self.links.append(known["href"])
        elif "href" in known or "src" in known:
            self.loads.append(known.get("src") or known.get("href"))
        if re.fullmatch(r"h[1-6]", tag):
            self.levels.append(int(tag[1]))
        if known.get("role") == "region" and not known.get("aria-label"):
            self.unnamed.append(tag)


@pytest.fixture(scope="module")
def results() -> Results:
    return fake_results()


@pytest.fixture(scope="module")
def page(results) -> str:
    return render_report(results)


def solved(results: Results, **changes) -> Results:
    return dataclasses.replace(results, solution=dataclasses.replace(results.solution, **changes))


def test_the_page_is_well_formed_and_its_links_lead_somewhere(page):
    outline = Outline(page)
    assert outline.open == []
    assert len(set(outline.ids)) == len(outline.ids)
    assert {link.removeprefix("#") for link in outline.links} <= set(outline.ids)
    assert outline.levels[0] == 1
    assert outline.levels.count(1) == 1
    assert all(b <= a + 1 or (a, b) == (2, 4) for a, b in zip(outline.levels, outline.levels[1:], strict=False))
    assert outline.unnamed == []


def test_nothing_is_loaded_from_anywhere(page):
    loads = Outline(page).loads
    assert loads[0] == "data:,"
    assert len(loads) > 20
    assert all(re.fullmatch("data:image/jpeg;base64,[A-Za-z0-9+/=]+", address) for address in loads[1:])
    assert not re.search(r"https?://|@import|url\(|fetch\(|XMLHttpRequest|import\(", page)
    assert 'content="default-src &#x27;none&#x27;;' in page


def test_every_drawing_has_words(page):
    drawings = re.findall(r"<svg[^>]*>(?:<title>[^<]+</title>)?", page)
    spoken = [d for d in drawings if 'role="img"' in d]
    assert len(spoken) > 20
    assert all("<title>" in d for d in spoken)
    silent = [d for d in drawings if 'role="img"' not in d]
    assert all('aria-hidden="true"' in d or 'overflow="hidden"' in d for d in silent)


def test_the_same_results_give_the_same_bytes(results, page):
    assert render_report(fake_results()) == page


def test_how_long_it_took_is_not_told(results, page):
    assert render_report(solved(results, seconds=123456.789)) == page


def test_names_are_only_ever_text(results, page):
    evil = "</script><script>alert(1)</script>\"'&<b>"
    renamed = {"van": evil}

    def name(record, field="target"):
        return dataclasses.replace(record, **{field: renamed.get(getattr(record, field), getattr(record, field))})

    s = results.solution
    sightings = dataclasses.replace(s.sightings, target=tuple(renamed.get(t, t) for t in s.sightings.target))
    hostile = dataclasses.replace(
        solved(results, motions=tuple(map(name, s.motions)), motions_robust=tuple(map(name, s.motions_robust)),
               sightings=sightings, message=evil, method=evil),
        title=evil, trajectories=tuple(map(name, results.trajectories)), tracks=tuple(map(name, results.tracks)),
        inputs={evil: evil}, settings={evil: {evil: evil}}, versions={evil: evil}, warnings=(evil,),
    )  # fmt: skip
    bad = render_report(hostile)
    assert bad.count("<script") == page.count("<script")
    assert "<b>" not in re.sub(r"<b>[^<]*</b> ", "", bad)
    assert Outline(bad).open == []


def test_a_long_flight_stays_small_and_says_what_it_left_out():
    many = fake_results(targets=4, cameras=5, seconds=540, rate_hz=5)
    assert len(many.solution.sightings.frame) > 50_000
    page = render_report(many)
    assert len(page.encode()) < 3_000_000
    assert "sightings are drawn" in page
    assert "Curves are drawn through 1\u202f500 of up to 5\u202f401 samples." in page


def _nowhere(track: Trajectory, n: int) -> Trajectory:
    return Trajectory(
        target=track.target,
        time_s=track.time_s[:n],
        position_enu_m=np.full((n, 3), np.nan),
        velocity_mps=np.full((n, 3), np.nan),
        covariance=np.full((n, 3, 3), np.nan),
    )


def _no_sightings() -> Sightings:
    none, flat = np.zeros(0), np.zeros((0, 2))
    return Sightings(
        camera=(), target=(), frame=none, time_s=none, residual_px=flat, residual_sigma=none, weight=none,
        position_enu_m=np.zeros((0, 3)),
    )  # fmt: skip


def _blind(motion: Motion) -> Motion:
    return dataclasses.replace(motion, covariance_band=None)


BARE = {
    "sightings": _no_sightings(), "biases": (), "findings": (), "offset_candidates": (), "shared_names": (),
    "shared_covariance": None, "motions": (), "motions_robust": (), "poses": (), "clocks": (),
}  # fmt: skip


def _bare(results: Results) -> Results:
    empty = {"trajectories": (), "tracks": (), "measured_poses": (), "truth": None, "comparison": (), "warnings": ()}
    return dataclasses.replace(solved(results, **BARE), **empty, image_size={}, inputs={}, settings={}, versions={})


ODD = {
    "nothing at all": _bare,
    "no position": lambda r: dataclasses.replace(r, trajectories=tuple(_nowhere(t, 50) for t in r.trajectories)),
    "one instant": lambda r: dataclasses.replace(r, trajectories=(_nowhere(r.trajectories[0], 1),)),
    "no instant": lambda r: dataclasses.replace(r, trajectories=(_nowhere(r.trajectories[0], 0),)),
    "standing still": lambda r: dataclasses.replace(
        r,
        trajectories=tuple(
            dataclasses.replace(t, position_enu_m=np.ones_like(t.position_enu_m), velocity_mps=0 * t.velocity_mps)
            for t in r.trajectories
        ),
    ),
    "run away": lambda r: dataclasses.replace(
        r,
        trajectories=tuple(dataclasses.replace(t, position_enu_m=1e9 * t.position_enu_m) for t in r.trajectories),
    ),
    "no covariance": lambda r: solved(
        r,
        motions=tuple(map(_blind, r.solution.motions)),
        motions_robust=(),
        shared_covariance=np.full((14, 14), np.nan),
    ),
    "held parameters": lambda r: solved(r, shared_covariance=np.zeros((14, 14))),
    "no residuals": lambda r: solved(
        r,
        sightings=dataclasses.replace(
            r.solution.sightings,
            residual_px=np.full_like(r.solution.sightings.residual_px, np.nan),
            residual_sigma=np.full_like(r.solution.sightings.residual_sigma, np.nan),
        ),
    ),
    "perfect residuals": lambda r: solved(
        r,
        sightings=dataclasses.replace(
            r.solution.sightings,
            residual_px=0 * r.solution.sightings.residual_px,
            residual_sigma=0 * r.solution.sightings.residual_sigma,
        ),
    ),
    "unknown sigmas": lambda r: solved(
        r,
        clocks=tuple(dataclasses.replace(c, offset_sigma_s=np.nan, frame_rate_sigma=np.nan) for c in r.solution.clocks),
        biases=tuple(
            dataclasses.replace(b, rotation_sigma_rad=np.full(3, np.nan), position_m=np.full(3, np.nan))
            for b in r.solution.biases
        ),
    ),
    "ten targets": lambda r: fake_results(targets=10, cameras=3, seconds=4),
    "one camera": lambda r: fake_results(targets=1, cameras=1, drift=False),
}


@pytest.mark.parametrize("odd", ODD, ids=str)
def test_odd_results_still_make_a_page(results, odd):
    page = render_report(ODD[odd](results))
    assert Outline(page).open == []
    assert not re.search(r'(?:[ "(,MLH]|=")-?(?:nan|inf)\b', page)
