"""`runningfix batch` from its command: data set, catalogue, page, going on, limits, URLs and a cluster."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import duckdb
import geopandas
import pandas as pd
import pytest

from pipeline.cli.main import main
from scripts.validation.check_resume import contents
from tests.scenes.table_flight import write_table_flight

SECONDS = ("seconds", "solver_seconds")


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Two flights that fly and one that is refused, in a table with their names."""
    folder = tmp_path_factory.mktemp("flights")
    for name, seed in (("one", 1), ("two", 2), ("wrong", 3)):
        (folder / name).mkdir()
        write_table_flight(folder / name, seed)
    with (folder / "wrong" / "flight.toml").open("a") as file:
        file.write("nonsense = 1\n")
    names = ["one", "two", "wrong"]
    pd.DataFrame({"name": names, "flight": [f"{n}/flight.toml" for n in names]}).to_csv(folder / "flights.csv")
    return folder


@pytest.fixture(scope="module")
def done(flights, tmp_path_factory):
    out = tmp_path_factory.mktemp("batch") / "out"
    assert main(["batch", str(flights / "flights.csv"), "-o", str(out), "--jobs", "2", "--quiet"]) == 7
    return out


def test_the_catalogue_says_what_became_of_each_flight(done):
    rows = duckdb.sql(
        f"SELECT flight, status, verdict, exit_code FROM '{done}/catalogue.parquet' ORDER BY 1"
    ).fetchall()
    assert [row[:2] for row in rows] == [("one", "done"), ("two", "done"), ("wrong", "failed")]
    assert {row[2] for row in rows[:2]} <= {"good", "care"}
    assert rows[2][2:] == (None, 2)
    table = pd.read_parquet(done / "catalogue.parquet").set_index("flight")
    assert "nonsense" in table.loc["wrong", "error"]
    solution = json.loads((done / "flights" / "one" / "solution.json").read_text())
    assert [dict(o) for o in table.loc["one", "offsets"]] == [
        {key: clock[key] for key in ("camera", "offset_s", "offset_sigma_s")} for clock in solution["clocks"]
    ]
    assert table.loc["one", "worst_position_sigma_m"] == max(m["typical_sigma_m"] for m in solution["motions"])


def test_the_trajectories_are_one_data_set_with_geometry(done):
    table = geopandas.read_parquet(done / "trajectory")
    assert set(table.flight) == {"one", "two"}
    assert table.crs == "OGC:CRS84"
    assert (table.geometry.x - table.longitude_deg).abs().max() == 0
    assert (table.geometry.z - table.height_m).abs().max() == 0
    one = pd.read_csv(done / "flights" / "one" / "trajectory.csv")
    pd.testing.assert_series_equal(table[table.flight == "one"].east_m.reset_index(drop=True), one.east_m)


def test_a_flight_of_a_batch_is_the_flight_alone(flights, done, tmp_path):
    assert main(["run", str(flights / "one" / "flight.toml"), "-o", str(tmp_path / "alone"), "--quiet"]) == 0
    assert contents(tmp_path / "alone") == contents(done / "flights" / "one")


def test_the_page_leads_to_every_report(done):
    page = (done / "index.html").read_text()
    assert 'href="flights/two/report.html"' in page
    assert "No result: 1 (1 failed)" in page


def test_what_is_finished_is_not_done_again_and_the_summary_is_json(flights, done, capsys):
    before = contents(done)
    assert main(["batch", str(flights / "flights.csv"), "-o", str(done), "--json"]) == 7
    said = json.loads(capsys.readouterr().out)
    assert said["exit_code"] == 7
    assert sorted(said["skipped"]) == ["one", "two"]
    assert said["count"]["done"] == 2
    assert said["flights"][2]["error"]["seen"] == "an unknown key"
    assert contents(done) == before


def test_a_flight_that_changed_is_done_anew_and_others_stay_in_the_catalogue(flights, done, tmp_path, capsys):
    out, mine = tmp_path / "out", tmp_path / "mine"
    shutil.copytree(done, out)
    shutil.copytree(flights / "one", mine)
    with (mine / "flight.toml").open("a") as file:
        file.write('method = "intersection"\n')
    pd.DataFrame({"name": ["one"], "flight": ["mine/flight.toml"]}).to_csv(tmp_path / "flights.csv")
    assert main(["batch", str(tmp_path / "flights.csv"), "-o", str(out), "--json"]) in (0, 7)
    assert json.loads(capsys.readouterr().out)["skipped"] == []
    table = pd.read_parquet(out / "catalogue.parquet").set_index("flight")
    assert list(table.method[["one", "two"]]) == ["intersection", "map"]


def test_nothing_of_the_users_is_written_over(flights, done, tmp_path):
    out = tmp_path / "out"
    (out / "trajectory" / "flight=one").mkdir(parents=True)
    mine = {"index.html": "mine", "catalogue.parquet": "mine", "trajectory/flight=one/trajectory.parquet": "mine"}
    for name, text in mine.items():
        (out / name).write_text(text)
    assert main(["batch", str(flights / "one"), str(flights / "flights.csv"), "-o", str(out), "--quiet"]) == 7
    assert [p.read_text() for p in out.rglob("*.kept-1")] == ["mine"] * 2, "a table names the flight otherwise"
    assert (out / "trajectory" / "flight=one" / "trajectory.parquet").read_text() == "mine"


def test_a_batch_killed_goes_on_to_the_same(flights, done, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "pipeline", "batch", str(flights / "flights.csv"), "-o", str(out), "--jobs", "1"]
    process = subprocess.Popen([*command, "--quiet"], start_new_session=True)
    until = time.monotonic() + 120
    while not list(out.glob("flights/*/tracks.csv")) and process.poll() is None and time.monotonic() < until:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert subprocess.run([*command, "--quiet"], check=False).returncode == 7
    assert without_seconds(out) == without_seconds(done)


