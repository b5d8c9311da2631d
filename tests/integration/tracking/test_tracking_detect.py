"""Boxes without a mouse: what moves is proposed, what stands still is not; the commands around it."""

from __future__ import annotations

import json
import tomllib
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.cli.main import main
from pipeline.synthetic.moving_cars import first_box, render, scene, truth, write
from pipeline.tracking import propose_targets

FRAMES, SIZE = 60, (480, 320)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    made = scene(31, frames=110, size=SIZE, lengths=(22, 34), hidden=(0, 0))
    path = tmp_path_factory.mktemp("detect") / "uav1.avi"
    write(islice(render(made), FRAMES), path, codec="MJPG")
    return made, path


def test_every_car_is_proposed_and_nothing_else_first(video, capsys, tmp_path) -> None:
    made, path = video
    assert main(["detect", str(path), "-o", str(tmp_path / "d"), "--json", "--most", "5"]) == 0
    summary = json.loads(capsys.readouterr().out)
    middles = []
    for proposal in summary["targets"][:2]:
        x, y, w, h = proposal["box"]
        at = proposal["frame"]
        off = [
            float(np.hypot(*(np.array([x + w / 2, y + h / 2]) - truth(made, car, first_box(made, car))[0][at])))
            for car in made.cars
        ]
        middles.append(int(np.argmin(off)))
        assert min(off) < 0.35 * made.cars[middles[-1]].size[0]
    assert sorted(middles) == [0, 1]
    sheet = cv2.imread(str(tmp_path / "d" / "contact.png"))
    assert sheet.shape[0] > 100 * len(summary["targets"])
    boxes = tomllib.loads((tmp_path / "d" / "boxes.toml").read_text())["targets"]
    assert boxes["uav1-1"]["boxes"]["uav1"]["box"] == summary["targets"][0]["box"]


def test_nothing_moving_is_exit_code_4(capsys, tmp_path) -> None:
    still = cv2.resize(np.random.default_rng(1).integers(0, 255, (40, 60, 3), dtype=np.uint8), SIZE)
    path = tmp_path / "still.avi"
    write(iter([np.roll(still, f, axis=1) for f in range(30)]), path, codec="MJPG")
    assert main(["detect", str(path), "-o", str(tmp_path / "d")]) == 4
    assert "nothing that moves on its own" in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(("name", "code"), [("none.mp4", 3), ("text.mp4", 3)])
def test_what_is_no_video_is_refused(capsys, tmp_path, name, code) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    assert main(["detect", str(tmp_path / name), "-o", str(tmp_path / "d")]) == code
    assert name in capsys.readouterr().err


def test_overlay_command_writes_the_drawn_video(video, capsys, tmp_path: Path) -> None:
    made, path = video
    box = first_box(made, made.cars[1], 20)
    flight = tmp_path / "flight.toml"
    flight.write_text(
        f'[cameras.uav1]\ncalibration = "none.json"\nvideo = "{path}"\n\n[targets.car]\nboxes.uav1 = '
        f"{{ frame = 20, box = [{box.x}, {box.y}, {box.width}, {box.height}] }}\n"
    )
    out = tmp_path / "out"
    assert main(["track", str(flight), "-o", str(out), "--overlay", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    files = said["files"]
    assert any("none.json does not exist yet" in line for line in said["warnings"])
    assert files == [str(out / "tracks.csv"), str(out / "overlay-uav1.mp4")]
    capture = cv2.VideoCapture(files[1])
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES


def test_most_limits_the_proposals(video) -> None:
    _, path = video
    assert len(propose_targets(path, most=1)) == 1
