"""Do the tests bite? Small faults put into the code one at a time, and whether a test turns red.

usage: python -m scripts.validation.check_mutants [--count 150] [--seed 1] [--skip 0] [--only ROOM] [--keep FILE]

Needs the extra `mutation`. Mutants are those of Cosmic Ray: a comparison or an operator replaced by its like, a number
one off, a sign or a `not` put in or taken out, a loop never run. They are drawn by the seed over the rooms of `ROOMS`,
each room by the square root of what it offers. Compiled kernels are not mutated but their plain twins are, which the
twin's tests hold against them. Each mutant stands alone in a copy of the project and meets the tests that reach it:
first the files that name its module, then those beside them, those of its room, and those that go through the whole;
the first red one kills it. One that hangs is killed by the clock.

`--skip` and `--count` cut a long run into pieces of the same draw; `--keep` holds each outcome as it is found,
so that a run which was stopped goes on. Survivors are printed with their change: kill them, or say why not in
`mutants_explained.json`, which names file, line and change of each one that no test can see, with the reason.
"""

from __future__ import annotations

import argparse
import difflib
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

from scripts.validation.figures import tell

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {
    "solver": "pipeline/solver",
    "telemetry": "pipeline/telemetry",
    "tracking": "pipeline/tracking",
    "calibration": "calibration",
    "stages": "pipeline/stages",
}
COMPILED = ("_kernels.py", "_descent.py", "mavlink/packets/scan.py", "dataflash/messages/scan.py")
THROUGH_ALL = ("tests/integration/test_data_flight.py", "tests/cli/test_table_flight.py")
CPU_S, WALL_S = 900, 7200
"""Processor time, and time, after which a mutant that runs or waits for ever is stopped, and counts as killed."""
EXPLAINED = Path(__file__).with_name("mutants_explained.json")
LEFT_OUT = re.compile(
    r"core/(NoOp|RemoveDecorator|VariableReplacer|VariableInserter|ExceptionReplacer"
    r"|\w+_(Is|IsNot|In|NotIn|LShift|RShift|BitOr|BitAnd|BitXor|FloorDiv|Mod|Pow)(_\w+)?$"
    r"|\w+_\w+_(Is|IsNot|LShift|RShift|BitOr|BitAnd|BitXor|FloorDiv|Mod|Pow)$|ReplaceUnaryOperator_\w+_(Not|Invert|UAdd)$)"
)
"""Operators that need arguments, and those after which nearly any code would stop at once."""


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One fault: the `occurrence`-th place in a file where an operator can act, on `line`."""

    room: str
    path: str
    operator: str
    occurrence: int
    line: int

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.path}:{self.line} {self.operator.removeprefix('core/')} {self.occurrence}"


def possible(room: str) -> Iterator[Mutant]:
    """Every mutant of a room outside texts, types, imports and settings of the module's own names."""
    operators = {name: get_operator(name)() for name in operator_names() if not LEFT_OUT.match(name)}
    for path in sorted((ROOT / ROOMS[room]).rglob("*.py")):
        where = path.relative_to(ROOT).as_posix()
        if where.endswith(COMPILED) or path.name == "__init__.py":
            continue
        nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
        for name, operator in operators.items():
            places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
            for occurrence, (line, _) in enumerate(places):
                yield Mutant(room=room, path=where, operator=name, occurrence=occurrence, line=line)


def drawn(count: int, skip: int, seed: int, rooms: list[str]) -> list[Mutant]:
    """The mutants of a seed: rooms in proportion to the square root of what they offer, each operator alike."""
    rng, chosen = random.Random(seed), []
    offers = {room: list(possible(room)) for room in rooms}
    weight = {room: len(all_of) ** 0.5 for room, all_of in offers.items()}
    seen: set[tuple[str, int]] = set()
    while len(chosen) < skip + count and any(offers.values()):
        room = rng.choices(rooms, [weight[r] for r in rooms])[0]
        kind = rng.choice(sorted({family(m.operator) for m in offers[room]}))
        one = rng.choice([m for m in offers[room] if family(m.operator) == kind])
        offers[room].remove(one)
        if (one.path, one.line) not in seen and acts(one):
            seen.add((one.path, one.line))
            chosen.append(one)
    return chosen[skip:]


def family(operator: str) -> str:
    """ReplaceComparisonOperator_Lt_Gt -> ReplaceComparisonOperator."""
    return operator.split("_")[0]


def acts(mutant: Mutant) -> bool:
    """Whether the code means something else afterwards: no annotation, docstring or comment, no `from x import y`."""
    before = (ROOT / mutant.path).read_text(encoding="utf-8")
    after = changed(mutant)
    line = before.splitlines()[mutant.line - 1].strip()
    if (
        after is None
        or line.startswith(("import ", "from ", "@"))
        or re.match(r"^\w+\s*(:|=)\s*(Literal|Callable)", line)
    ):
        return False
    moved = [x[1:].strip() for x in difflib.ndiff(before.splitlines(), after.splitlines()) if x[:1] == "+"]
    return not all(re.search(r"(->|:) [^=]*\|", text) for text in moved)  # `int | None` is no bitwise or


def changed(mutant: Mutant) -> str | None:
    """The file with the fault in it."""
    code = (ROOT / mutant.path).read_text(encoding="utf-8")
    result = mutate_code(code, get_operator(mutant.operator)(), mutant.occurrence)
    return None if result is None else str(result)


