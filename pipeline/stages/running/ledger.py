"""Which stages of a run are finished: one small file per stage in `out`/.runningfix.

A stage is finished when its entry carries the same key (a hash of all that went in) and every file it wrote is still
there, unchanged or rewritten by a later stage that says so.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibration.foundation.files import write_whole
from pipeline.stages.running.results import file_hash

FOLDER = ".runningfix"


def key_of(content: Mapping[str, Any]) -> str:
    """A hash of plain values."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


class Ledger:
    """The finished stages of one output folder."""

    def __init__(self, out: Path) -> None:
        self.out = out

    def _entry(self, stage: str) -> Path:
        return self.out / FOLDER / f"{stage}.json"

    def _entries(self) -> dict[str, dict[str, Any]]:
        found = {}
        for path in sorted((self.out / FOLDER).glob("*.json")):
            try:
                found[path.stem] = json.loads(path.read_text())
            except (OSError, ValueError):
                continue
        return found

    def finished(self, stage: str, key: str) -> bool:
        """True where `stage` need not be done again."""
        entries = self._entries()
        if entries.get(stage, {}).get("key") != key:
            return False
        for name in entries[stage]["files"]:
            path = self.out / name
            known = {entry["files"][name] for entry in entries.values() if name in entry["files"]}
            if not path.is_file() or file_hash(path) not in known:
                return False
        return True

    def files(self, stage: str) -> tuple[str, ...]:
        """The files that a finished stage wrote."""
        return tuple(self._entries().get(stage, {}).get("files", ()))

    def record(self, stage: str, key: str, files: Mapping[str, bytes | str]) -> list[str]:
        """Writes the files of `stage`, each whole or not at all, then its entry; returns their names."""
        for name, content in files.items():
            write_whole(self.out / name, content)
        hashes = {name: file_hash(self.out / name) for name in files}
        write_whole(self._entry(stage), json.dumps({"key": key, "files": hashes}, indent=1, sort_keys=True) + "\n")
        return list(files)
