"""Experiments from the name to the files: any number of processes gives the same bytes."""

import json

import pytest

from pipeline.cli.main import main
from pipeline.experiments import cluster, processes, run_experiment, write_outcome

SILENT = lambda *_: None  # noqa: E731


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("experiments")
    for jobs in (1, 2):
        outcome = run_experiment("rotation", runs=3, seed=5, workers=processes(jobs), progress=SILENT)
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
    for text in ("Table 2", "paper 3.14", "paper 1.01", "Geometry", "bound", "seed 5", "3 runs", 'class="ours"'):
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
    assert len(mine) == 3
    assert entry.error_m.mean == pytest.approx(sum(mine) / 3, rel=1e-5)
    assert entry.bound_m > 0


def test_the_command_lists_and_flies(tmp_path, capsys):
    assert main(["experiment", "list"]) == 0
    assert "Table 2" in capsys.readouterr().out
    assert main(["experiment", "monocular", "--runs", "2", "--jobs", "1", "-o", str(tmp_path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["files"] == ["monocular.csv", "monocular-runs.csv", "monocular.html"]
    assert all((tmp_path / name).exists() for name in summary["files"])
    assert main(["experiment", "acuracy", "-o", str(tmp_path)]) == 2
    assert main(["experiment", "accuracy", "--runs", "0", "-o", str(tmp_path)]) == 2
    assert "runs" in capsys.readouterr().err


def test_a_cluster_gives_the_same_bytes(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    here = run_experiment("monocular", runs=29, seed=2, workers=processes(1), progress=SILENT)
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, scheduler_port=0
    )
    with local:
        there = run_experiment("monocular", runs=29, seed=2, workers=cluster(local.scheduler_address), progress=SILENT)
    for outcome, name in ((here, "here"), (there, "there")):
        write_outcome(outcome, tmp_path / name)
    for name in ("monocular.csv", "monocular-runs.csv", "monocular.html"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
