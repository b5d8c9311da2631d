"""Lists of ground control points, written by hand as OpenDroneMap and Pix4D write them."""

import pytest

from calibration.foundation.errors import InputFileError
from pipeline.survey import read_list, with_coordinates

ODM = """WGS84 UTM 16N
544256.7\t5320919.9\t5.1\t3044.2\t2622\tuav1_000012.jpg\tmast
544256.7\t5320919.9\t5.1\t4193\t1552.5\tuav2_000007.jpg\tmast
# a note

544157.7\t5320899.2\t5\t651\t927\tuav1_000012.jpg\tcorner
"""
MARKS = "image,label,x,y\nuav1_000012.jpg,mast,100.5,200.5\nuav2_000007.jpg,mast,300,400,1.5\n"
POINTS = "label,lat,lon,h,hor,ver\nmast,46.23456,6.56114,299.931,0.02,0.03\n"


def written(tmp_path, text, name="list.txt"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_opendronemap_pixels_are_ours(tmp_path):
    found = read_list(written(tmp_path, ODM))
    assert (found.kind, found.system, found.east_first) == ("OpenDroneMap", "WGS84 UTM 16N", True)
    assert [(p.name, p.first, p.second, p.height) for p in found.points] == [
        ("mast", 544256.7, 5320919.9, 5.1), ("corner", 544157.7, 5320899.2, 5.0)
    ]  # fmt: skip
    assert [(m.point, m.picture, m.x_px, m.y_px, m.line) for m in found.marks] == [
        ("mast", "uav1_000012.jpg", 3044.2, 2622.0, 2), ("mast", "uav2_000007.jpg", 4193.0, 1552.5, 3),
        ("corner", "uav1_000012.jpg", 651.0, 927.0, 6),
    ]  # fmt: skip


def test_points_without_names_are_told_apart_by_their_places(tmp_path):
    text = "EPSG:4326\n9.1 47.0 400 10 20 a_1.png\n9.1 47.0 400 11 20 a_2.png\n9.2 47.0 400 12 20 a_1.png\n"
    found = read_list(written(tmp_path, "\ufeff" + text.replace("\n", "\r\n")))
    assert [m.point for m in found.marks] == ["gcp1", "gcp1", "gcp2"]


def test_pix4d_counts_from_the_corner(tmp_path):
    marks = read_list(written(tmp_path, MARKS))
    assert [(m.x_px, m.y_px) for m in marks.marks] == [(100.0, 200.0), (299.5, 399.5)]
    found = with_coordinates(marks, written(tmp_path, POINTS, "points.csv"))
    assert found.points[0].sigma_m == 0.02
    assert found.points[0].sigma_up_m == 0.03
    assert (found.points[0].first, found.east_first) == (46.23456, False)


def test_the_origin_of_pixels_can_be_said(tmp_path):
    assert read_list(written(tmp_path, MARKS), corner=False).marks[0].x_px == 100.5
    assert read_list(written(tmp_path, ODM), corner=True).marks[0].x_px == pytest.approx(3043.7)


@pytest.mark.parametrize(
    ("text", "where", "seen"),
    [
        ("", "line 1", "nothing"),
        ("what is this\n", "line 1", "what is this"),
        (b"\xff\xfe\x00E", "line 1", "no text"),
        ("EPSG:4326\n", "line 1", "no mark"),
        ("EPSG:4326\n9 47 400 10 20\n", "line 2", "9 47 400 10 20"),
        ("EPSG:4326\n9 47 400 10 inf a_1.png\n", "line 2", "inf"),
        ("EPSG:4326\n9 47 NaN 10 20 a_1.png p\n", "line 2", "height"),
        ("EPSG:4326\n9 47 1 10 20 a_1.png p\n9 47 2 10 20 a_2.png p\n", "line 3", "other coordinates"),
        ("EPSG:4326\n9 47 1 10 20 a_1.png p\n9 47 1 11 20 a_1.png p\n", "line 3", "as in line 2"),
        ("a_1.png,p,1\na_1.png,p,1,2\n", "line 1", "a_1.png"),
        ("a_1.png,p,1,2\na_1.png,,1,2\n", "line 2", "a_1.png"),
    ],
)
def test_what_cannot_be_read_is_refused_by_line(tmp_path, text, where, seen):
    with pytest.raises(InputFileError) as caught:
        read_list(written(tmp_path, text))
    assert where in caught.value.where
    assert seen in caught.value.seen


@pytest.mark.parametrize(
    ("text", "seen"),
    [("other,1,2,3\n", 'no coordinates of "mast"'), ("mast,1,2\n", "mast,1,2"), ("mast,1,2,3,0,1\n", "accuracy"),
     ("mast,1,2,3\nmast,1,2,3\n", "second point")],
)  # fmt: skip
def test_coordinates_that_do_not_serve_are_refused(tmp_path, text, seen):
    marks = read_list(written(tmp_path, MARKS))
    with pytest.raises(InputFileError) as caught:
        with_coordinates(marks, written(tmp_path, text, "points.csv"))
    assert seen in caught.value.seen
