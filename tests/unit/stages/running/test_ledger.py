"""What a resumed run takes for finished."""

import pickle

import pytest

from calibration.foundation.errors import GeometryError, TrackingError, WriteError
from calibration.foundation.files import write_whole
from pipeline.stages.running.ledger import FOLDER, Ledger, key_of


@pytest.fixture
def ledger(tmp_path):
    found = Ledger(tmp_path)
    found.record("poses", "key-1", {"poses.csv": "measured\n"})
    return found


def test_a_stage_is_finished_with_the_same_key_and_whole_files(ledger):
    assert ledger.finished("poses", "key-1")
    assert not ledger.finished("poses", "key-2")
    assert not ledger.finished("solve", "key-1")


def test_a_changed_or_missing_file_makes_its_stage_unfinished(ledger):
    (ledger.out / "poses.csv").write_text("someone else's\n")
    assert not ledger.finished("poses", "key-1")
    (ledger.out / "poses.csv").unlink()
    assert not ledger.finished("poses", "key-1")


def test_a_later_stage_may_rewrite_a_file(ledger):
    ledger.record("solve", "key-s", {"poses.csv": "measured,refined\n", "timing.csv": "t\n"})
    assert ledger.finished("poses", "key-1")
    assert ledger.finished("solve", "key-s")
    assert set(ledger.files("solve")) == {"poses.csv", "timing.csv"}


def test_a_broken_entry_counts_as_not_there(ledger):
    (ledger.out / FOLDER / "poses.json").write_text('{"key": "key-1", "fil')
    assert not ledger.finished("poses", "key-1")


def test_keys_depend_on_content_not_on_order():
    assert key_of({"a": 1, "b": [2.0]}) == key_of({"b": [2.0], "a": 1})
    assert key_of({"a": 1}) != key_of({"a": 2})


def test_a_failed_write_leaves_the_old_file_and_no_part(tmp_path, monkeypatch):
    target = tmp_path / "a.csv"
    write_whole(target, "old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(WriteError, match="No space left"):
        write_whole(target, "new")
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_a_folder_that_is_a_file_is_a_write_error(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(WriteError) as caught:
        write_whole(tmp_path / "out" / "a.csv", "x")
    assert caught.value.exit_code == 6


@pytest.mark.parametrize("kind", [GeometryError, TrackingError])
def test_errors_cross_process_borders_whole(kind):
    error = kind(where="here", seen="that", expected="this", advice="so")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (kind, str(error))
    assert again.exit_code == error.exit_code
