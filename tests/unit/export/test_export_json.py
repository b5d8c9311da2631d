"""solution.json: valid JSON, the covariances right, nothing of the run itself in it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import pytest

from pipeline.export import solution_json
from pipeline.export.as_json import dumps, plain
from pipeline.records import Motion
from tests.scenes.export import BUS, covariance_band, tiny_results


def refuse(name: str) -> None:
    raise AssertionError(f"{name} is not JSON")


def strict(text: str) -> Any:
    return json.loads(text, parse_constant=refuse)


def cubic() -> Motion:
    rng = np.random.default_rng(4)
    spread = rng.normal(size=(12, 20))
    full = (spread @ spread.T).reshape(4, 3, 4, 3).transpose(0, 2, 1, 3)
    band = np.zeros((4, 4, 3, 3))
    for i in range(4):
        for j in range(4 - i):
            band[i, j] = full[i, i + j]
    return Motion(
        target="cubic",
        kind="polynomial",
        degree=3,
        knots_s=np.array([2.0] * 4 + [9.0] * 4),
        coefficients=rng.normal(size=(4, 3)),
        covariance_band=band,
        start_s=2.0,
        end_s=9.0,
    )


def with_motions(*motions: Motion) -> Any:
    results = tiny_results()
    solution = dataclasses.replace(results.solution, motions=motions, motions_robust=())
    return strict(solution_json(dataclasses.replace(results, solution=solution)))


def test_power_coefficients_and_their_covariance_give_the_motion_back() -> None:
    motion = cubic()
    told = with_motions(motion)["motions"][0]["polynomial"]
    time = np.linspace(2.0, 9.0, 11)
    powers = (time[:, None] - told["epoch_s"]) ** np.arange(4)
    np.testing.assert_allclose(powers @ np.array(told["coefficients"]), motion.position_enu_m(time), atol=1e-9)
    covariance = np.array(told["covariance"]).reshape(4, 3, 4, 3)
    position = np.einsum("na,axby,nb->nxy", powers, covariance, powers)
    np.testing.assert_allclose(position, motion.position_covariance(time), rtol=1e-6, atol=1e-6)


def test_the_spline_form_gives_the_motion_back() -> None:
    results = tiny_results()
    for told, motion in zip(strict(solution_json(results))["motions"], results.solution.motions, strict=True):
        band = told["covariance_band"]
        again = Motion(
            target=told["target"],
            kind=told["kind"],
            degree=told["degree"],
            knots_s=told["knots_s"],
            coefficients=told["coefficients_enu_m"],
            covariance_band=None if band is None else np.array(band).reshape(len(band), -1, 3, 3),
            start_s=told["start_s"],
            end_s=told["end_s"],
        )
        time = np.array([motion.start_s, 0.7 * motion.start_s + 0.3 * motion.end_s])
        np.testing.assert_array_equal(again.position_enu_m(time), motion.position_enu_m(time))
        np.testing.assert_allclose(again.position_covariance(time), motion.position_covariance(time), rtol=1e-8)


def test_only_the_polynomial_has_powers_and_the_robust_covariance_is_beside_the_plain() -> None:
    line, curve = strict(solution_json(tiny_results()))["motions"]
    assert line["target"] == BUS
    assert "polynomial" in line
    assert "polynomial" not in curve
    robust = np.array(line["covariance_band_robust"]).reshape(2, 2, 3, 3)
    np.testing.assert_allclose(robust, 2 * covariance_band(2, 1), rtol=1e-8)


def test_a_polynomial_without_covariance_says_null() -> None:
    motion = dataclasses.replace(cubic(), covariance_band=None)
    told = with_motions(motion)["motions"][0]
    assert told["covariance_band"] is None
    assert told["polynomial"]["covariance"] is None


def test_shared_sigma_and_correlation() -> None:
    told = strict(solution_json(tiny_results()))["shared"]
    assert told["names"] == ["uav2.offset_s", "uav2.frame_rate"]
    np.testing.assert_allclose(told["sigma"], np.sqrt([5e-6, 2e-8]), rtol=1e-8)  # the robust ones are the larger
    np.testing.assert_allclose(told["correlation"], [[1.0, 0.5], [0.5, 1.0]])


def test_a_held_parameter_has_no_correlation() -> None:
    results = tiny_results()
    solution = dataclasses.replace(results.solution, shared_covariance=np.diag([4.0, 0.0]))
    told = strict(solution_json(dataclasses.replace(results, solution=solution)))["shared"]
    assert told["correlation"] == [[1.0, 0.0], [0.0, None]] or told["correlation"] == [[1.0, None], [None, None]]


def test_angles_are_degrees_and_what_is_not_finite_is_null() -> None:
    told = strict(solution_json(tiny_results()))
    assert told["biases"][0]["rotation_deg"] == [0.1, -0.2, 0.3]
    assert told["biases"][0]["position_sigma_m"] == [0.1, 0.2, None]
    assert told["settings"]["limit"] is None
    assert told["frame"]["origin"] == {"latitude_deg": 47.4, "longitude_deg": 8.5, "ellipsoidal_height_m": 500.0}


def test_how_long_it_took_is_not_in_it() -> None:
    results = tiny_results()
    slower = dataclasses.replace(results.solution, seconds=9.0)
    assert solution_json(results) == solution_json(dataclasses.replace(results, solution=slower))
    assert "123.456" not in solution_json(results)


def test_what_is_unknown_and_why() -> None:
    told = strict(solution_json(tiny_results(utc_s=None, origin=None)))
    assert told["frame"] == {
        "axes": "local east, north, up in metres on WGS84",
        "origin": None,
        "utc_at_common_time_0": None,
    }
    assert told["findings"][0]["words"] == "No clock is absolute."
    assert told["offset_candidates"][1] == {"offset_s": {"uav2": 9.0}, "frame_rate": {"uav2": 25.125}, "cost": 80.0}
    assert list(told["inputs_sha256"]) == ["flight.toml", "uav2.tlog"]


def test_plain_values() -> None:
    value = {"a": np.float64("inf"), 2: (np.int64(3), True), "p": PurePosixPath("x/y"), "e": {}, "l": [], "n": None}
    assert strict(dumps(value)) == {"a": None, "2": [3, True], "p": "x/y", "e": {}, "l": [], "n": None}
    with pytest.raises(TypeError, match="object has no plain form"):
        plain({"x": object()})
