"""What a check has to say."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.foundation.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """One thing that is wrong, or likely so.

    kind     a short name that stays, for programs
    subject  cameras and targets that it is about
    where    the place in the flight file
    certain  it cannot be meant: commands refuse; otherwise they say it and go on
    """

    kind: str
    subject: tuple[str, ...]
    where: str
    seen: str
    expected: str
    advice: str
    certain: bool = False

    @property
    def words(self) -> str:
        """In a sentence."""
        return f"{self.where}: {self.seen}; expected {self.expected}. Try: {self.advice}"

    def error(self) -> UsageError:
        """As commands refuse it."""
        return UsageError(where=self.where, seen=self.seen, expected=self.expected, advice=self.advice)
