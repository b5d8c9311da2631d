"""One runner for every check: all modules are on its list, figures arrive in the result file, a failure is told."""

import json
from pathlib import Path

import pytest

from scripts.validation import __main__ as runner
from scripts.validation.checks import CHECKS, Check, named
from scripts.validation.figures import FILE, tell
from scripts.validation.page import ROWS, accuracy_page, read_results

FOLDER = Path(runner.__file__).parent
ROOT = runner.ROOT


def test_every_check_and_bench_is_on_the_list():
    modules = {path.stem for path in FOLDER.glob("*.py") if path.stem.startswith(("check_", "bench_"))}
    assert {check.module for check in CHECKS} == modules
    assert len({check.name for check in CHECKS}) == len(CHECKS)


def test_all_leaves_out_what_needs_data_from_elsewhere():
    needy = [check for check in CHECKS if check.needs]
    assert needy
    assert set(named(["all"])) == set(CHECKS) - set(needy)
    assert named([needy[0].name, "all"]) == [c for c in CHECKS if c is needy[0] or not c.needs]
    with pytest.raises(KeyError, match="nonsense"):
        named(["nonsense"])


class Small(Check):
    """A check that is a line of Python."""

    @property
    def program(self):
        return ("-c", *self.arguments)


def small(name, code):
    return Small(name=name, module="", arguments=(code,), minutes=0.1, says="")


def test_a_check_that_runs_leaves_its_record(tmp_path, monkeypatch, capfd):
    check = small("one", "from scripts.validation.figures import tell; tell({'error_m': 0.25}); print('a table')")
    monkeypatch.setattr(runner, "named", lambda names: [check])
    results = tmp_path / "figures.json"
    results.write_text('{"other": {"figures": {}}}')
    assert runner.run(["one"], results, None) == 0
    found = json.loads(results.read_text())
    assert set(found) == {"other", "one"}
    assert found["one"]["command"].startswith("python -c from")
    assert found["one"]["exit_code"] == 0
    assert found["one"]["figures"] == {"error_m": 0.25}
    assert "a table" in capfd.readouterr().out


def test_a_check_that_fails_is_told_and_the_next_one_still_runs(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(runner, "named", lambda names: [small("wrong", "raise SystemExit(3)"), small("right", "")])
    results = tmp_path / "figures.json"
    assert runner.run([], results, None) == 1
    assert [json.loads(results.read_text())[name]["exit_code"] for name in ("wrong", "right")] == [3, 0]
    assert "failed: wrong" in capfd.readouterr().out


def test_what_a_check_needs_is_asked_for(tmp_path, monkeypatch, capsys):
    assert runner.run(["real-flights"], tmp_path / "figures.json", None) == 1
    assert "--real" in capsys.readouterr().err


def test_figures_are_added_up(tmp_path, monkeypatch):
    tell({"unheard": 1})
    monkeypatch.setenv(FILE, str(tmp_path / "told.json"))
    tell({"a_m": 1.5})
    tell({"b": 2})
    assert json.loads((tmp_path / "told.json").read_text()) == {"a_m": 1.5, "b": 2}


def test_the_page_is_made_from_the_result_file():
    records = read_results(ROOT / "docs/figures.json")
    assert (ROOT / "docs/accuracy.md").read_text(encoding="utf-8") == accuracy_page(records)
    assert {row.check for row in ROWS} | {"experiments"} == {check.name for check in CHECKS}


def test_a_check_without_figures_is_named():
    page = accuracy_page({"demo-order": {"day": "2026-01-02", "figures": {"mean_error_m": {"li": 2.0, "map": 1.234}}}})
    assert "`li` 2.00, `map` 1.23 | `demo-order`, 2026-01-02" in page
    assert "Not measured" in page
    assert "`tracking`" in page
