"""Commands of a page followed to the letter: what stands in its console blocks is typed, what is printed is kept."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
from itertools import zip_longest
from pathlib import Path

from pipeline.cli.main import main

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
SHARE, LAST_DIGITS = 0.3, 3
"""How far a figure may be from what the page says: machines and versions of OpenCV differ; words may not."""


def told_in(page: str) -> list[tuple[str, str]]:
    """Each command of a page with what the page says it prints."""
    blocks = re.findall(r"```console\n(.*?)```", page, re.DOTALL)
    parts = [part for block in blocks for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]]
    return [(command, told) for command, _, told in (part.partition("\n") for part in parts)]


def follow(commands: list[tuple[str, str]], start: Path) -> tuple[Path, list[tuple[str, str, str]]]:
    """Runs the commands one after the other from `start` on; the folder at the end, and (command, told, printed)."""
    folder, printed = start, []
    for command, told in commands:
        name, *rest = shlex.split(command)
        if name == "cd":
            folder = folder / rest[0]
        printed.append((command, told, _run(name, rest, folder)))
    return folder, printed


def _run(name: str, rest: list[str], folder: Path) -> str:
    """Standard output; of what is refused the message."""
    if name == "cd":
        return ""
    if name != "runningfix":
        plain = {**os.environ, "LC_ALL": "C"}  # names are sorted alike everywhere
        return subprocess.run([name, *rest], cwd=folder, env=plain, capture_output=True, text=True, check=True).stdout
    out, said = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        code = main(rest)
    if code == 0:
        return out.getvalue()
    return "\n".join(line for line in said.getvalue().splitlines() if line.startswith("runningfix:"))


def unlike(told: str, got: str) -> str:
    """The first line that is not as the page says, "" where all are; `...` stands for any lines."""
    lines, skipped = [line for line in got.splitlines() if line.strip()], False
    for line in (line for line in told.splitlines() if line.strip()):
        if line.strip() == "...":
            skipped = True
            continue
        while skipped and lines and not _alike(line, lines[0]):
            lines.pop(0)
        skipped = False
        if not lines or not _alike(line, lines.pop(0)):
            return line
    return lines[0] if lines and not skipped else ""


def _alike(told: str, got: str) -> bool:
    """The same words, and figures that are near."""
    words = [" ".join(NUMBER.sub("#", text).split()) for text in (told, got)]
    if words[0] != words[1] and not _counts(told, got):
        return False
    figures = zip_longest(NUMBER.findall(told), NUMBER.findall(got))
    return _counts(told, got) or all(a and b and _near(a, b) for a, b in figures)


def _counts(told: str, got: str) -> bool:
    """Rows of counts, of which some may be none."""
    rows = [re.sub(r"^boards seen", "", text).split() for text in (told, got)]
    return len(rows[0]) == len(rows[1]) == 5 and all(w == "." or w.isdecimal() for row in rows for w in row)


def _near(told: str, got: str) -> bool:
    last = 10.0 ** -len(told.partition(".")[2])
    return abs(float(told) - float(got)) <= max(SHARE * abs(float(told)), LAST_DIGITS * last)
