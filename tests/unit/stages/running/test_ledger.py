"""What a resumed run takes for finished."""

import contextlib
import json
import os
import pickle

import pytest

from calibration.foundation.errors import GeometryError, TrackingError, WriteError
from calibration.foundation.files import write_whole
from pipeline.stages.running.ledger import FOLDER, Ledger, key_of, writing
from pipeline.stages.running.provenance import file_hash


@pytest.fixture
def ledger(tmp_path):
    found = Ledger(tmp_path)
    found.record("poses", "key-1", {"poses.csv": "measured\n"})
    return found


def names(folder):
    return {p.name for p in folder.iterdir()} - {FOLDER}


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


def test_a_later_stage_owns_what_it_rewrote(ledger):
    ledger.record("solve", "key-s", {"poses.csv": "measured,refined\n", "timing.csv": "t\n"})
    ledger.record("poses", "key-1", {"poses.csv": "measured\n"})
    assert not ledger.finished("solve", "key-s"), "the refined poses are gone"


def test_another_reader_of_the_folder_knows_the_same(ledger):
    ledger.record("track", "key-t", {"tracks.csv": "t"}, warnings=("uav1: lost",))
    again = Ledger(ledger.out)
    assert again.finished("poses", "key-1")
    assert again.warnings("track") == ("uav1: lost",)


