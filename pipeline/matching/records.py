"""What a match comes to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, order=True)
class TrackName:
    """A track: its camera, and what that camera's list calls it."""

    camera: str
    target: str

    def __str__(self) -> str:
        return f"{self.camera}:{self.target}"


@dataclass(frozen=True, kw_only=True)
class MatchedPair:
    """Two tracks of one target: by how much (log-likelihood) all is likelier with them together than apart."""

    first: TrackName
    second: TrackName
    margin: float


@dataclass(frozen=True, kw_only=True)
class MatchedTarget:
    """One target, seen by one camera or several: its tracks, camera by camera, and the pairs of them."""

    tracks: tuple[TrackName, ...]
    pairs: tuple[MatchedPair, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Doubtful:
    """Two tracks that may be of one target, left apart: another way to see it is nearly as likely."""

    pair: MatchedPair
    why: str


@dataclass(frozen=True, kw_only=True)
class MatchedClock:
    """A camera's clock as the match has it: added to its video time it gives the reference camera's; None: unknown."""

    camera: str
    offset_s: float | None
    sigma_s: float | None


@dataclass(frozen=True, kw_only=True)
class Matching:
    """Targets common to cameras (those of several cameras first), doubtful pairs, clocks.

    score  by how much (log-likelihood) all this is likelier than that no two tracks are of one target
    """

    targets: tuple[MatchedTarget, ...]
    doubtful: tuple[Doubtful, ...]
    clocks: tuple[MatchedClock, ...]
    score: float

    @property
    def pairs(self) -> tuple[MatchedPair, ...]:
        """Every pair that is told."""
        return tuple(pair for target in self.targets for pair in target.pairs)
