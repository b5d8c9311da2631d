"""Whatever happens, one message of four parts, the right exit code, and JSON on standard output where asked for."""

import contextlib
import errno
import json
import os
import subprocess
import sys

import pytest

from calibration.foundation.errors import GeometryError, UsageError
from pipeline.cli import flights
from pipeline.cli.door import LONGEST_PART, cut
from pipeline.cli.main import main
from tests.scenes.table_flight import write_table_flight

PYTHON = [sys.executable, "-m", "pipeline"]


@pytest.fixture
def flight(tmp_path):
    return write_table_flight(tmp_path)[0]


def answer(capsys, *arguments) -> tuple[int, dict, str]:
    """Exit code, the JSON object on standard output, and what was said."""
    code = main([*map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert said["status"] == "error"
    assert said["exit_code"] == code
    assert set(said["error"]) == {"where", "seen", "expected", "advice"}
    assert all(said["error"].values())
    assert "Traceback" not in err
    assert err.count("\n") == 1, err
    return code, said["error"], err


@pytest.mark.parametrize(
    "arguments",
    [["run"], ["fly", "flight.toml"], ["run", "a.toml", "-o", "out", "--method", "magic"], ["board", "--fast"]],
)
def test_usage_errors(capsys, arguments):
    code, error, _ = answer(capsys, *arguments)
    assert code == 2
    assert error["where"] == "command line"
    assert "--help" in error["advice"]


def test_help_is_no_error(capsys):
    assert main(["run", "--help"]) == 0
    assert "example:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("raised", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (ZeroDivisionError("division by zero"), 1, "ZeroDivisionError: division by zero"),
        (MemoryError(), 1, "not enough"),
        (ImportError("libx.so.1: failed to map segment from shared object"), 1, "not enough"),
        (RuntimeError("can't start new thread"), 1, "not enough"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 1, "not enough"),
        (RecursionError("too deep"), 1, "too deep"),
        (OSError(errno.ENOSPC, "No space left on device", "/x"), 6, "no space left"),
        (GeometryError(where="a" * 10**6, seen="b\x1b[31m\n", expected="c", advice="d"), 5, "\\x1b[31m"),
    ],
)
def test_what_ends_a_command(capsys, monkeypatch, flight, raised, code, words):
    def run(*_):
        raise raised

    monkeypatch.setattr(flights, "run", run)
    found, error, said = answer(capsys, "run", flight, "-o", flight.parent / "out")
    assert found == code
    assert words in error["seen"]
    assert words in said
    assert len(said) < 4 * LONGEST_PART


@pytest.mark.parametrize("limit", [200_000_000, 10**12])
def test_a_limit_of_addresses_under_which_libraries_hang_is_refused(capsys, monkeypatch, flight, limit):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(flights, "run", lambda *_: 0)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    arguments = ["run", str(flight), "-o", str(flight.parent / "out"), "--json"]
    if limit > 10**9:
        assert main(arguments) == 0
        return
    code, error, said = answer(capsys, *arguments[:-1])
    assert (code, error["where"]) == (1, "memory")
    assert "200 MB" in said
    assert "ulimit" in error["advice"]


def test_an_interrupt_before_there_is_a_command(capsys, monkeypatch):
    def build():
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.cli.main.build_parser", build)
    code, error, _ = answer(capsys, "solve", "flight.toml")
    assert (code, error["seen"]) == (130, "interrupted")


@pytest.mark.parametrize("module", ["pipeline", "runningfix"])
def test_an_interrupt_while_the_program_is_loaded(module):
    script = f"""if True:
        import builtins, runpy, sys
        as_ever, interrupts = builtins.__import__, [KeyboardInterrupt]

        def load(name, *rest, **more):
            if name == "pipeline.cli.main" and interrupts:
                raise interrupts.pop()
            return as_ever(name, *rest, **more)

        builtins.__import__ = load
        sys.argv = ["runningfix", "solve", "flight.toml", "--json"]
        runpy.run_module("{module}", run_name="__main__", alter_sys=True)
    """
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=300, check=False)
    assert done.returncode == 130, done.stderr
    assert json.loads(done.stdout)["error"]["seen"] == "interrupted"
    assert done.stderr.count(b"\n") == 1, done.stderr


def test_parts_are_cut_in_their_middle():
    assert cut("short") == "short"
    long = cut("head" + "x" * 10**6 + "tail")
    assert long.startswith("headx")
    assert long.endswith("xtail")
    assert len(long) < LONGEST_PART + 10


def test_a_name_that_is_not_utf_8_never_reaches_a_library(capsys, tmp_path):
    name = os.fsdecode(bytes(os.fsencode(tmp_path)) + b"/caf\xe9.mp4")
    for arguments in (["detect", name], ["run", name, "-o", str(tmp_path)], ["calibrate", name, "--board", "9x6",
                      "--square-mm", "25", "-o", "c.json"]):  # fmt: skip
        code, error, _ = answer(capsys, *arguments)
        assert code == 2
        assert "not UTF-8" in error["seen"]


