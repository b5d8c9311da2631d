import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration import Board, calibrate, calibrate_files, read_camera, write_camera
from calibration.boards.charuco import charuco_board
from calibration.foundation.errors import InputFileError, UsageError
from calibration.photos.metadata import metadata_of
from calibration.photos.reading import find_photos, read_photo
from calibration.stages.from_files import spread_out
from pipeline.synthetic.board_views import camera
from tests.scenes.calibration import BOARD, computed_views, rendered_photos


@pytest.fixture(scope="session")
def shots():
    return rendered_photos(camera(480, 360, 405.0), 9, seed=6)[0]


@pytest.fixture
def folder(tmp_path, shots):
    made = tmp_path / "photos"
    made.mkdir()
    for i, shot in enumerate(shots):
        cv2.imwrite(str(made / f"p{i}.png"), shot)
    (made / "notes.txt").write_text("not a photo")
    return made


def with_exif(jpeg: bytes, orientation: int, model: str) -> bytes:
    """The JPEG with an EXIF segment before the picture."""
    name = model.encode() + b"\0"
    directory = struct.pack("<H", 2) + struct.pack("<HHII", 0x0110, 2, len(name), 38)
    directory += struct.pack("<HHIHH", 0x0112, 3, 1, orientation, 0) + struct.pack("<I", 0)
    tiff = b"II*\0" + struct.pack("<I", 8) + directory + name
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


def test_a_folder_becomes_a_camera_file(folder, tmp_path):
    told = []
    found = calibrate_files([folder], BOARD, progress=lambda done, total: told.append((done, total)))
    assert told == [(i + 1, 9) for i in range(9)]
    assert found.camera.K[0, 0] == pytest.approx(405, rel=1e-3)
    assert found.rms_px < 0.06
    write_camera(tmp_path / "camera.json", found.camera)
    again = read_camera(tmp_path / "camera.json")
    np.testing.assert_allclose(again.covariance, found.camera.covariance, rtol=1e-9)
    assert again.made["views"] == 9


def test_files_and_patterns_name_the_same_photos(folder):
    every = find_photos([folder]).photos
    assert find_photos([folder / "*.png"]).photos == every
    assert find_photos([*every, folder]).photos == every
    assert len(every) == 9


def test_swapped_columns_and_rows_are_the_same_board(folder):
    assert calibrate_files([folder], Board(cols=6, rows=9, square_m=0.025)).camera.K[0, 0] == pytest.approx(
        405, rel=1e-3
    )


@pytest.mark.parametrize("text", ["10x7", "8x5", "8x6", "7x6"])
def test_a_miscounted_board_is_told_its_size(folder, text):
    with pytest.raises(UsageError, match="looks like 9x6") as error:
        calibrate_files([folder], Board.parse(text, square_mm=25))
    assert error.value.exit_code == 2


def test_no_board_at_all_names_the_photos(tmp_path):
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"empty{i}.png"), np.full((120, 160), 90, np.uint8))
    with pytest.raises(InputFileError, match=r"empty0\.png.*in none"):
        calibrate_files([tmp_path], BOARD)


def test_a_photo_without_the_board_is_left_out_and_named(folder):
    cv2.imwrite(str(folder / "wall.png"), np.full((360, 480), 90, np.uint8))
    found = calibrate_files([folder], BOARD)
    assert [(r.name, r.reason) for r in found.rejected] == [("wall.png", "the board was not found")]
    assert any("wall.png" in words for words in found.warnings)


def test_mixed_sizes_are_named(folder, shots):
    cv2.imwrite(str(folder / "small.png"), cv2.resize(shots[0], (240, 180)))
    with pytest.raises(InputFileError, match=r"small\.png \(240x180\)"):
        calibrate_files([folder], BOARD)


@pytest.mark.parametrize("content", [b"", b"not a photo", b"\x89PNG\r\n\x1a\n" + b"\0" * 50])
def test_damaged_photos_are_named(folder, content):
    (folder / "p3.png").write_bytes(content)
    with pytest.raises(InputFileError, match=r"p3\.png") as error:
        calibrate_files([folder], BOARD)
    assert error.value.exit_code == 3


def test_nothing_to_read(tmp_path):
    with pytest.raises(InputFileError, match="no such file or folder"):
        find_photos([tmp_path / "none"])
    with pytest.raises(InputFileError, match="no photos"):
        find_photos([tmp_path])
    (tmp_path / "log.tlog").write_bytes(b"x")
    with pytest.raises(InputFileError, match=r"a \.tlog file"):
        find_photos([tmp_path / "log.tlog"])


