"""Which colour draws which approach."""

from __future__ import annotations


def tone(number: int, ours: bool) -> str:
    """The colour of an approach; ours is drawn thick."""
    return f"c{number % 8}" + (" ours" if ours else "")
