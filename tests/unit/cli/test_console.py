"""Results as people see them, and progress that moves wherever standard error goes."""

import io
import sys

import pytest

from pipeline.cli import console as speaking
from pipeline.cli.console import Console, paper
from pipeline.cli.result import shown, told

SOLUTION = {
    "method": "map", "status": "converged", "iterations": 7, "chi_square": 25.0, "degrees_of_freedom": 20,
    "message": "the cost no longer falls", "findings": [{"words": "No clock is absolute."}],
    "verdict": {"grade": "care", "reasons": [
        {"grade": "care", "subject": "uav2", "words": "its mount is turned [by 38 degrees]", "advice": "look at it"},
    ]},
    "clocks": [
        {"camera": "uav1", "offset_s": 0.0, "offset_sigma_s": 0.0, "frame_rate": 25.0, "frame_rate_sigma": 0.0},
        {"camera": "uav2", "offset_s": 1.61234, "offset_sigma_s": 0.0031, "frame_rate": 24.99,
         "frame_rate_sigma": None},
    ],
    "biases": [
        {"camera": "uav1", "rotation_deg": [0.3, 0.0, 0.4], "rotation_sigma_deg": [0.1, 0.2, 0.05],
         "position_m": [0.0, 0.0, 0.0], "position_sigma_m": [0.0, 0.0, 0.0]},
    ],
    "motions": [
        {"target": "car1", "kind": "spline", "degree": 3, "typical_sigma_m": 0.384},
        {"target": "car2", "kind": "polynomial", "degree": 1, "typical_sigma_m": None},
    ],
}  # fmt: skip


def printed(capsys):
    paper().print(shown(SOLUTION))
    return [line.rstrip() for line in capsys.readouterr().out.splitlines()]


def cells(line):
    return [cell for cell in line.split("   ") if cell.strip()]


def test_the_verdict_comes_first_with_its_reasons(capsys):
    lines = printed(capsys)
    assert lines[0] == "verdict    care: read the reasons before you rely on it"
    assert lines[1] == "  ! uav2: its mount is turned [by 38 degrees]"
    assert lines[2].strip() == "look at it"


@pytest.mark.parametrize(
    "row",
    [
        ["offset", "uav2", "+1.6123 s", "0.0031 s"],
        ["frame rate", "uav2", "24.9900 Hz", "unknown"],
        ["orientation correction", "uav1", "0.5 deg", "0.2 deg"],
        ["position", "car1", "spline", "0.384 m"],
        ["position", "car2", "polynomial of order 1", "unknown"],
    ],
)
def test_everything_that_was_determined_has_a_row(capsys, row):
    rows = [[cell.strip() for cell in cells(line)] for line in printed(capsys)]
    assert row in rows


def test_what_was_held_has_no_row(capsys):
    text = "\n".join(printed(capsys))
    assert "position correction" not in text
    assert not any(line.startswith("offset") and "uav1" in line for line in text.splitlines())


def test_sigmas_have_three_figures():
    assert [told(0.123456, "m"), told(float("nan"), "m"), told(None, "s")] == ["0.123 m", "unknown", "unknown"]


def test_piped_progress_is_a_line_now_and_then(monkeypatch, capsys):
    clock = iter([0.0, 1.0, 6.0, 6.0, 7.0, 12.0, 12.0])
    monkeypatch.setattr(speaking.time, "monotonic", lambda: next(clock))
    console = Console()
    for done in (1, 2, 3, 4):
        console.progress("track uav1", done, 4)
    console.close()
    assert capsys.readouterr().err.splitlines() == ["track uav1: 2 of 4 (50 %)", "track uav1: 4 of 4 (100 %)"]


def test_what_takes_long_is_said_again_and_again_by_its_name(monkeypatch, capsys):
    monkeypatch.setattr(speaking, "LINE_EVERY_S", 0.01)
    console = Console()
    console.told_s += 1e6  # nothing is due but by waiting
    console.progress("sigmas and verdict", 0, 1)
    said = ""
    while said.count("\n") < 3:
        said += capsys.readouterr().err
    console.close()
    assert set(said.splitlines()) == {"sigmas and verdict"}


def test_quiet_says_nothing(monkeypatch, capsys):
    monkeypatch.setattr(speaking, "LINE_EVERY_S", 0.0)
    console = Console(quiet=True)
    console.progress("solve", 1, 2)
    console.say("something")
    assert capsys.readouterr() == ("", "")


def test_bars_move_on_a_terminal(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    console = Console()
    console.progress("track uav1", 1, 4)
    console.say("note: a [word] in brackets")
    console.progress("track uav1", 3, 4)
    console.close()
    assert "track uav1" in terminal.getvalue()
    assert "3/4" in terminal.getvalue()
    assert "note: a [word] in brackets" in terminal.getvalue()
