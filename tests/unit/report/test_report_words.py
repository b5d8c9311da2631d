from __future__ import annotations

import math

import pytest

from pipeline.report.text.words import NARROW, counted, degrees_of_place, fixed, listed, plus_minus, rounded, utc


@pytest.mark.parametrize(
    ("value", "sigma", "words"),
    [
        (1.60031, 0.0041, "1.600 \u00b1 0.004"),
        (1.60031, 0.0012, "1.6003 \u00b1 0.0012"),
        (-1234.56, 12.4, f"\u22121{NARROW}235 \u00b1 12"),
        (1234.56, 77.0, f"1{NARROW}230 \u00b1 80"),
        (0.5, 0.0, "0.500000"),
        (0.0, 0.0, "0"),
        (2.0, math.nan, "2.0000 \u00b1 ?"),
        (math.nan, 1.0, "unknown"),
        (-0.0004, 0.01, "0.000 \u00b1 0.010"),
    ],
)
def test_value_and_sigma_share_their_digits(value, sigma, words):
    assert plus_minus(value, sigma) == words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.4444, "0.44"),
        (21.3, "21"),
        (213.0, "213"),
        (0, "0"),
        (math.inf, "unknown"),
        (1.2e-9, "1.2 \u00d7 10\u207b\u2079"),
    ],
)
def test_significant_digits(value, words):
    assert rounded(value) == words


def test_fixed_never_says_minus_zero():
    assert fixed(-0.001, 2) == "0.00"
    assert fixed(-1.5, 1) == "\u22121.5"


def test_counts_and_lists():
    assert counted(1, "camera") == "1 camera"
    assert counted(50112, "sighting") == f"50{NARROW}112 sightings"
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed([]) == ""


def test_utc_and_places():
    assert utc(1_741_507_200.256) == "2025-03-09 08:00:00.26 UTC"
    assert utc(0.999) == "1970-01-01 00:00:01.00 UTC"
    assert degrees_of_place(-28.5, 112.25) == "28.50000\u00b0S 112.25000\u00b0E"