def test_pixels_stay_as_stored_whatever_exif_says(tmp_path):
    image = np.zeros((40, 60), np.uint8)
    image[:20] = 200
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    (tmp_path / "up.jpg").write_bytes(with_exif(jpeg, 6, "X100"))
    photo = read_photo(tmp_path / "up.jpg")
    assert photo.gray.shape == (40, 60)
    assert photo.taken == {"camera": "X100", "orientation": "6", "turned_deg": "0"}
    assert metadata_of(with_exif(jpeg, 6, "X100")[:40]) == {}
    assert metadata_of(b"") == {}


def test_photos_of_two_cameras_by_their_own_word(tmp_path, shots):
    for i, shot in enumerate(shots[:4]):
        jpeg = cv2.imencode(".jpg", shot)[1].tobytes()
        (tmp_path / f"p{i}.jpg").write_bytes(with_exif(jpeg, 1, "ILCE-7" if i < 3 else "EOS M50"))
    with pytest.raises(InputFileError, match=r"EOS M50: p3\.jpg"):
        calibrate_files([tmp_path], BOARD)


def test_a_mirrored_charuco_board_is_refused_as_such(tmp_path):
    board = Board(cols=7, rows=5, square_m=0.03, marker_m=0.021, dictionary="DICT_5X5_100")
    sheet = charuco_board(board).generateImage((480, 360), marginSize=0)
    for i in range(3):
        place = np.array([[0.9, 0.05 * i, 30], [-0.05, 0.85, 40], [5e-5, 1e-5, 1]])
        shot = cv2.warpPerspective(sheet, place, (480, 360), borderValue=200, flags=cv2.INTER_AREA)
        cv2.imwrite(str(tmp_path / f"p{i}.png"), shot[:, ::-1])
    with pytest.raises(InputFileError, match=r"a mirrored board.* 3 of 3") as error:
        calibrate_files([tmp_path], board)
    assert error.value.exit_code == 3


def test_a_mirrored_checkerboard_is_the_same_pattern_and_gives_the_mirrored_camera():
    """Nothing in the photos can tell; the camera that is found belongs to the photos as they are."""
    lens = camera()
    views = computed_views(lens, 12)
    rows, cols = BOARD.rows, BOARD.cols
    order = np.arange(rows * cols).reshape(rows, cols)[::-1].ravel()
    flipped = [replace(v, corners=((639, 0) + v.corners * (-1, 1))[order]) for v in views]
    found = calibrate(flipped, BOARD)
    assert found.camera.K[0, 2] == pytest.approx(639 - lens.K[0, 2], abs=4 * found.sigma[2])
    assert found.camera.K[0, 0] == pytest.approx(lens.K[0, 0], abs=4 * found.sigma[0])


def test_mirrored_photos_among_others_are_named():
    lens = camera()
    views = computed_views(lens, 15)
    order = np.arange(54).reshape(6, 9)[::-1].ravel()
    flipped = [
        replace(v, corners=((639, 0) + v.corners * (-1, 1))[order]) if i in (4, 9) else v for i, v in enumerate(views)
    ]
    found = calibrate(flipped, BOARD)
    assert {r.name for r in found.rejected} == {views[4].name, views[9].name}
    assert found.verdict != "good"


def test_a_video_is_as_good_as_photos(tmp_path, shots):
    path = tmp_path / "board.avi"
    out = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (480, 360))
    for shot in shots:
        for _ in range(2):
            out.write(cv2.cvtColor(shot, cv2.COLOR_GRAY2BGR))
    out.release()
    found = calibrate_files([path], BOARD)
    assert len(found.views) == 9
    assert found.views[0].name.startswith("board.avi#")
    assert found.camera.K[0, 0] == pytest.approx(405, rel=3e-3)


def test_a_damaged_video_is_named(tmp_path):
    (tmp_path / "cut.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + b"\0" * 100)
    with pytest.raises(InputFileError, match=r"cut\.mp4"):
        calibrate_files([tmp_path / "cut.mp4"], BOARD)


def test_views_of_a_video_are_thinned_to_those_that_differ():
    views = computed_views(camera(), 6)
    chosen = spread_out([v for v in views for _ in range(5)], 10)
    assert [v.name for v in chosen] == [v.name for v in views]
    assert len(spread_out(views, 4)) == 4
    assert spread_out([], 4) == []


def test_blurred_frames_of_a_video_are_passed_over():
    views = [replace(v, blur_px=(0.8, 0.9)) for v in computed_views(camera(), 6)]
    smeared = [replace(v, name=f"{v.name}-smeared", blur_px=(0.8, 2.5)) for v in computed_views(camera(), 3, seed=9)]
    chosen = spread_out([*smeared, *views], 20)
    assert [v.name for v in chosen] == [v.name for v in views]
