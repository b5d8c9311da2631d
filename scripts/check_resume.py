"""Kills `runningfix run` at random moments, starts it again, and compares with an undisturbed run byte by byte.

usage: python scripts/check_resume.py flight.toml [KILLS] [SEED]        (default 10 kills)
"""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def run_command(flight: Path, out: Path) -> list[str]:
    """The command that is killed."""
    return [sys.executable, "-m", "pipeline", "run", str(flight), "-o", str(out), "--quiet"]


def contents(out: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


def differences(flight: Path, folder: Path, *, kills: int, seed: int) -> tuple[list[str], int]:
    """Files that differ after `kills` killed runs and a whole one, and how many kills hit a running process."""
    begin = time.perf_counter()
    subprocess.run(run_command(flight, folder / "undisturbed"), check=True)
    length_s = time.perf_counter() - begin
    moments, hits = random.Random(seed), 0
    for _ in range(kills):
        process = subprocess.Popen(run_command(flight, folder / "killed"), start_new_session=True)
        try:
            process.wait(timeout=moments.uniform(0.1, length_s))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            hits += 1
    subprocess.run(run_command(flight, folder / "killed"), check=True)
    one, other = contents(folder / "undisturbed"), contents(folder / "killed")
    return [name for name in sorted(one.keys() | other.keys()) if one.get(name) != other.get(name)], hits


def main(flight: str, kills: str = "10", seed: str = "0") -> int:
    """Prints what differs; 0 where nothing does."""
    with tempfile.TemporaryDirectory() as folder:
        found, hits = differences(Path(flight), Path(folder), kills=int(kills), seed=int(seed))
    print(f"{hits} of {kills} kills hit a running process; {len(found)} files differ {found}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
