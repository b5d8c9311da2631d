"""`board`, `calibrate` and `boresight` as users run them."""

import json
import re

import cv2
import numpy as np
import pytest

from calibration import Board, read_camera
from calibration.boards.charuco import charuco_board
from pipeline.cli.main import main
from pipeline.synthetic.board_views import camera, poses, true_corners
from tests.scenes.calibration import rendered_photos
from tests.scenes.table_flight import write_table_flight


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boards")
    for name, focal in (("left", 405.0), ("right", 430.0)):
        (folder / name).mkdir()
        for i, shot in enumerate(rendered_photos(camera(480, 360, focal), 8, seed=6)[0]):
            cv2.imwrite(str(folder / name / f"p{i}.png"), shot)
    return folder


BOARD = ["--board", "9x6", "--square-mm", "25"]


@pytest.mark.parametrize(("name", "begin"), [("board.pdf", b"%PDF-"), ("board.svg", b"<svg")])
def test_a_board_is_printed_at_true_scale(tmp_path, name, begin, capsys):
    path = tmp_path / name
    assert main(["board", *BOARD, "-o", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == [str(path)]
    page = path.read_bytes()
    assert page.startswith(begin)
    if name.endswith("svg"):
        assert 'width="300mm" height="225mm"' in page.decode()
        assert "h25.0000v25.0000" in page.decode()
    else:
        width, height = map(float, re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", page).groups())
        assert (width / 72 * 25.4, height / 72 * 25.4) == (pytest.approx(300), pytest.approx(225))


def test_a_board_of_no_known_kind(tmp_path, capsys):
    assert main(["board", *BOARD, "-o", str(tmp_path / "board.png")]) == 2
    assert ".pdf or .svg" in capsys.readouterr().err
    charuco = [*BOARD, "--marker-mm", "18", "--dictionary", "DICT_9X9"]
    assert main(["board", *charuco, "-o", str(tmp_path / "board.pdf")]) == 2
    assert not list(tmp_path.iterdir())


def test_several_cameras_at_once(boards, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    sources = [str(boards / "left"), str(boards / "right"), str(tmp_path / "empty")]
    command = ["calibrate", *sources, *BOARD, "--each", "-o", str(tmp_path / "out"), "--report", "--json"]
    assert main(command) == 3
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert "empty" in told.err
    assert report["cameras"]["empty"]["exit_code"] == 3
    for name, focal in (("left", 405.0), ("right", 430.0)):
        assert read_camera(tmp_path / "out" / f"{name}.json").K[0, 0] == pytest.approx(focal, rel=1e-3)
        page = (tmp_path / "out" / f"{name}.html").read_text()
        assert page.count("data:image/jpeg;base64,") == 8
        assert "http" not in page
    assert len(report["files"]) == 4


def test_a_verdict_below_what_was_asked_for_has_an_exit_code(boards, tmp_path, capsys):
    few = [str(boards / "left" / f"p{i}.png") for i in range(4)]
    command = ["calibrate", *few, *BOARD, "-o", str(tmp_path / "c.json"), "--json"]
    assert main(command) == 0
    assert main([*command, "--at-least", "usable"]) == 5
    assert json.loads(capsys.readouterr().out.split("}\n{")[0] + "}")["verdict"] == "poor"
    assert (tmp_path / "c.json").exists()


def test_another_format_and_chosen_terms(boards, tmp_path):
    path = tmp_path / "c.yaml"
    assert (
        main(["calibrate", str(boards / "left"), *BOARD, "--terms", "4", "--format", "ros", "-o", str(path), "-q"]) == 0
    )
    assert "plumb_bob" in path.read_text()
    assert read_camera(path).distortion[4] == 0


def test_charuco_photos_with_a_part_hidden(tmp_path):
    board, lens = (
        Board(cols=7, rows=5, square_m=0.03, marker_m=0.022, dictionary="DICT_5X5_100"),
        camera(800, 600, 700.0),
    )
    sheet = charuco_board(board).generateImage((960, 720), marginSize=0)
    flat = (board.points_m[:, :2] / 0.03 + 1) * 120 - 0.5
    for i, pose in enumerate(poses(9, 4, lens, board, fill=0.6)):
        pinhole = camera(800, 600, 700.0, (0.0,) * 5)
        place, _ = cv2.findHomography(flat, true_corners(pinhole, board, pose))
        shot = cv2.warpPerspective(sheet, place, (800, 600), borderValue=200, flags=cv2.INTER_AREA)
        shot = cv2.GaussianBlur(shot, (0, 0), 0.8)
        if i % 3 == 0:
            x = int(true_corners(pinhole, board, pose)[:, 0].mean())
            shot[:, x + 40 :] = 128
        cv2.imwrite(str(tmp_path / f"p{i}.png"), shot)
    command = ["calibrate", str(tmp_path), "--board", "7x5", "--square-mm", "30", "--marker-mm", "22"]
    assert main([*command, "--dictionary", "DICT_5X5_100", "-o", str(tmp_path / "c.json"), "-q"]) == 0
    assert read_camera(tmp_path / "c.json").K[0, 0] == pytest.approx(700, rel=5e-3)


def test_boresight_against_a_solved_flight(tmp_path, capsys):
    flight, _ = write_table_flight(tmp_path)
    assert main(["boresight", str(flight), "-o", str(tmp_path / "out")]) == 3
    assert "trajectory.csv" in capsys.readouterr().err
    assert main(["solve", str(flight), "-o", str(tmp_path / "out"), "-q"]) == 0
    assert main(["boresight", str(flight), "-o", str(tmp_path / "out"), "--json"]) == 0
    cameras = json.loads(capsys.readouterr().out)["cameras"]
    solved = json.loads((tmp_path / "out" / "solution.json").read_text())["biases"]
    for bias in solved:
        found = cameras[bias["camera"]]
        turn = np.linalg.norm(bias["rotation_deg"])
        size = np.linalg.norm(list(found["correction"].values()))
        assert abs(size - turn) < 3 * max(found["sigma_deg"]) + 0.1
    assert json.loads((tmp_path / "out" / "boresight.json").read_text())["cameras"].keys() == cameras.keys()


def test_boresight_needs_target_and_place(tmp_path, capsys):
    flight, _ = write_table_flight(tmp_path)
    start = ["boresight", str(flight), "-o", str(tmp_path / "out")]
    assert main([*start, "--still", "mast"]) == 2
    assert main([*start, "--still", "mast", "--at", "28.2", "112.9", "60"]) == 2
    assert "a tracked target" in capsys.readouterr().err
    assert main([*start, "--still", "mast", "--at", "98.2", "112.9", "60"]) == 2
