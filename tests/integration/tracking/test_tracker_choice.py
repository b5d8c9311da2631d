"""The coarse tracker of each camera, chosen in the flight file or on the command line."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli.main import main
from pipeline.export import read_tracks_csv, tracks_csv
from pipeline.flight import read_flight
from pipeline.stages import run_track
from pipeline.synthetic.moving_cars import Scene, first_box, render, scene, truth, write
from pipeline.tracking import track_video

FRAMES, VISIBLE = 40, 0.9


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path]:
    made = scene(31, frames=110, size=(480, 320), lengths=(22, 34), hidden=(0, 0))
    folder = tmp_path_factory.mktemp("choice")
    write(islice(render(made), FRAMES), folder / "one.avi", codec="MJPG")
    return made, folder


def flight_file(rendered: tuple[Scene, Path], name: str, line: str = "") -> Path:
    """A flight of one camera with `line` among its settings."""
    made, folder = rendered
    targets = ""
    for car in made.cars:
        box = first_box(made, car)
        sides = [float(side) for side in (box.x, box.y, box.width, box.height)]
        targets += f"[targets.{car.name}]\nboxes.uav1 = {{ frame = {box.frame}, box = {sides} }}\n"
    path = folder / f"{name}.toml"
    path.write_text(f'[cameras.uav1]\ncalibration = "none.json"\nvideo = "one.avi"\n{line}\n{targets}')
    return path


@pytest.fixture(scope="module")
def by_kcf(rendered) -> bytes:
    """The tracks that a flight file without a word about the tracker gives."""
    flight = flight_file(rendered, "plain")
    assert main(["track", str(flight), "-o", str(flight.parent / "plain"), "--quiet"]) == 0
    return (flight.parent / "plain" / "tracks.csv").read_bytes()


@pytest.fixture(scope="module")
def by_csrt(rendered) -> bytes:
    """The tracks that the command line's `--tracker csrt` gives."""
    flight = flight_file(rendered, "option")
    out = flight.parent / "option"
    assert main(["track", str(flight), "-o", str(out), "--tracker", "csrt", "--quiet"]) == 0
    return (out / "tracks.csv").read_bytes()


def test_csrt_is_within_half_a_pixel_too(rendered, by_csrt, tmp_path) -> None:
    made, _ = rendered
    (tmp_path / "tracks.csv").write_bytes(by_csrt)
    found = {track.target: track for track in read_tracks_csv(tmp_path / "tracks.csv")}
    for car in made.cars:
        true_px, share = truth(made, car, first_box(made, car))
        track = found[car.name]
        good = track.seen & (share[:FRAMES] > VISIBLE)
        assert good.sum() >= 0.95 * (share[:FRAMES] > VISIBLE).sum()
        error = track.xy_px[good] - true_px[:FRAMES][good]
        assert (np.sqrt(np.mean(error**2, axis=0)) < 0.3).all()
        assert 0.3 < np.sqrt(np.mean((error / track.sigma_px[good, None]) ** 2)) < 2.5


def test_kcf_stays_the_default_with_the_same_bytes(rendered, by_kcf, by_csrt) -> None:
    flight = read_flight(flight_file(rendered, "same"))
    camera = flight.camera("uav1")
    boxes = {target.name: target.boxes["uav1"] for target in flight.targets}
    assert camera.tracker == "kcf"
    assert tracks_csv(track_video(camera.video, camera="uav1", boxes=boxes).tracks).encode() == by_kcf
    assert by_csrt != by_kcf


def test_tracks_are_made_again_where_the_choice_changed(rendered, by_kcf, by_csrt, tmp_path) -> None:
    kcf = read_flight(flight_file(rendered, "kcf", 'tracker = "kcf"'))
    csrt = read_flight(flight_file(rendered, "csrt", 'tracker = "csrt"'))
    for flight, wanted in ((kcf, by_kcf), (csrt, by_csrt), (kcf, by_kcf)):
        assert run_track(flight, tmp_path, resume=True).skipped == ()
        assert (tmp_path / "tracks.csv").read_bytes() == wanted
        assert run_track(flight, tmp_path, resume=True).skipped == ("track",)


def test_the_command_line_goes_before_the_flight_file(rendered, by_kcf, tmp_path, capsys) -> None:
    flight = flight_file(rendered, "against", 'tracker = "csrt"')
    assert main(["track", str(flight), "-o", str(tmp_path), "--tracker", "kcf", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "done"
    assert (tmp_path / "tracks.csv").read_bytes() == by_kcf


def test_a_tracker_that_is_none_is_refused(rendered, tmp_path, capsys) -> None:
    flight = flight_file(rendered, "unknown", 'tracker = "csrtt"')
    assert main(["track", str(flight), "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert 'unknown.toml: cameras.uav1.tracker: "csrtt"' in said
    assert "did you mean 'csrt'?" in said
    assert main(["track", str(flight), "-o", str(tmp_path), "--tracker", "mosse"]) == 2
    assert "kcf" in capsys.readouterr().err
