"""Reading one TOML table key by key, so that every mistake names its place and its remedy."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from calibration.foundation.errors import UsageError

LARGEST_WHOLE = 2**31 - 1
LARGEST_NUMBER = 10**300
LONGEST_NAME, LONGEST_TEXT = 100, 4096
"""Characters of a name that a user gives, and of any text (the longest path that Linux takes)."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f\ud800-\udfff]")


class Table:
    """A TOML table being read: each key is asked for once, `done` refuses what nobody asked for."""

    def __init__(self, content: object, where: str) -> None:
        if not isinstance(content, dict):
            raise UsageError(
                where=where, seen=f"{_shown(content)}", expected="a table", advice=f"write [{where.split(': ')[-1]}]"
            )
        self.content: Mapping[str, Any] = content
        self.where = where
        self.known: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def place(self, key: str) -> str:
        """Where `key` stands, for messages: file and dotted key."""
        key = _short(key)
        return f"{self.where}.{key}" if not self.where.endswith(":") else f"{self.where} {key}"

    def refuse(self, key: str, expected: str, advice: str) -> UsageError:
        """The error for a value that does not fit."""
        seen = _shown(self.content[key]) if key in self.content else "missing"
        return UsageError(where=self.place(key), seen=seen, expected=expected, advice=advice)

    def get(self, key: str) -> Any:
        """The raw value, or None."""
        self.known.append(key)
        return self.content.get(key)

    def table(self, key: str) -> Table | None:
        """A table inside this one."""
        value = self.get(key)
        return None if value is None else Table(value, self.place(key))

    def named(self, name: str) -> Table:
        """A table inside this one, under a name that the user chose."""
        if not name.strip() or len(name) > LONGEST_NAME or _CONTROL.search(name):
            raise UsageError(
                where=self.place(_short(name)),
                seen="an empty name" if not name.strip() else f"a name of {len(name)} characters",
                expected=f"a name of 1 to {LONGEST_NAME} characters, without control characters",
                advice="choose a short name, such as uav1",
            )
        return Table(self.get(name), self.place(name))

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        above: bool = False,
    ) -> float | None:
        """A finite number between `low` and `high`; with `above`, strictly greater than `low`."""
        value = self.get(key)
        if value is None:
            return default
        if not _is_number(value) or not low <= value <= high or (above and value == low):
            raise self.refuse(key, _range(low, high, above), "give a plain number without quotes")
        return float(value)

    def whole(self, key: str, *, low: int = 0, high: int = LARGEST_WHOLE) -> int | None:
        """A whole number from `low` to `high`."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            bounds = (
                f"of at least {low}"
                if high == LARGEST_WHOLE and not (_is_number(value) and value > high)
                else f"from {low} to {high}"
            )
            raise self.refuse(key, f"a whole number {bounds}", "frames count from 0")
        return value

    def text(self, key: str) -> str | None:
        """A string that is not empty, without control characters."""
        value = self.get(key)
        if isinstance(value, str) and _CONTROL.search(value):
            raise self.refuse(key, "text without control characters", "take them out")
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            raise self.refuse(key, f"at most {LONGEST_TEXT} characters", "file names are shorter")
        if value is not None and (not isinstance(value, str) or not value):
            raise self.refuse(key, "text in quotes", f'write {key} = "..."')
        return value

    def choice(self, key: str, allowed: Iterable[Any], default: Any) -> Any:
        """One of `allowed`."""
        options = list(allowed)
        value = self.get(key)
        if value is None:
            return default
        if isinstance(value, bool) or value not in options:
            raise self.refuse(key, "one of " + ", ".join(map(_shown, options)), nearest(str(value), map(str, options)))
        return value

    def vector(self, key: str, length: int) -> tuple[float, ...] | None:
        """A list of `length` finite numbers."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != length or not all(map(_is_number, value)):
            raise self.refuse(key, f"a list of {length} numbers", f"write {key} = [{', '.join(['0.0'] * length)}]")
        return tuple(float(v) for v in value)

    def done(self) -> None:
        """Refuses keys that nobody asked for."""
        for key in self.content:
            if key not in self.known:
                raise UsageError(
                    where=self.place(key),
                    seen="an unknown key",
                    expected="one of " + ", ".join(sorted(set(self.known))),
                    advice=nearest(key, self.known),
                )


def nearest(word: str, known: Iterable[str]) -> str:
    """Advice that names the known word most like `word`."""
    options = list(dict.fromkeys(known))
    close = difflib.get_close_matches(word[:LONGEST_NAME], options, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else f"one of {', '.join(options)}"


def _is_number(value: object) -> bool:
    if isinstance(value, int) and not isinstance(value, bool):
        return abs(value) < LARGEST_NUMBER
    return isinstance(value, float) and math.isfinite(value)


def _shown(value: object) -> str:
    if isinstance(value, int) and value.bit_length() > 200:
        return f"a number of about {int(value.bit_length() * math.log10(2)) + 1} digits"
    text = repr(value if not isinstance(value, str) else value[:70]).replace("'", '"')
    return text if len(text) <= 60 else text[:57] + "..."


def _short(key: str) -> str:
    """A key as messages show it."""
    plain = _CONTROL.sub("?", key[:60])
    return plain if len(key) <= 60 else plain + "..."


def _range(low: float, high: float, above: bool) -> str:
    if low == -math.inf and high == math.inf:
        return "a finite number"
    if high == math.inf:
        return f"a number {'above' if above else 'of at least'} {low:g}"
    return f"a number from {low:g} to {high:g}"
