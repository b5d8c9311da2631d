"""A worker is ended where it takes too long or too much, and replaced where it ends by itself."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.batch.kept import Ended, KeptWorker, session_bytes
from pipeline.batch.limits import Limits, memory_bytes

PROGRAM = """
import json, os, signal, sys, time
print("ready", flush=True)
for line in sys.stdin:
    what = os.path.basename(json.loads(line)["flight"])
    out = json.loads(line)["out"]
    if what == "hang":
        time.sleep(600)
    if what == "eat":
        held = []
        while True:
            held.append(bytearray(8 << 20))
            time.sleep(0.01)
    if what == "die" or (what == "die-once" and not os.path.exists(out)):
        open(out, "w").close()
        os.kill(os.getpid(), signal.SIGSEGV)
    if what == "child-eats":
        if os.fork() == 0:
            held = bytearray(b"x") * (300 << 20)
            time.sleep(600)
        time.sleep(600)
    if what == "child":
        if os.fork() == 0:
            time.sleep(600)
        time.sleep(600)
    print(json.dumps({"flown": what, "pid": os.getpid()}), flush=True)
"""
QUICK = Limits(time_s=0.5, memory_bytes=1 << 32)
AMPLE = Limits(time_s=60.0, memory_bytes=1 << 32)


@pytest.fixture
def worker():
    kept = KeptWorker([sys.executable, "-S", "-c", PROGRAM])
    yield kept
    kept.stop()


def test_one_process_answers_flight_after_flight(worker, tmp_path):
    first, second = (worker.fly(Path(name), tmp_path, AMPLE) for name in ("a", "b"))
    assert (first["flown"], second["flown"]) == ("a", "b")
    assert first["pid"] == second["pid"]


def test_what_never_ends_is_ended_and_the_next_flight_flies(worker, tmp_path):
    found = worker.fly(Path("hang"), tmp_path, QUICK)
    assert isinstance(found, Ended)
    assert found.why == "timeout"
    assert worker.fly(Path("a"), tmp_path, AMPLE)["flown"] == "a"


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="memory of others is known by /proc")
def test_what_takes_too_much_is_ended(worker, tmp_path):
    found = worker.fly(Path("eat"), tmp_path, Limits(time_s=60.0, memory_bytes=200 << 20))
    assert isinstance(found, Ended)
    assert found.why == "memory"
    assert 200 << 20 < found.memory_bytes < 800 << 20
    assert session_bytes(os.getsid(0)) > 0


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="memory of others is known by /proc")
def test_what_its_children_take_counts(worker, tmp_path):
    found = worker.fly(Path("child-eats"), tmp_path, Limits(time_s=60.0, memory_bytes=200 << 20))
    assert isinstance(found, Ended)
    assert found.why == "memory"


def test_a_process_that_dies_once_is_replaced_and_one_that_dies_always_is_told(worker, tmp_path):
    assert worker.fly(Path("die-once"), tmp_path / "mark", AMPLE)["flown"] == "die-once"
    found = worker.fly(Path("die"), tmp_path / "mark", AMPLE)
    assert isinstance(found, Ended)
    assert (found.why, found.signal) == ("crashed", signal.SIGSEGV)


def test_what_it_started_ends_with_it(worker, tmp_path):
    worker.fly(Path("a"), tmp_path, AMPLE)
    leader = worker.process.pid
    assert worker.fly(Path("child"), tmp_path, QUICK).why == "timeout"
    until = time.monotonic() + 10
    while session_bytes(leader) and time.monotonic() < until:
        time.sleep(0.05)
    assert session_bytes(leader) == 0


@pytest.mark.parametrize(
    ("text", "size"), [("2G", 2 << 30), ("800M", 800 << 20), ("1.5g", 3 << 29), ("10KiB", 10240), ("77", 77)]
)
def test_sizes(text, size):
    assert memory_bytes(text) == size


def test_a_limit_beyond_the_machine_is_no_fault():
    code = "from pipeline.batch.worker import limit_memory; limit_memory(99999999999 << 40); print('fine')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parents[3])
    assert done.stdout == "fine\n", done.stderr


@pytest.mark.parametrize("text", ["", "G", "-1G", "0", "1e9", "2 X", "9" * 40])
def test_sizes_that_are_none(text):
    with pytest.raises(Exception, match="a size such as 2G"):
        memory_bytes(text)