@pytest.mark.parametrize("target", [".", "..", "/", "/dev/null", "/dev/full"])
def test_folders_and_devices_are_not_written_over(capsys, tmp_path, monkeypatch, target):
    monkeypatch.chdir(tmp_path)
    before = os.stat("/dev/null")
    board = ["--board", "9x6", "--square-mm", "25"]
    write = ["inspect", "nothing.tlog"] if target == "/dev/full" else ["board", *board]
    code, _, _ = answer(capsys, *write, "-o", target)
    assert code in (2, 3)
    assert os.stat("/dev/null").st_rdev == before.st_rdev
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("out", "code", "words"),
    [
        ("", 2, "an empty argument"),
        ("http://127.0.0.1:9/out", 2, "a URL"),
        ("s3://bucket/out", 2, "a URL"),
        ("x" * 5000, 6, "File name too long"),
        ("a/" * 5000, 6, "File name too long"),
    ],
)
def test_folders_that_are_none(capsys, flight, monkeypatch, out, code, words):
    monkeypatch.chdir(flight.parent)
    before = sorted(flight.parent.rglob("*"))
    found, error, _ = answer(capsys, "solve", flight, "-o", out)
    assert found == code
    assert words in error["seen"]
    assert sorted(flight.parent.rglob("*")) == before


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="a file that cannot be read to its end is needed")
def test_a_file_that_cannot_be_read_to_its_end(capsys, flight):
    text = flight.read_text()
    flight.write_text(text.replace("uav1-tracks.csv", "/proc/self/mem"))
    code, error, _ = answer(capsys, "solve", flight, "-o", flight.parent / "out")
    assert code == 3
    assert error["where"] == "/proc/self/mem"


def run(*arguments, **options):
    return subprocess.run([*PYTHON, *map(str, arguments)], capture_output=True, timeout=300, **options)


def test_a_closed_standard_output(tmp_path):
    board = ["board", "--board", "9x6", "--square-mm", "25", "-o", tmp_path / "b.svg"]
    closed = lambda: os.close(1)  # noqa: E731
    done = subprocess.run([*PYTHON, *map(str, board), "--json"], stderr=subprocess.PIPE, preexec_fn=closed, timeout=300)
    assert done.returncode == 6
    assert done.stderr.count(b"\n") == 1
    assert b"standard output: closed" in done.stderr
    assert (tmp_path / "b.svg").read_text().startswith("<")


def test_a_reader_that_goes_away(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    board = ["board", "--board", "9x6", "--square-mm", "25", "-o", tmp_path / "b.svg", "--json"]
    done = subprocess.run([*PYTHON, *map(str, board)], stdout=writer, stderr=subprocess.PIPE, timeout=300)
    os.close(writer)
    assert done.returncode == 6
    assert done.stderr.count(b"\n") == 1, done.stderr


def test_a_command_that_is_told_to_end(tmp_path):
    """As a scheduler or a container does it."""
    script = """if True:
        import os, signal, sys, time
        from pipeline.cli import flights
        from pipeline.cli.main import main

        def run(*_):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(60)

        flights.run = run
        sys.argv = ["runningfix", "solve", "flight.toml", "-o", "out", "--json"]
        sys.exit(main())
    """
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=300, check=False)
    assert done.returncode == 130
    assert json.loads(done.stdout)["error"]["seen"] == "interrupted"
    assert done.stderr.count(b"\n") == 1, done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full is needed")
def test_a_full_disk_behind_standard_output(tmp_path):
    for command in (
        ["board", "--board", "9x6", "--square-mm", "25", "-o", tmp_path / "b.svg"],
        ["solve", "nothing.toml"],
    ):
        with open("/dev/full", "wb") as full:
            done = subprocess.run(
                [*PYTHON, *map(str, command), "--json"], stdout=full, stderr=subprocess.PIPE, timeout=300
            )
        assert done.returncode in (2, 3, 6), done.stderr
        assert b"Traceback" not in done.stderr
        assert done.stderr.count(b"\n") == 1, done.stderr


def test_no_streams_at_all(tmp_path):
    """A file opened first must not become standard output or error of whatever prints."""

    def close():
        for number in (0, 1, 2):
            with contextlib.suppress(OSError):
                os.close(number)

    board = ["board", "--board", "9x6", "--square-mm", "25", "-o", str(tmp_path / "b.svg"), "--verbose"]
    assert subprocess.run([*PYTHON, *board], preexec_fn=close, timeout=300).returncode == 0
    assert (tmp_path / "b.svg").read_text().startswith("<")


def test_no_home_and_a_terminal_that_cannot_show_the_text(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "USER", "LOGNAME", "XDG_CACHE_HOME")}
    environment |= {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    done = run("run", "fl\u00fcg.toml", "-o", tmp_path / "out", env=environment)
    assert done.returncode == 3
    assert done.stderr.count(b"\n") == 1


def test_the_parser_raises_what_the_door_says():
    from pipeline.cli.parser import build_parser

    with pytest.raises(UsageError, match="COMMAND"):
        build_parser().parse_args(["fly"])
