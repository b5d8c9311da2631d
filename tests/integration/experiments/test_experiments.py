"""Experiments from the name to the files: any number of processes gives the same bytes."""

import json
import sys

import pytest

from calibration.foundation.errors import UsageError
from pipeline.cli.main import main
from pipeline.experiments import cluster, processes, run_experiment, write_outcome

SILENT = lambda *_: None  # noqa: E731


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("experiments")
    for jobs in (1, 2):
        outcome = run_experiment("rotation", runs=2, seed=5, workers=processes(jobs), progress=SILENT)
        write_outcome(outcome, folder / str(jobs))
    return folder, outcome


def test_any_number_of_jobs_gives_the_same_bytes(flown):
    folder, _ = flown
    names = sorted(p.name for p in (folder / "1").iterdir())
    assert names == ["rotation-runs.csv", "rotation.csv", "rotation.html"]
    for name in names:
        assert (folder / "1" / name).read_bytes() == (folder / "2" / name).read_bytes()


def test_the_page_says_what_it_must(flown):
    folder, _ = flown
    page = (folder / "1" / "rotation.html").read_text()
    for text in ("Table 2", "paper 3.14", "paper 1.01", "Geometry", "bound", "seed 5", "2 runs", 'class="ours"'):
        assert text in page
    assert "http" not in page.replace("http-equiv", "")
    assert ">nan" not in page


def test_the_summary_is_that_of_its_runs(flown):
    folder, outcome = flown
    lines = (folder / "1" / "rotation.csv").read_text().splitlines()
    assert len(lines) == 1 + 4 * 5
    runs = [line.split(",") for line in (folder / "1" / "rotation-runs.csv").read_text().splitlines()]
    mine = [float(r[3]) for r in runs[1:] if r[0] == "0" and r[2] == "map"]
    entry = outcome.entry(0, outcome.experiment.approach("map"))
    assert len(mine) == 2
    assert entry.error_m.mean == pytest.approx(sum(mine) / 2, rel=1e-5)
    assert entry.bound_m > 0


def test_the_command_lists_and_flies(tmp_path, capsys):
    assert main(["experiment", "list"]) == 0
    assert "Table 2" in capsys.readouterr().out
    assert main(["experiment", "synchronised", "--runs", "1", "--jobs", "1", "-o", str(tmp_path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["files"] == ["synchronised.csv", "synchronised-runs.csv", "synchronised.html"]
    assert all((tmp_path / name).exists() for name in summary["files"])
    assert main(["experiment", "acuracy", "-o", str(tmp_path)]) == 2
    assert main(["experiment", "accuracy", "--runs", "0", "-o", str(tmp_path)]) == 2
    assert "runs" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore")  # the cluster's own
def test_two_hundred_flights_on_a_cluster_give_the_same_bytes(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, scheduler_port=0, host="127.0.0.1"
    )
    with local:
        there = run_experiment(
            "synchronised", runs=20, seed=2, workers=cluster(local.scheduler_address), progress=SILENT
        )
    here = run_experiment("synchronised", runs=20, seed=2, workers=processes(2), progress=SILENT)
    assert here.runs.shape[0] * here.runs.shape[1] == 200
    for outcome, name in ((here, "here"), (there, "there")):
        write_outcome(outcome, tmp_path / name)
    for name in ("synchronised.csv", "synchronised-runs.csv", "synchronised.html"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


def test_a_missing_cluster_is_one_message(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"runningfix\[cluster\]"):
        run_experiment("rotation", runs=1, seed=1, workers=cluster("tcp://127.0.0.1:1"), progress=SILENT)
