"""Kills `runningfix run` at random moments, starts it again, and compares with an undisturbed run byte by byte.

usage: python -m scripts.validation.check_resume [flight.toml [KILLS [SEED]]]        (default: data/flight, 10 kills)
"""

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pipeline.demo.show import calibrate_boards
from scripts.validation.figures import tell


def run_command(flight: Path, out: Path) -> list[str]:
    """The command that is killed."""
    return [sys.executable, "-m", "pipeline", "run", str(flight), "-o", str(out), "--quiet"]


def contents(out: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


def differences(flight: Path, folder: Path, *, kills: int, seed: int) -> tuple[list[str], int]:
    """Files that differ after runs killed once and started again, and how many kills hit a running process."""
    begin = time.perf_counter()
    subprocess.run(run_command(flight, folder / "undisturbed"), check=True)
    length_s = time.perf_counter() - begin
    whole = contents(folder / "undisturbed")
    moments, hits, found = random.Random(seed), 0, set()
    for number in range(kills):
        out = folder / f"killed-{number}"
        process = subprocess.Popen(run_command(flight, out), start_new_session=True)
        try:
            process.wait(timeout=moments.uniform(0.1, length_s))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            hits += 1
        subprocess.run(run_command(flight, out), check=True)
        other = contents(out)
        found |= {name for name in whole.keys() | other.keys() if whole.get(name) != other.get(name)}
    return sorted(found), hits


def example(folder: Path) -> Path:
    """The flight file of a copy of `data/flight`, its cameras calibrated."""
    shutil.copytree("data/flight", folder / "flight")
    calibrate_boards(folder / "flight", lambda *_: None)
    return folder / "flight/flight.toml"


def main(flight: str = "", kills: str = "10", seed: str = "0") -> int:
    """Prints what differs; 0 where nothing does."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        asked = Path(flight) if flight else example(folder)
        found, hits = differences(asked, folder, kills=int(kills), seed=int(seed))
    tell({"kills": int(kills), "hits": hits, "files_that_differ": len(found)})
    print(f"{hits} of {kills} kills hit a running process; {len(found)} files differ {found}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
