"""Names that are common where the target is, and nobody's else."""

from pipeline.matching import MatchedTarget, TrackName
from pipeline.stages.matching.names import common_names


def target(*tracks):
    return MatchedTarget(tracks=tuple(TrackName(camera=c, target=t) for c, t in tracks))


def test_a_common_target_is_called_as_its_first_camera_calls_it():
    names = common_names([target(("a", "car"), ("b", "t7")), target(("a", "t7"))])
    assert {str(k): v for k, v in names.items()} == {"a:car": "car", "b:t7": "car", "a:t7": "t7-a"}


def test_strangers_of_one_name_are_told_apart():
    names = common_names([target(("a", "1"), ("b", "2")), target(("a", "2")), target(("b", "1"))])
    assert {str(k): v for k, v in names.items()} == {"a:1": "1", "b:2": "1", "a:2": "2-a", "b:1": "1-b"}
    assert len(set(names.values())) == 3


def test_no_two_targets_share_a_name_however_they_were_called():
    names = common_names([target(("a", "x-b")), target(("b", "x")), target(("a", "x")), target(("c", "x-b"))])
    assert len(set(names.values())) == 4
