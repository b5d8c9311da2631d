"""Which stages of a run are finished, and which files of the output folder are its own.

One file, `out`/.runningfix/ledger.json: for each stage a key (a hash of all that decides its result), the files it
wrote and its warnings; for each file its hash and its owner, the stage that wrote it last. A stage is finished when
its key is the same and each of its files is still there as it, or a later stage, wrote it.

Files of a stage are swapped in together: all are written aside, then a note of what is to happen, then they are moved
into place. A run that is killed in between leaves the note, and whoever opens the folder next completes it. What is in
the way and not our own is kept under another name; only what the ledger lists, unchanged, is ever removed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from calibration.foundation.errors import WriteError
from calibration.foundation.files import cannot_write, part_name, write_whole
from pipeline.stages.running.lock import locked
from pipeline.stages.running.provenance import file_hash

FOLDER = ".runningfix"
LATER = {"poses": ("solve", "compare"), "solve": ("compare",)}
"""Stages that write a file of another one anew, with more in it: poses.csv refined, the demo's report."""
MOST_KEPT = 1000
"""Copies of one name that are kept aside; then the folder is refused."""


def key_of(content: Mapping[str, Any]) -> str:
    """A hash of plain values."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One finished stage: its key, the names of its files, its warnings."""

    key: str
    files: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Owned:
    """A file of ours: its hash, and the stage that wrote it last."""

    sha256: str
    stage: str


class Ledger:
    """The finished stages of one output folder."""

    def __init__(self, out: Path) -> None:
        self.out, self.folder = out, out / FOLDER
        self.stages: dict[str, Entry] = {}
        self.owned: dict[str, Owned] = {}
        self._load(_read(self.folder / "ledger.json"))

    def _load(self, content: Mapping[str, Any]) -> None:
        """Takes over what has the form of a ledger; anything else counts as not there."""
        for stage, entry in _tables(content.get("stages")):
            files, warnings = _texts(entry.get("files")), _texts(entry.get("warnings"))
            if isinstance(entry.get("key"), str) and isinstance(entry.get("files"), list) and all(map(_inside, files)):
                self.stages[stage] = Entry(key=entry["key"], files=files, warnings=warnings)
        for name, entry in _tables(content.get("files")):
            if _inside(name) and isinstance(entry.get("sha256"), str) and isinstance(entry.get("stage"), str):
                self.owned[name] = Owned(sha256=entry["sha256"], stage=entry["stage"])

    def finished(self, stage: str, key: str) -> bool:
        """True where `stage` need not be done again."""
        entry = self.stages.get(stage)
        return entry is not None and entry.key == key and all(self._stands(stage, name) for name in entry.files)

    def _stands(self, stage: str, name: str) -> bool:
        owner = self.owned.get(name)
        return owner is not None and owner.stage in (stage, *LATER.get(stage, ())) and self._is_ours(name)

    def files(self, stage: str) -> tuple[str, ...]:
        """The files that a finished stage wrote."""
        return self.stages[stage].files if stage in self.stages else ()

    def warnings(self, stage: str) -> tuple[str, ...]:
        """What a finished stage had to say."""
        return self.stages[stage].warnings if stage in self.stages else ()

    def remember(self, stage: str, key: str, warnings: Sequence[str]) -> None:
        """A stage without files, kept with the next one that has some."""
        self.stages[stage] = Entry(key=key, warnings=tuple(warnings))

    def same(self, name: str, content: str) -> bool:
        """Whether our file of that name holds just this."""
        owner = self.owned.get(name)
        return owner is not None and owner.sha256 == hashlib.sha256(content.encode()).hexdigest()

    def record(
        self,
        stage: str,
        key: str,
        files: Mapping[str, bytes | str | Path],
        *,
        warnings: Sequence[str] = (),
        drop: Sequence[str] = (),
    ) -> tuple[str, ...]:
        """Swaps in the files of `stage` (a path is moved), takes away those it no longer writes and those of the stages
        in `drop`, which it made void. Returns what had to be kept aside, a sentence each.

        Raises WriteError; then nothing has changed, or the next to open the folder completes it.
        """
        try:
            swap = {
                "stage": stage,
                "key": key,
                "warnings": list(warnings),
                "files": {name: self._aside(number, content) for number, (name, content) in enumerate(files.items())},
                "drop": list(drop),
            }
            write_whole(self.folder / "pending.json", json.dumps(swap, indent=1))
        except WriteError:  # a full disk: what was written aside would keep it full
            self._clear()
            raise
        return self._complete(swap)

    def _aside(self, number: int, content: bytes | str | Path) -> dict[str, str]:
        """Writes a file where nobody looks for it."""
        part = self.folder / "new" / str(number)
        if isinstance(content, Path):
            with _writing(part):
                part.parent.mkdir(parents=True, exist_ok=True)
                os.replace(content, part)
        else:
            write_whole(part, content)
        return {"part": part.name, "sha256": file_hash(part)}

    def complete_pending(self) -> tuple[str, ...]:
        """Ends the swap that a killed run began; what it only prepared is cleared away."""
        path = self.folder / "pending.json"
        swap = _read(path)
        files = dict(_tables(swap.get("files")))
        whole = all(_inside(name) and _is_part(entry) for name, entry in files.items())
        kept: tuple[str, ...] = ()
        if whole and isinstance(swap.get("stage"), str) and isinstance(swap.get("key"), str):
            kept = self._complete(swap | {"files": files})
        self._clear()
        return kept

    def _complete(self, swap: Mapping[str, Any]) -> tuple[str, ...]:
        stage, files, gone = swap["stage"], swap["files"], {}
        kept: list[str] = []
        for name in [n for s in (stage, *_texts(swap.get("drop"))) for n in self.files(s) if n not in files]:
            owner = self.owned.get(name)
            if owner is not None and owner.stage in (stage, *_texts(swap.get("drop"))):
                gone[name] = owner
        for name, entry in files.items():
            kept += self._move_in(name, self.folder / "new" / entry["part"], entry["sha256"])
        for name in gone:
            self._remove(name)
            del self.owned[name]
        for dropped in _texts(swap.get("drop")):
            self.stages.pop(dropped, None)
        self.owned |= {name: Owned(sha256=entry["sha256"], stage=stage) for name, entry in files.items()}
        warnings = (*_texts(swap.get("warnings")), *kept)
        self.stages[stage] = Entry(key=swap["key"], files=tuple(files), warnings=warnings)
        self._save()
        self._clear()
        return tuple(kept)

    def _move_in(self, name: str, part: Path, sha256: str) -> list[str]:
        """Moves a file into its place; a sentence where something of another's was there."""
        path, said = self.out / name, []
        if not part.is_file():
            return []  # moved already, before the run was killed
        if os.path.lexists(path) and not self._is_ours(name) and not _holds(path, sha256):
            kept = _free_name(path)
            with _writing(path):
                os.rename(path, kept)
            said.append(f"{name} was not as a run had left it; it was kept as {kept.name}")
        with _writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(part, path)
        return said

    def _is_ours(self, name: str) -> bool:
        """Whether the file in the folder is the one that the ledger lists."""
        owner = self.owned.get(name)
        return owner is not None and _holds(self.out / name, owner.sha256)

    def _remove(self, name: str) -> None:
        """Takes a file of ours away, unless somebody changed it."""
        if self._is_ours(name):
            with _writing(self.out / name):
                (self.out / name).unlink(missing_ok=True)

    def _save(self) -> None:
        content = {
            "stages": {
                stage: {"key": e.key, "files": list(e.files), "warnings": list(e.warnings)}
                for stage, e in self.stages.items()
            },
            "files": {name: {"sha256": o.sha256, "stage": o.stage} for name, o in self.owned.items()},
        }
        write_whole(self.folder / "ledger.json", json.dumps(content, indent=1, sort_keys=True) + "\n")

    def _clear(self) -> None:
        """Nothing is pending any more."""
        with contextlib.suppress(OSError):
            for name in ("pending.json", part_name("pending.json"), part_name("ledger.json")):
                (self.folder / name).unlink(missing_ok=True)
            for part in (self.folder / "new").glob("*"):
                part.unlink()
            (self.folder / "new").rmdir()


