"""Each figure draws the figures that it is given, in the right place."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from pipeline.geometry.geodesy import enu_from_geodetic
from pipeline.records import Comparison, Correction, OffsetCandidate, Results
from pipeline.report.views.cameras import orientation
from pipeline.report.views.clocks import timing
from pipeline.report.views.correlation import correlations
from pipeline.report.views.over_time import height_and_speed, uncertainty_figure
from pipeline.report.views.overhead_map import map_figure
from pipeline.report.views.provenance import provenance
from pipeline.report.views.residuals import DRAWN, residual_figures
from pipeline.report.views.space import focal_px, space_data
from pipeline.report.views.timeline import targets_table, timeline_figure
from pipeline.report.views.truth import truth_figures
from tests.scenes.report import FOCAL_PX, fake_results


@pytest.fixture(scope="module")
def results() -> Results:
    return fake_results()


def solved(results: Results, **changes) -> Results:
    return dataclasses.replace(results, solution=dataclasses.replace(results.solution, **changes))


def text(markup: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", markup)).strip()


def test_the_map_puts_a_start_where_it_is(results):
    page = map_figure(results)
    west, north, scale = (float(re.search(rf'data-{k}="([^"]+)"', page)[1]) for k in ("west", "north", "scale"))
    starts = re.findall(r'<circle cx="([^"]+)" cy="([^"]+)" r="5.5" class="start"/>', page)
    east_m, north_m, _ = results.trajectories[0].position_enu_m[0]
    assert float(starts[0][0]) == pytest.approx((east_m - west) * scale, abs=0.1)
    assert float(starts[0][1]) == pytest.approx((north - north_m) * scale, abs=0.1)


def test_the_map_scale_bar_is_true(results):
    page = map_figure(results)
    scale = float(re.search(r'data-scale="([^"]+)"', page)[1])
    long_px = float(re.search(r'd="M0 -5V0H([\d.]+)V-5"', page)[1])
    long_m = float(re.search(r'class="name">(\d+) m</text>', page)[1])
    assert long_px / scale == pytest.approx(long_m, rel=0.01)


def test_the_map_corners_are_where_they_say(results):
    page = map_figure(results)
    west, north, scale = (float(re.search(rf'data-{k}="([^"]+)"', page)[1]) for k in ("west", "north", "scale"))
    lat, lon = map(float, re.search(r"north-east corner ([\d.]+)\S+ ([\d.]+)", page).groups())
    place = enu_from_geodetic(np.radians(lat), np.radians(lon), results.origin.height_m, results.origin)
    assert place[:2] == pytest.approx([west + 960 / scale, north], abs=1.5)


def test_the_map_says_how_much_it_enlarges(results):
    assert re.search(r"one and two sigma are drawn (10|20) \u00d7 larger", map_figure(results))


def test_no_origin_no_degrees(results):
    assert "WGS84" not in map_figure(dataclasses.replace(results, origin=None))


def test_a_second_map_only_where_the_first_is_too_small(results):
    assert map_figure(results).count('class="map"') == 2
    near = dataclasses.replace(results, solution=dataclasses.replace(results.solution, poses=()))
    assert map_figure(near).count('class="map"') == 1


def test_truth_is_drawn_only_where_known(results):
    blind = dataclasses.replace(results, truth=None, comparison=())
    for draw in (map_figure, height_and_speed):
        assert 'class="truth"' in draw(results)
        assert "truth" not in draw(blind)
    assert json.loads(_json(space_data(blind)))["targets"][0]["truth"] == []


def test_the_3d_data_are_the_results(results):
    data = json.loads(_json(space_data(results)))
    assert [t["name"] for t in data["targets"]] == [t.target for t in results.trajectories]
    np.testing.assert_allclose(data["targets"][0]["p"], results.trajectories[0].position_enu_m, atol=0.006)
    camera = data["cameras"][1]
    assert camera["t"][0] == pytest.approx(1.6003, abs=1e-3)
    assert camera["half"][0] == pytest.approx(640 / FOCAL_PX, rel=0.02)
    assert len(camera["seen"]["van"]) == 2


def test_the_focal_length_is_guessed_from_the_sightings(results):
    assert focal_px(results, "uav1") == pytest.approx(FOCAL_PX, rel=0.01)
    assert focal_px(solved(results, poses=()), "uav1") == 1280


def test_speed_is_given_twice(results):
    words = text(targets_table(results))
    speed = np.linalg.norm(results.trajectories[0].velocity_mps, axis=1)
    assert f"{np.median(speed):.1f} m/s ({3.6 * np.median(speed):.0f} km/h)" in words
    assert "Common time 0 is 2025-03-09 08:00:00.25 UTC." in words


def test_uncertainty_shows_both_versions_only_where_there_are_two(results):
    assert "line robust" in uncertainty_figure(results)
    assert "line robust" not in uncertainty_figure(solved(results, motions_robust=()))


def test_residual_table_gives_the_rms(results):
    s = results.solution.sightings
    mine = np.array([c == "uav1" for c in s.camera])
    rms = np.sqrt(np.mean(s.residual_px[mine, 0] ** 2))
    assert f"{rms:.3f}" in text(residual_figures(results))


def test_many_residuals_are_thinned_and_it_says_so():
    many = fake_results(targets=2, cameras=1, seconds=120, drift=False)
    page = residual_figures(many)
    total = len(many.solution.sightings.frame)
    assert total > DRAWN
    drawn = [len(re.findall("h0", d)) for d in re.findall(r'd="([^"]+)" class="dots thin"', page)]
    assert sum(drawn) == DRAWN * 3
    assert f"2\u202f000 of {total // 1000}\u202f{total % 1000:03d} sightings are drawn" in page


def test_the_histogram_is_a_density(results):
    page = residual_figures(results)
    outline = re.search(r'd="([^"]+)" class="bars"', page)[1]
    xy = np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", outline), float)
    curve = np.array(
        re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", re.search(r'd="([^"]+)" class="expected"/></svg><t', page)[1]), float
    )
    floor = xy[0, 1]
    bars = np.trapezoid(floor - xy[:, 1], xy[:, 0])
    expected = np.trapezoid(curve[0, 1] - curve[:, 1], curve[:, 0])
    assert bars == pytest.approx(expected, rel=0.03)


def test_the_clock_table(results):
    words = text(timing(results))
    assert "uav1 reference, held 0 (held)" in words
    assert "1.600 \u00b1 0.004" in words
    assert "25.0053 \u00b1 0.0012" in words
    assert "210 \u00b1 50" in words


def test_drift_only_where_a_clock_drifts(results):
    assert "Drift" in text(timing(results))
    assert "Drift" not in text(timing(fake_results(drift=False)))


def test_candidates_are_ranked_by_how_much_worse_they_are(results):
    pair = (OffsetCandidate(offset_s={"uav2": 9.0}, cost=110.0), OffsetCandidate(offset_s={"uav2": 1.6}, cost=100.0))
    words = text(timing(solved(results, offset_candidates=pair)))
    assert re.search(r"best 1.60 100.\d+ 0 2\. 9.00 110.\d+ 20.0 \(doubtful\)", words)


def correction(**changes) -> Correction:
    given = {
        "camera": "uav1", "parameter": "uav1.rotation_bias_x_rad", "block": "attitude", "value": np.radians(-0.25),
        "prior_sigma": np.radians(0.5), "sigma": np.radians(0.04), "in_sigmas": -0.5,
    }  # fmt: skip
    return Correction(**{**given, **changes})


def test_corrections_stand_beside_their_priors_in_the_units_of_people(results):
    focal = correction(
        parameter="uav1.focal_scale", block="focal", value=0.0042, prior_sigma=0.001, sigma=0.0008, in_sigmas=4.19,
        beyond=True,
    )  # fmt: skip
    markup = orientation(solved(results, corrections=(correction(), focal)))
    words = re.sub("[\u2009\u00a0 ]+", " ", text(markup))
    assert "attitude x (nods) \u22120.250\u00b0 \u00b1 0.500\u00b0 \u00b1 0.040\u00b0 \u22120.50" in words
    assert "focal length 0.420 % \u00b1 0.100 % \u00b1 0.080 % beyond 3 sigmas: ! 4.19" in words
    assert "1 of 2 parameters lie beyond 3 sigmas" in words
    assert markup.count("pull beyond") == 2  # the dot, and its key


def test_a_correction_is_drawn_where_its_prior_sigmas_say(results):
    one = correction(in_sigmas=2.0, value=np.radians(1.0))
    markup = orientation(solved(results, corrections=(one,)))
    shades = [tuple(map(float, s)) for s in re.findall(r'<rect x="([\d.]+)" width="([\d.]+)"', markup)]
    dot = float(re.search(r'<circle cx="([\d.]+)"', markup)[1])
    two = next((x, w) for x, w in shades if w == sorted(w for _, w in shades)[1])
    assert dot == pytest.approx(two[0] + two[1], abs=0.1)


def test_places_are_folded_unless_they_are_far(results):
    place = correction(parameter="uav1.van.place_x_px", block="place", value=0.9, prior_sigma=0.25, in_sigmas=3.6)
    head = orientation(solved(results, corrections=(correction(), place))).partition("<details")[0]
    assert "place across on van" not in text(head).partition("furthest")[2].partition(".")[2].replace("3.6", "")
    far = dataclasses.replace(place, beyond=True)
    head = orientation(solved(results, corrections=(correction(), far))).partition("<details")[0]
    assert "uav1 place across on van" in text(head)


def test_without_priors_nothing_was_taken_from_any(results):
    assert "knows no priors" in text(orientation(solved(results, corrections=(), method="intersection")))


def test_the_frame_by_frame_correction_has_the_bias_sign(results):
    """Refined = exp(rotation) measured, in camera axes: the drawn correction must have the sign of the bias."""
    from pipeline.geometry import rotation
    from pipeline.report.views.cameras import _turns_deg

    refined = results.solution.poses[0]
    turn = np.array([0.01, -0.02, 0.005])
    cam_from_enu = rotation.multiply(rotation.conjugate(rotation.exp(turn)), rotation.conjugate(refined.enu_from_cam))
    measured = dataclasses.replace(refined, enu_from_cam=rotation.conjugate(cam_from_enu))
    _, found = _turns_deg(measured, refined)
    np.testing.assert_allclose(found, np.degrees(np.broadcast_to(turn, found.shape)), atol=1e-9)


def test_the_comparison_is_a_table_and_bars(results):
    rows = (
        Comparison(what="offset of uav2", unit="s", before=1.6, after=0.004, sigma=0.002),
        Comparison(what="frame rate of uav2", unit="Hz", before=np.nan, after=0.0, sigma=0.001),
    )
    page = truth_figures(dataclasses.replace(results, comparison=rows))
    assert "offset of uav2 s 1.60 0.00400 0.00200 2.0 400" in text(page)
    assert "frame rate of uav2 Hz \u2013 0 0.00100 0.0 \u2013" in text(page)
    widths = [float(w) for w in re.findall(r'd="M0 [\d.]+H([\d.]+)" class="bar-(?:before|after)"', page)]
    assert len(widths) == 2
    assert widths[0] > widths[1]


def test_correlations_are_those_of_the_covariance(results):
    covariance = np.array([[4.0, 3.0], [3.0, 9.0]])
    page = correlations(
        solved(results, shared_names=("a", "b"), shared_covariance=covariance, shared_covariance_robust=4 * covariance)
    )
    words = text(page)
    assert "a with b (0.50)" in words
    assert "a 2.00 4.00 2.00 b 3.00 6.00 2.00" in words


def test_every_state_has_its_bar(results):
    page = timeline_figure(results)
    assert page.count('class="spell lost"') == len(results.tracks) + 1
    assert "van in uav1: 467 fixes in 500 frames" in page


def test_provenance_names_settings_hashes_and_versions(results):
    words = text(provenance(results))
    assert "solve.method map" in words
    assert "uav1.tlog " + "3f" * 32 in words
    assert "numpy 2.3.1" in words


def _points(d: str) -> np.ndarray:
    return np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", d), float)


def _json(script: str) -> str:
    return script[script.index(">") + 1 : script.rindex("</script>")]
