"""A series of flights, one JSON row each: with a file, rows are appended as they come and not made twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def rows_of(keys: Iterable[str], make: Callable[[str], Row], kept: Path | None) -> Iterator[Row]:
    """A row for every key, from `kept` where that has it, else from `make`, which is then appended."""
    known = {row["key"]: row for row in map(json.loads, kept.read_text().splitlines())} if _is(kept) else {}
    for key in keys:
        if key not in known:
            known[key] = {"key": key, **make(key)}
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps(known[key], default=float) + "\n")
        yield known[key]


def _is(kept: Path | None) -> bool:
    return kept is not None and kept.exists()