@contextlib.contextmanager
def writing(out: Path) -> Iterator[Ledger]:
    """The ledger of `out` for a command that writes there: locked, an earlier run's swap completed.

    A folder in which nothing was written goes away again. Raises WriteError where another process writes there, or
    nobody can.
    """
    above = () if ".." in out.parts else out.parents  # where a name goes up again, the way there has to stay
    with _writing(out):
        fresh = [path for path in (out / FOLDER, out, *above) if not path.exists()]
        (out / FOLDER).mkdir(parents=True, exist_ok=True)
    try:
        with locked(out / FOLDER / "lock"):
            ledger = Ledger(out)
            ledger.complete_pending()
            yield ledger
    finally:
        for path in fresh:
            with contextlib.suppress(OSError):
                path.rmdir()


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        raise cannot_write(path, error) from None


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes()) if path.is_file() else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _tables(content: object) -> Iterator[tuple[str, dict[str, Any]]]:
    """The tables inside a table."""
    for name, entry in content.items() if isinstance(content, dict) else ():
        if isinstance(entry, dict):
            yield name, entry


def _texts(content: object) -> tuple[str, ...]:
    return tuple(c for c in content if isinstance(c, str)) if isinstance(content, list | tuple) else ()


def _inside(name: str) -> bool:
    """Whether a name of the ledger leads into the folder: a ledger from elsewhere must not reach out of it."""
    path = PurePosixPath(name)
    plain = not any(c in "\0\\" or "\ud800" <= c <= "\udfff" for c in name)
    return bool(name) and plain and not path.is_absolute() and ".." not in path.parts


def _is_part(entry: Mapping[str, Any]) -> bool:
    part = entry.get("part")
    return isinstance(part, str) and part.isdecimal() and part.isascii() and isinstance(entry.get("sha256"), str)


def _holds(path: Path, sha256: str) -> bool:
    try:
        return path.is_file() and not path.is_symlink() and file_hash(path) == sha256
    except (OSError, ValueError):
        return False


def _free_name(path: Path) -> Path:
    names = (path.with_name(f"{path.name}.kept-{number}") for number in range(1, MOST_KEPT))
    return next((name for name in names if not os.path.lexists(name)), path.with_name(f"{path.name}.kept"))