def without_seconds(out: Path):
    """Every file but those that hold seconds, and the catalogue without them."""
    files = {
        name: content for name, content in contents(out).items()
        if name not in ("catalogue.parquet", "index.html", ".runningfix/ledger.json") and "/outcomes/" not in name
    }  # fmt: skip
    return files, pd.read_parquet(out / "catalogue.parquet").drop(columns=[*SECONDS]).astype(str).to_dict()


def test_limits_are_told_and_stop_nothing(flights, tmp_path, capsys):
    asked = ["batch", str(flights / "one"), str(flights / "two"), "-o", str(tmp_path / "out"), "--jobs", "1", "--json"]
    assert main([*asked, "--timeout", "0.001"]) == 7
    said = json.loads(capsys.readouterr().out)
    assert said["count"] == {"timeout": 2}
    assert "within 0.001 s" in said["flights"][0]["error"]["expected"]
    assert main([*asked, "--memory", "30M"]) == 7
    said = json.loads(capsys.readouterr().out)
    assert said["count"] == {"memory": 2}
    assert "at most 31 MB (--memory)" in said["flights"][1]["error"]["expected"]
    assert main([*asked, "--memory", "30M", "--timeout", "77"]) == 7
    assert len(json.loads(capsys.readouterr().out)["skipped"]) == 2, "the limit that it broke is the same"
    assert main([*asked, "--memory", "30M", "--again"]) == 7
    assert json.loads(capsys.readouterr().out)["skipped"] == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--jobs", "0"], "1 or more"),
        (["--timeout", "nan"], "seconds above 0"),
        (["--memory", "much"], "a size such as 2G"),
        (["--scheduler", "tcp://127.0.0.1:9"], "nothing answers"),
    ],
)
def test_wrong_options(flights, tmp_path, capsys, arguments, words):
    assert main(["batch", str(flights / "one"), "-o", str(tmp_path / "out"), *arguments]) == 2
    assert words in capsys.readouterr().err


@pytest.fixture
def bucket(monkeypatch):
    """A bucket of an S3-compatible server on this machine, through its file system."""
    s3fs = pytest.importorskip("s3fs")
    server_of = pytest.importorskip("moto.server")
    server = server_of.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}", "AWS_ACCESS_KEY_ID": "none", "AWS_SECRET_ACCESS_KEY": "none",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    urllib.request.urlopen(urllib.request.Request(f"http://{host}:{port}/moto-api/reset", method="POST")).close()
    s3fs.S3FileSystem.clear_instance_cache()
    system = s3fs.S3FileSystem()
    system.mkdir("night")
    yield system
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


def test_inputs_and_outputs_by_url(flights, done, bucket, tmp_path, capsys):
    for path in (flights / "one").iterdir():
        bucket.put_file(str(path), f"night/flights/one/{path.name}")
    bucket.pipe_file("night/flights/flights.csv", b"flight,name\none/flight.toml,one\n")
    asked = ["batch", "s3://night/flights/flights.csv", "-o", "s3://night/out", "--json"]
    assert main(asked) == 0
    assert json.loads(capsys.readouterr().out)["count"]["done"] == 1
    bucket.invalidate_cache()
    bucket.get("night/out/", str(tmp_path / "out"), recursive=True)
    here, there = contents(tmp_path / "out" / "flights" / "one"), contents(done / "flights" / "one")
    assert here == {name: there[name] for name in here}
    assert {"solution.json", "report.html", "trajectory.csv", "tracks.csv"} <= here.keys()
    partition = "trajectory/flight=one/trajectory.parquet"
    assert (tmp_path / "out" / partition).read_bytes() == (done / partition).read_bytes()
    assert pd.read_parquet(tmp_path / "out" / "catalogue.parquet").flight.tolist() == ["one"]
    assert main(asked) == 0
    assert json.loads(capsys.readouterr().out)["skipped"] == ["one"]
    bucket.rm_file("night/out/flights/one/report.html")
    bucket.invalidate_cache()
    assert main(["batch", "s3://night/flights/*/flight.toml", "-o", "s3://night/out", "--json"]) == 0
    assert len(pd.read_parquet("s3://night/out/catalogue.parquet")) == 2, "the same flight by another name"


def test_files_that_a_flight_elsewhere_lacks_are_named(flights, bucket, tmp_path, capsys):
    bucket.put_file(str(flights / "one" / "flight.toml"), "night/lost/flight.toml")
    assert main(["batch", "s3://night/lost/flight.toml", "-o", str(tmp_path / "out"), "--json"]) == 7
    error = json.loads(capsys.readouterr().out)["flights"][0]["error"]
    assert error["seen"] == "no such file"
    assert error["where"].startswith("s3://night/lost/"), "where it was looked for, not where it was fetched to"
    assert main(["batch", "s3://night/none/*.toml", "-o", str(tmp_path / "out")]) == 3
    assert "nothing matches" in capsys.readouterr().err


def test_a_cluster_that_loses_a_worker_gives_the_same(flights, done, tmp_path):
    distributed = pytest.importorskip("distributed")
    out = tmp_path / "out"
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        command = [
            sys.executable, "-m", "pipeline", "batch", str(flights / "flights.csv"), "-o", str(out), "--scheduler",
            cluster.scheduler_address, "--quiet",
        ]  # fmt: skip
        process = subprocess.Popen(command)
        until = time.monotonic() + 120
        while not list(out.glob("flights/*/tracks.csv")) and process.poll() is None and time.monotonic() < until:
            time.sleep(0.02)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        assert process.wait(timeout=300) == 7
    assert without_seconds(out) == without_seconds(done)