def asked_tests(mutant: Mutant) -> list[list[str]]:
    """Test files in the order in which they are asked, in groups."""
    module = mutant.path.removesuffix(".py").replace("/", ".")
    parent, _, leaf = module.rpartition(".")
    names = re.compile(rf"{re.escape(module)}\b|from {re.escape(parent)} import [^\n]*\b{leaf}\b")
    files = sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "tests").rglob("test_*.py"))
    texts = {f: (ROOT / f).read_text(encoding="utf-8") for f in files}
    direct = [f for f in files if names.search(texts[f])]
    near = f"tests/unit/{mutant.path.removeprefix('pipeline/').rpartition('/')[0]}"
    mirrored = [f for f in files if f.startswith(near) and f not in direct]
    room = [f for f in files if f"/{mutant.room}/" in f and f not in direct and f not in mirrored]
    rest = [f for f in THROUGH_ALL if f not in direct]
    return [group for group in (direct, mirrored, room, rest) if group]


def left_behind(folder: str, names: list[str]) -> set[str]:
    """What of the project's own folder is no part of it: not `pipeline/demo`, but what `scripts/demo` made."""
    return (
        {n for n in names if n.startswith(".") or n in ("out", "demo", "experiments")} if folder == str(ROOT) else set()
    )


def outcome(mutant: Mutant, copy: Path, python: str) -> tuple[str, str]:
    """("killed", by what), or ("survived", the change)."""
    file, whole = copy / mutant.path, (ROOT / mutant.path).read_text(encoding="utf-8")
    after = changed(mutant)
    assert after is not None
    file.write_text(after, encoding="utf-8")
    try:
        for group in asked_tests(mutant):
            said = asked(group, copy, python)
            if said is not None:
                return "killed", said
    finally:
        file.write_text(whole, encoding="utf-8")
    lines = difflib.unified_diff(whole.splitlines(), after.splitlines(), lineterm="", n=0)
    return "survived", "\n".join(line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---"))


def asked(files: list[str], copy: Path, python: str) -> str | None:
    """Which test turned red, or None."""
    env = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    command = [python, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header", *files]
    try:
        done = subprocess.run(
            command, cwd=copy, env=env, capture_output=True, text=True, timeout=WALL_S, check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S)),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "the clock"
    if done.returncode in (0, 5):
        return None
    if done.returncode < 0:
        return "the clock"
    red = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return red[0] if red else f"pytest's exit code {done.returncode}"


def main() -> int:
    """Draws, tries, tells; 1 where fewer than nine of ten are killed, those explained left out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--skip", type=int, default=0, help="so many of the draw are left out at its beginning")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=ROOMS, action="append", help="one room; may be given more than once")
    parser.add_argument("--keep", type=Path, help="file of the outcomes, from which a stopped run goes on")
    parser.add_argument("--list", action="store_true", help="say what would be tried, and with which tests")
    given = parser.parse_args()
    mutants = drawn(given.count, given.skip, given.seed, given.only or list(ROOMS))
    if given.list:
        for mutant in mutants:
            print(mutant.name, [len(group) for group in asked_tests(mutant)])
        return 0
    kept = json.loads(given.keep.read_text()) if given.keep and given.keep.exists() else {}
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "copy"
        shutil.copytree(ROOT, copy, ignore=left_behind)
        for number, mutant in enumerate(mutants, 1):
            began = time.perf_counter()
            if mutant.name not in kept:
                kept[mutant.name] = [mutant.room, *outcome(mutant, copy, sys.executable)]
                if given.keep:
                    given.keep.write_text(json.dumps(kept, indent=1))
            _, word, more = kept[mutant.name]
            print(f"{number:>4} {word:<9}{time.perf_counter() - began:6.0f} s  {mutant.name}  {more}", flush=True)
    return summary({m.name: kept[m.name] for m in mutants}, given.seed)


def summary(found: dict[str, list[str]], seed: int) -> int:
    """Prints the shares and tells them; what is explained is counted apart."""
    explained = json.loads(EXPLAINED.read_text()) if EXPLAINED.exists() else {}
    survived = {name: more for name, (_, word, more) in found.items() if word == "survived"}
    killed = len(found) - len(survived)
    reasons = {name: explained[key] for name in survived if (key := _key(name)) in explained}
    by_room = Counter(room for room, word, _ in found.values() if word == "killed")
    rooms = Counter(room for room, _, _ in found.values())
    for room, many in rooms.items():
        print(f"{room:<12}{by_room[room]:>4} of {many} killed")
    print(f"{'all':<12}{killed:>4} of {len(found)} killed; of {len(survived)} survivors {len(reasons)} explained")
    for name in survived:
        print(f"survived: {name}: {reasons.get(name, 'not explained')}")
    tell({
        "seed": seed, "mutants": len(found), "killed": killed, "survived_explained": len(reasons),
        "killed_percent": 100 * killed / max(1, len(found)),
        "rooms": {room: {"mutants": many, "killed": by_room[room]} for room, many in rooms.items()},
        "survivors": {name: reasons.get(name, "") for name in survived},
    })  # fmt: skip
    return 0 if killed >= 0.9 * (len(found) - len(reasons)) else 1


def _key(name: str) -> str:
    """Without the line, which moves."""
    return re.sub(r":\d+ ", " ", name)


if __name__ == "__main__":
    sys.exit(main())