@pytest.mark.parametrize(
    "content",
    [
        b'{"key": "key-1", "fil', b"\xff\xfe", b"[]", b"3", b'{"stages": 3, "files": []}', b"[" * 100_000,
        b'{"stages": {"poses": {"key": "key-1", "files": ["../poses.csv", 3]}}, "files": {"a": {"sha256": 4}}}',
        b'{"stages": {"poses": {"key": "key-1", "files": "poses.csv"}}}',
        b'{"files": {"../x": {"sha256": "", "stage": ""}}}',
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["ledger.json", "pending.json"])
def test_a_ledger_of_any_content_is_survived(ledger, content, name):
    (ledger.out / FOLDER / name).write_bytes(content)
    with writing(ledger.out) as again:
        assert again.finished("poses", "key-1") == (name == "pending.json")
        again.record("poses", "key-1", {"poses.csv": "measured\n"})
        assert again.finished("poses", "key-1")
    assert names(ledger.out) == {"poses.csv"}


def test_a_ledger_from_elsewhere_does_not_reach_out_of_its_folder(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    out = tmp_path / "out"
    sha = file_hash(tmp_path / "mine.txt")
    (out / FOLDER).mkdir(parents=True)
    for name in ("../mine.txt", str(tmp_path / "mine.txt")):
        content = {
            "stages": {"solve": {"key": "k", "files": [name]}},
            "files": {name: {"sha256": sha, "stage": "solve"}},
        }
        (out / FOLDER / "ledger.json").write_text(json.dumps(content))
        swap = {"stage": "solve", "key": "k", "files": {name: {"part": "0", "sha256": sha}}, "drop": ["solve"]}
        (out / FOLDER / "pending.json").write_text(json.dumps(swap))
        with writing(out) as ledger:
            ledger.record("solve", "k", {})
        assert (tmp_path / "mine.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["../mine", "/mine", "a\\b", "a\0b", "\ud800", ""])
def test_names_that_cannot_be_ours_are_not_in_a_ledger(ledger, name):
    swap = {"stage": "solve", "key": "k", "files": {name: {"part": "0", "sha256": "x"}}}
    (ledger.folder / "pending.json").write_text(json.dumps(swap))
    with writing(ledger.out) as found:
        assert found.stages.keys() == {"poses"}


def test_only_what_the_ledger_lists_unchanged_is_removed(ledger):
    """Files and folders of the user's, whatever their names, outlive a solve that no longer writes what it wrote."""
    out = ledger.out
    ledger.record("solve", "1", {"clock.csv": "c", "trajectory-car.tum": "t", "trajectory.csv": "x"})
    (out / "trajectory-mine.csv").write_text("mine")
    (out / "trajectory-old").mkdir()
    (out / "trajectory-car.tum").write_text("changed by its reader")
    ledger.record("solve", "2", {"trajectory.csv": "y"})
    assert names(out) == {"poses.csv", "trajectory.csv", "trajectory-mine.csv", "trajectory-old", "trajectory-car.tum"}
    assert (out / "trajectory-car.tum").read_text() == "changed by its reader"


def test_what_is_in_the_way_is_kept_under_another_name(tmp_path):
    (tmp_path / "clock.csv").write_text("mine")
    (tmp_path / "timing.csv").mkdir()
    (tmp_path / "timing.csv" / "inside").write_text("mine too")
    (tmp_path / "elsewhere").write_text("linked")
    (tmp_path / "report.html").symlink_to(tmp_path / "elsewhere")
    said = Ledger(tmp_path).record("solve", "1", {"clock.csv": "c", "timing.csv": "t", "report.html": "r"})
    assert (tmp_path / "clock.csv.kept-1").read_text() == "mine"
    assert (tmp_path / "timing.csv.kept-1" / "inside").read_text() == "mine too"
    assert (tmp_path / "elsewhere").read_text() == "linked"
    assert (tmp_path / "report.html").read_text() == "r"
    assert len(said) == 3
    assert "clock.csv.kept-1" in said[0]
    assert Ledger(tmp_path).warnings("solve") == said


def test_results_of_other_tracks_go_with_the_tracks(ledger):
    ledger.record("solve", "1", {"poses.csv": "refined", "timing.csv": "t"})
    ledger.record("track", "2", {"tracks.csv": "new"}, drop=("solve", "compare"))
    assert names(ledger.out) == {"tracks.csv"}
    assert not ledger.finished("solve", "1")


class Killed(BaseException):
    """A run that ends here."""


@pytest.mark.parametrize("at", range(12))
def test_a_run_killed_at_any_moment_leaves_the_old_set_or_the_new_one(tmp_path, monkeypatch, at):
    """Killed at each replacement in turn: whoever opens the folder next sees all of one set, and nothing half."""
    old, new = {"a.csv": "old", "b.csv": "old", "c.csv": "old"}, {"a.csv": "new", "b.csv": "new"}
    Ledger(tmp_path).record("solve", "1", old)
    real, calls = os.replace, []

    def replace(*arguments):
        if len(calls) == at:
            raise Killed
        calls.append(arguments)
        real(*arguments)

    monkeypatch.setattr("os.replace", replace)
    with contextlib.suppress(Killed):
        Ledger(tmp_path).record("solve", "2", new)
    monkeypatch.setattr("os.replace", real)
    with writing(tmp_path) as ledger:
        found = {name: (tmp_path / name).read_text() for name in names(tmp_path)}
        assert found in (old, new)
        assert ledger.finished("solve", "1" if found == old else "2")
    assert names(tmp_path / FOLDER) == {"ledger.json"}
    assert len(calls) >= min(at, 6)


def test_a_full_disk_leaves_the_old_set(tmp_path, monkeypatch):
    Ledger(tmp_path).record("solve", "1", {"a.csv": "old", "b.csv": "old"})

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        Ledger(tmp_path).record("solve", "2", {"a.csv": "new", "b.csv": "new"})
    monkeypatch.undo()
    assert {(tmp_path / n).read_text() for n in ("a.csv", "b.csv")} == {"old"}
    assert Ledger(tmp_path).finished("solve", "1")


@pytest.mark.parametrize("at", [2, 3])
def test_a_disk_that_becomes_full_is_not_kept_full(tmp_path, monkeypatch, at):
    """What was written aside goes away with the failure: of two files one, or both where the note does not fit."""
    Ledger(tmp_path).record("solve", "1", {"a.csv": "old", "b.csv": "old"})
    written = []

    def full(*_):
        written.append(1)
        if len(written) == at:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(WriteError, match="No space left"):
        Ledger(tmp_path).record("solve", "2", {"a.csv": "new", "b.csv": "new"})
    assert names(tmp_path / FOLDER) == {"ledger.json"}
    assert Ledger(tmp_path).finished("solve", "1")


def test_a_full_disk_has_room_for_a_lock(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pipeline.stages.running.lock.os.write", full)
    with writing(tmp_path):
        with pytest.raises(WriteError, match="process unknown is writing"), writing(tmp_path):
            pass
        monkeypatch.undo()
        write_whole(tmp_path / "a.csv", "mine")
    assert names(tmp_path) == {"a.csv"}


def test_the_second_of_two_runs_is_refused_with_the_first_one_named(tmp_path):
    with writing(tmp_path / "out"):
        with pytest.raises(WriteError) as caught, writing(tmp_path / "out"):
            pass
        assert f"process {os.getpid()}" in caught.value.seen
        assert caught.value.where == str(tmp_path / "out")
    assert not (tmp_path / "out").exists(), "nothing was written, nothing is left"
    with writing(tmp_path / "out"):
        pass


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes by name are needed")
def test_a_pipe_in_the_place_of_the_lock_is_refused(tmp_path):
    (tmp_path / FOLDER).mkdir()
    os.mkfifo(tmp_path / FOLDER / "lock")
    with pytest.raises(WriteError, match="a pipe or device"), writing(tmp_path):
        pass


def test_a_name_that_goes_up_again_leads_to_what_was_written(tmp_path):
    out = tmp_path / "absent/../other/../results"
    with writing(out) as ledger:
        ledger.record("poses", "key", {"poses.csv": "measured"})
    assert (out / "poses.csv").read_text() == "measured"
    with writing(tmp_path / "plain/below"):
        pass
    assert not (tmp_path / "plain").exists()


def test_a_killed_process_holds_no_lock(tmp_path):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "lock").write_text("99999 on another machine")
    with writing(tmp_path) as ledger:
        ledger.record("poses", "1", {"poses.csv": "p"})
    assert names(tmp_path / FOLDER) == {"ledger.json"}


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
