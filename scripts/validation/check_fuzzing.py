"""Every kind of input, fuzzed as coverage leads (libFuzzer by Atheris, extra `fuzz`): read, or refused in words.

usage: python -m scripts.validation.check_fuzzing [--minutes 10] [--kinds flight camera ...] [--keep FOLDER]

Each kind is a process of its own, for so many minutes. A finding is an exception that is no RunningFixError, a crash,
an input that takes more than 30 s, or 3 GB of memory; its input is kept in FOLDER. Loops are not compiled here, as
compiled code tells nothing of its coverage; `log-fuzzing` reads mangled logs with the compiled readers.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

from scripts.validation.figures import tell
from scripts.validation.fuzzed_inputs import LONGEST, reader, seeds

HANG_S, MEMORY_MB = 30, 3072
FOUND = "FOUND at"
KINDS = (
    "flight",
    "camera",
    "detections",
    "tracks",
    "poses",
    "pose-table",
    "log",
    "subtitles",
    "records",
    "metadata",
    "video",
    "label",
    "flights",
)


def fuzz_one(kind: str, minutes: float, corpus: Path, keep: Path) -> None:
    """Fuzzes one kind in this process; ends it."""
    sys.modules["numba"] = None  # type: ignore[assignment]
    import atheris

    with atheris.instrument_imports(include=["calibration", "pipeline"]):
        folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
        read = reader(kind, folder)
        from calibration.foundation.errors import RunningFixError
    whole = seeds(kind)
    names, found = list(whole), set[str]()

    def one(data: bytes) -> None:
        if not data:
            return
        path = folder / names[data[0] % len(names)]  # the first byte says under which name it is read
        path.write_bytes(data[1:])
        try:
            read(path)
        except RunningFixError:
            return
        except Exception as error:  # told once for each place; what is behind the first is looked for, too
            frame = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(frame.filename).name}-{frame.lineno}-{type(error).__name__}"
            if place not in found:
                found.add(place)
                (keep / f"{kind}-{place}").write_bytes(data)
                print(FOUND, place, file=sys.stderr)
                traceback.print_exc()

    for number, content in enumerate(whole.values()):
        (corpus / str(number)).write_bytes(bytes([number]) + content)
    options = [
        f"-max_total_time={round(60 * minutes)}", f"-timeout={HANG_S}", f"-rss_limit_mb={MEMORY_MB}",
        f"-max_len={LONGEST}", f"-artifact_prefix={keep}/{kind}-", "-print_final_stats=1", str(corpus),
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], one)
    atheris.Fuzz()


def fuzz(kind: str, minutes: float, keep: Path) -> dict[str, object]:
    """Executions and whether something was found, with the end of what was said."""
    with tempfile.TemporaryDirectory() as corpus:
        command = [sys.executable, "-m", "scripts.validation.check_fuzzing", "--one", kind, "--minutes", str(minutes)]
        command += ["--corpus", corpus, "--keep", str(keep)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=60 * minutes + 600)
    said = done.stdout + done.stderr
    runs = re.search(r"number_of_executed_units:\s*(\d+)", said) or re.search(r"Done (\d+) runs", said)
    found = done.returncode != 0 or FOUND in said
    return {"runs": int(runs[1]) if runs else 0, "finding": found, "said": _telling(said) if found else ""}


def _telling(said: str) -> str:
    """Tracebacks and the end, without the fuzzer's lines of progress."""
    lines = [line for line in said.splitlines() if not re.match(r"#\d+\s", line)]
    return "\n".join(lines)[-20000:]


def main() -> int:
    """Prints a line for each kind; 0 where nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "runningfix-fuzz")
    parser.add_argument("--one", choices=KINDS, help=argparse.SUPPRESS)
    parser.add_argument("--corpus", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    if given.one:
        fuzz_one(given.one, given.minutes, given.corpus, given.keep)
        return 0
    if sys.modules.get("atheris") is None and not _there():
        print("Atheris is not installed: pip install 'runningfix[fuzz]'")
        return 2
    results = {}
    for kind in given.kinds:
        results[kind] = fuzz(kind, given.minutes, given.keep)
        print(
            f"{kind:<12}{results[kind]['runs']:>10} inputs  {'FOUND' if results[kind]['finding'] else 'nothing'}",
            flush=True,
        )
        if results[kind]["finding"]:
            print(results[kind]["said"], flush=True)
    tell({f"{kind.replace('-', '_')}_inputs": r["runs"] for kind, r in results.items()})
    tell({"findings": sum(bool(r["finding"]) for r in results.values()), "minutes_each": given.minutes})
    return int(any(r["finding"] for r in results.values()))


def _there() -> bool:
    from importlib.util import find_spec

    return find_spec("atheris") is not None


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)
