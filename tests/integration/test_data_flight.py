"""The ready flight of data/: board photos, videos and logs in; trajectories with true uncertainties out; bad input."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.main import main
from pipeline.demo.compare import true_position
from pipeline.synthetic import read_truth
from scripts.notebooks import executed
from tests.scenes.followed import follow, told_in, unlike

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data" / "flight"
TUTORIAL = ROOT / "docs" / "tutorial.md"


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The folder in which the tutorial's commands were followed to the letter, and what each printed."""
    start = tmp_path_factory.mktemp("tutorial")
    shutil.copytree(DATA, start / "data" / "flight", ignore=shutil.ignore_patterns("uav?.json", "out"))
    return follow(told_in(TUTORIAL.read_text(encoding="utf-8")), start)


@pytest.fixture(scope="module")
def solved(followed):
    """The ready flight, calibrated and run as the tutorial does it."""
    return followed[0]


@pytest.fixture(scope="module")
def flight(solved):
    return solved


def test_the_tutorial_prints_what_it_says(followed):
    _, printed = followed
    assert len(printed) > 9
    for command, told, got in printed:
        assert unlike(told, got) == "", command


def test_the_tutorial_shows_the_flight_file_as_it_is():
    shown = re.search(r"```toml\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)[1]
    for part in shown.split("\n# ...\n"):
        assert part.strip() in (DATA / "flight.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("told", "got", "same"),
    [
        ("a  1.50 m\n...\nend", "a 1.51  m\nmore\nstill\nend", True),
        ("a 1.50 m", "a 2.50 m", False),
        ("a 1.50 m", "b 1.50 m", False),
        ("0.008", "0.010", True),
        ("first\n...\nend", "first\nend of it", False),
        ("first", "first\nsecond", False),
    ],
)
def test_what_counts_as_printed_alike(told, got, same):
    assert (unlike(told, got) == "") == same


def test_positions_are_within_their_sigmas(solved):
    truth = read_truth(solved)
    found = pd.read_csv(solved / "out" / "trajectory.csv")
    for true in truth.trajectories:
        rows = found[found.target == true.target]
        error = rows[["east_m", "north_m", "up_m"]].to_numpy() - true_position(true, rows.time_s.to_numpy())
        claimed = np.sqrt(np.mean(rows.cov_ee + rows.cov_nn + rows.cov_uu))
        assert 0.05 * claimed < np.sqrt(np.mean(np.sum(error**2, axis=1))) < 2.0 * claimed
        assert claimed < 5.0


def test_the_clock_is_within_its_sigmas(solved):
    truth = read_truth(solved)
    clock = pd.read_csv(solved / "out" / "timing.csv").set_index("camera").loc["uav2"]
    assert abs(clock.offset_s - truth.offset_s["uav2"]) < 3 * clock.offset_sigma_s
    assert abs(clock.frame_rate - truth.frame_rate["uav2"]) < 3 * clock.frame_rate_sigma
    assert clock.offset_sigma_s < 0.1


def test_the_bridge_is_marked_as_a_loss_and_nothing_is_invented_under_it(solved):
    truth = read_truth(solved)
    tracks = pd.read_csv(solved / "out" / "tracks.csv")
    van = tracks[(tracks.target == "van") & (tracks.camera == "uav1")].set_index("frame")
    true = next(t for t in truth.tracks if t.target == "van" and t.camera == "uav1")
    hidden = [f for f in true.frame[~true.seen] if f in van.index]
    assert len(hidden) > 10
    assert (van.loc[hidden].state == "lost").all()
    assert (van.state == "reacquired").any()


def test_frame_poses_are_written_measured_and_refined(solved):
    poses = pd.read_csv(solved / "out" / "poses.csv")
    assert (poses.groupby("camera").frame.count() == 200).all()
    assert poses.filter(like="refined_").notna().all().all()


def test_the_report_shows_every_first_fix_and_the_bridge(solved):
    page = (solved / "out" / "report.html").read_text(encoding="utf-8")
    shown = re.findall(r"<title>(\w+) in (uav\d), frame \d+: (its first fix|its last fix|the fix that found)", page)
    first = [(target, camera) for target, camera, kind in shown if kind == "its first fix"]
    assert sorted(first) == sorted((t, c) for t in ("car", "truck", "van", "pickup") for c in ("uav1", "uav2"))
    assert {(t, c) for t, c, kind in shown if kind != "its first fix"} == {("van", "uav1"), ("van", "uav2")}
    assert page.count('<image href="data:image/jpeg;base64,') == len(shown) + page.count("an outlier,")
    assert page.count('class="film"') == 2
    assert page.count('<image href="data:image/webp;base64,') == page.count('class="map"')
    assert len(page) < 2_000_000


def test_the_scripts_over_the_python_api(solved, tmp_path):
    def script(name, *arguments):
        command = [sys.executable, str(ROOT / "scripts/examples" / name), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "focal length" in script("calibrate_camera.py", solved / "board-uav1", tmp_path / "camera.json")
    assert "car: from" in script("process_flight.py", solved / "flight.toml", solved / "out")
    assert "uav2: starts 1.6" in script("tracker_to_trajectory.py", solved / "flight.toml")


def refused(capsys, flight: Path, out: Path, command: str = "run") -> tuple[int, str]:
    code = main([command, str(flight), "-o", str(out)])
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert said.count("runningfix: ") == 1, said
    assert not list(out.rglob("*.part"))
    return code, said


def changed(flight: Path, name: str, old: str, new: str) -> Path:
    """A flight file beside the others with one thing changed."""
    text = (flight / "flight.toml").read_text()
    assert old in text
    path = flight / name
    path.write_text(text.replace(old, new, 1))
    return path


def test_a_truncated_video(capsys, flight, tmp_path):
    (flight / "short.mp4").write_bytes((flight / "uav1.mp4").read_bytes()[:20_000])
    code, said = refused(capsys, changed(flight, "short.toml", '"uav1.mp4"', '"short.mp4"'), tmp_path)
    assert code == 3
    assert "short.mp4" in said


def test_a_video_that_is_none(capsys, flight, tmp_path):
    (flight / "words.mp4").write_text("this is no video")
    code, said = refused(capsys, changed(flight, "words.toml", '"uav1.mp4"', '"words.mp4"'), tmp_path)
    assert code == 3
    assert "words.mp4" in said


def test_a_missing_video_is_found_before_long_work(capsys, flight, tmp_path):
    code, said = refused(capsys, changed(flight, "none.toml", '"uav2.mp4"', '"none.mp4"'), tmp_path)
    assert code == 3
    assert "none.mp4: no such file" in said
    assert not list(tmp_path.iterdir())


def test_a_box_outside_the_image(capsys, flight, tmp_path):
    path = flight / "outside.toml"
    text = (flight / "flight.toml").read_text()
    head, _, tail = text.partition("boxes.uav1 = { frame = ")
    rest = tail.partition("}")[2]
    path.write_text(f"{head}boxes.uav1 = {{ frame = 0, box = [2000, 100, 20, 20] }}{rest}")
    code, said = refused(capsys, path, tmp_path, "track")
    assert code == 2
    assert "box" in said
    assert "640" in said


def test_a_log_of_another_day(capsys, flight, tmp_path):
    path = changed(flight, "day.toml", 'start = "camera-event"', "start = 2025-06-02T09:30:00Z")
    code, said = refused(capsys, path, tmp_path, "poses")
    assert code == 3
    assert "uav1" in said
    assert not list(tmp_path.iterdir())


def test_a_start_that_the_log_cannot_tell(capsys, flight, tmp_path):
    text = (flight / "flight.toml").read_text()
    first, second = text.split("[cameras.uav2]")
    path = flight / "utc.toml"
    start = second.replace('start = "camera-event"', "start = 2025-06-01T09:30:00Z", 1)
    path.write_text(f"{first}[cameras.uav2]{start}")
    code, said = refused(capsys, path, tmp_path, "poses")
    assert code == 3
    assert "SYSTEM_TIME" in said


def test_a_miscounted_board(capsys, flight, tmp_path):
    arguments = ["--board", "8x5", "--square-mm", "25", "-o", str(tmp_path / "camera.json")]
    assert main(["calibrate", str(flight / "board-uav1"), *arguments]) == 2
    said = capsys.readouterr().err
    assert "looks like 9x6" in said
    assert not (tmp_path / "camera.json").exists()


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda p: p.stem)
def test_a_notebook_shows_what_its_cells_give(solved, path):
    """Executed anew in the flight that the tutorial left; figures of its outputs as close as the tutorial's."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    for told, got in zip(kept["cells"], executed(kept, solved)["cells"], strict=True):
        if told["cell_type"] == "code":
            assert [sorted(o.get("data", {})) for o in told["outputs"]] == [
                sorted(o.get("data", {})) for o in got["outputs"]
            ]
            texts = [
                "".join("".join(o.get("text") or o["data"]["text/plain"]) for o in c["outputs"]) for c in (told, got)
            ]
            assert unlike(*texts) == "", told["source"]
