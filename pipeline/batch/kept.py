"""A worker process that is kept within limits: beyond them it is ended, and the next flight gets a new one."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.batch.limits import ATTEMPTS, HEADROOM_BYTES, LOOK_AROUND_S, POLL_S, Limits

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
START_S = 300.0
"""Until a worker is ready; a slow disk and everything imported for the first time."""
PROGRAM = (sys.executable, "-m", f"{__package__}.worker")


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A flight that has no answer: why ("timeout", "memory", "crashed"), after how long, with how much memory."""

    why: str
    seconds: float
    memory_bytes: int = 0
    signal: int = 0


class KeptWorker:
    """One worker, started when it is first needed."""

    def __init__(self, program: Sequence[str] = PROGRAM) -> None:
        self.program = program
        self.process: subprocess.Popen[bytes] | None = None
        self.said = b""
        self.over = False

    def fly(self, flight: Path, out: Path, limits: Limits) -> Mapping[str, Any] | Ended:
        """The worker's answer about one flight, or why there is none. A worker that dies is replaced, once."""
        request = {"flight": str(flight), "out": str(out), "hard_bytes": limits.memory_bytes + HEADROOM_BYTES}
        for _ in range(ATTEMPTS):
            found = self._once(request, limits)
            if self.over or not (isinstance(found, Ended) and found.why == "crashed"):
                break
        return found

    def _once(self, request: Mapping[str, Any], limits: Limits) -> Mapping[str, Any] | Ended:
        if self.process is None or self.process.poll() is not None:
            self.close()
            self._start()
        begin = time.monotonic()
        process = self.process
        assert process is not None
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        return self._answer(process, begin, limits)

    def _answer(self, process: subprocess.Popen[bytes], begin: float, limits: Limits) -> Mapping[str, Any] | Ended:
        looked_around = begin
        while True:
            line = self._line(process, POLL_S)
            seconds = time.monotonic() - begin
            if line:
                answer: dict[str, Any] = json.loads(line)
                return self._end("memory", seconds, memory=limits.memory_bytes) if answer.get("memory") else answer
            if line is None:
                return self._end("crashed", seconds)
            if seconds > limits.time_s:
                return self._end("timeout", seconds)
            taken = own_bytes(process.pid)
            if taken <= limits.memory_bytes and time.monotonic() - looked_around > LOOK_AROUND_S:
                taken, looked_around = session_bytes(process.pid), time.monotonic()
            if taken > limits.memory_bytes:
                return self._end("memory", seconds, memory=taken)

    def _line(self, process: subprocess.Popen[bytes], patience_s: float) -> bytes | None:
        """The next line; b"" where there is none yet, None where there will be none."""
        assert process.stdout is not None
        if b"\n" not in self.said:
            ready, _, _ = select.select([process.stdout], [], [], patience_s)
            if not ready:
                return b""
            more = os.read(process.stdout.fileno(), 1 << 20)
            if not more:
                return None
            self.said += more
        line, found, rest = self.said.partition(b"\n")
        if not found:
            return b""
        self.said = rest
        return line

    def _start(self) -> None:
        environment = {**os.environ, **dict.fromkeys(ONE_THREAD, "1")}
        self.process = subprocess.Popen(
            self.program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment,
            start_new_session=True,
        )  # fmt: skip
        until = time.monotonic() + START_S
        while self._line(self.process, POLL_S) == b"" and time.monotonic() < until:
            pass

    def _end(self, why: str, seconds: float, *, memory: int = 0) -> Ended:
        code = 0
        if self.process is not None and why == "crashed":
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self.process.wait(timeout=5)
        self.close()
        return Ended(why=why, seconds=seconds, memory_bytes=memory, signal=max(0, -code))

    def stop(self) -> None:
        """Ends the worker for good: nobody waits for its flight any more."""
        self.over = True
        self.close()

    def close(self) -> None:
        """Ends the worker and whatever it started."""
        process, self.process, self.said = self.process, None, b""
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for stream in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                assert stream is not None
                stream.close()


def own_bytes(process: int) -> int:
    """Memory of one process, as the system counts what lies in it; 0 where it cannot be known."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        return int(Path("/proc", str(process), "statm").read_bytes().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def session_bytes(leader: int) -> int:
    """Memory of all processes of a session, as the system counts what lies in it; 0 where it cannot be known."""
    total, page = 0, os.sysconf("SC_PAGE_SIZE")
    try:
        entries = os.listdir("/proc")
    except OSError:
        return 0
    for entry in entries:
        if entry.isdecimal():
            with contextlib.suppress(OSError, ValueError, IndexError):
                fields = Path("/proc", entry, "stat").read_bytes().rpartition(b")")[2].split()
                if int(fields[3]) == leader:
                    total += int(fields[21]) * page
    return total
