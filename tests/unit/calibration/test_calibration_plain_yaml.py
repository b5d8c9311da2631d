import pytest

from calibration.plain_yaml import PlainYamlError, parse_plain_yaml

KALIBR = """cam0:   # left
  cam_overlaps: [1]
  T_cam_imu:
  - [0.01, -0.99, 0.02, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  intrinsics: [461.6, 460.3, 363.0, 248.1]
  rostopic: /cam0/image_raw
cam1:
  timeshift: -1.5e-3
"""


def test_kalibr_camchain():
    found = parse_plain_yaml(KALIBR)
    assert found["cam0"]["T_cam_imu"] == [[0.01, -0.99, 0.02, 0.0], [0.0, 0.0, 0.0, 1.0]]
    assert found["cam0"]["rostopic"] == "/cam0/image_raw"
    assert found["cam1"] == {"timeshift": -1.5e-3}


def test_opencv_tags_and_lists_over_several_lines():
    text = "%YAML:1.0\n---\nm: !!opencv-matrix\n   rows: 2\n   data: [ 1., 2.,\n       .Nan, -4e-1 ]\nflag: true\n"
    found = parse_plain_yaml(text)
    assert found["m"]["rows"] == 2
    assert found["m"]["data"][:2] == [1.0, 2.0]
    assert found["m"]["data"][2] != found["m"]["data"][2]
    assert found["flag"] is True


def test_texts_lists_of_mappings_and_braces():
    found = parse_plain_yaml("a: 'x: # y'\nb:\n- name: one\n  k: 1\n- name: two\nc: {p: 1, q: [2, 3]}\nd:\n")
    assert found == {
        "a": "x: # y",
        "b": [{"name": "one", "k": 1}, {"name": "two"}],
        "c": {"p": 1, "q": [2, 3]},
        "d": None,
    }


@pytest.mark.parametrize(
    ("text", "line"),
    [("a: [1, 2\nb: 3\n", "line 1"), ("a: 1\njust words\n", "line 2"), ("a: &x 1\n", "line 1"),
     ("a: [1 2] 3\n", "line 1"), ("", "nothing"), ("a: 1\n   b: 2\n", "line 2")],
)  # fmt: skip
def test_what_is_not_understood_names_its_line(text, line):
    with pytest.raises(PlainYamlError, match=line):
        parse_plain_yaml(text)
