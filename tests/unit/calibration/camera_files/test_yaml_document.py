import pytest

from calibration.camera_files.yaml_document import YamlDocumentError, parse_yaml

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
    found = parse_yaml(KALIBR)
    assert found["cam0"]["T_cam_imu"] == [[0.01, -0.99, 0.02, 0.0], [0.0, 0.0, 0.0, 1.0]]
    assert found["cam0"]["rostopic"] == "/cam0/image_raw"
    assert found["cam1"] == {"timeshift": -1.5e-3}


def test_opencv_tags_and_lists_over_several_lines():
    text = "%YAML:1.0\n---\nm: !!opencv-matrix\n   rows: 2\n   data: [ 1., 2.,\n       .Nan, -4e-1 ]\nflag: true\n"
    found = parse_yaml(text)
    assert found["m"]["rows"] == 2
    assert found["m"]["data"][:2] == [1.0, 2.0]
    assert found["m"]["data"][2] != found["m"]["data"][2]
    assert found["flag"] is True


def test_texts_lists_of_mappings_and_braces():
    found = parse_yaml("a: 'x: # y'\nb:\n- name: one\n  k: 1\n- name: two\nc: {p: 1, q: [2, 3]}\nd:\n")
    assert found == {
        "a": "x: # y",
        "b": [{"name": "one", "k": 1}, {"name": "two"}],
        "c": {"p": 1, "q": [2, 3]},
        "d": None,
    }


@pytest.mark.parametrize(
    ("text", "line"),
    [("a: [1, 2\nb: 3\n", "from line 1"), ("a: 1\njust words\n", "line 2"), ("a: 1\nb: *x\n", "line 2"),
     ("a: [1 2] 3\n", "line 1"), ("", "nothing"), ("---\n...\n", "nothing"), ("a: 1\n   b: 2\n", "line 2"),
     ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' twice"), ("c: {fx: 1, fx: 2}\n", "line 1: the key 'fx' twice"),
     ("a: 1\n---\na: 2\n", "line 3: 2 documents"), ("? [1, 2]\n: 3\n", "a key that is a list"),
     ("a: &x [1, *x]\n", "contains itself"), ("a: !!python/object:os.system 1\n", "line 1"),
     ("a: \x00\n", "unacceptable character"), ("[" * 5000, "nested too deeply")],
)  # fmt: skip
def test_what_is_not_understood_names_its_line(text, line):
    with pytest.raises(YamlDocumentError, match=line):
        parse_yaml(text)


def test_aliases_are_read_but_cannot_fill_the_memory():
    assert parse_yaml("a: &x [1, 2]\nb: *x\n") == {"a": [1, 2], "b": [1, 2]}
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    with pytest.raises(YamlDocumentError, match="aliases are written out"):
        parse_yaml("\n".join(lines))


def test_numbers_are_numbers_and_words_are_words():
    text = (
        "a: 1e-05\nb: 010\nc: yes\nd: 2026-01-02\ne: 1:20\nf: .5\ng: -.inf\nh: 1_000\ni: 0x10\nj: True\nk: +3\nl: 1.\n"
    )
    assert parse_yaml(text) == {
        "a": 1e-5, "b": 10, "c": "yes", "d": "2026-01-02", "e": "1:20", "f": 0.5, "g": float("-inf"), "h": "1_000",
        "i": "0x10", "j": True, "k": 3, "l": 1.0,
    }  # fmt: skip


def test_what_ros2_prints_ends_with_a_rule_and_is_one_document():
    assert parse_yaml("k: [1.0, 2.0]\nd:\n- 0.1\n- 0.2\n---\n") == {"k": [1.0, 2.0], "d": [0.1, 0.2]}


def test_a_text_of_several_lines_is_one_text():
    assert parse_yaml("note: |\n  one: two\n  three\nlong: words that go\n  on\n") == {
        "note": "one: two\nthree\n",
        "long": "words that go on",
    }
