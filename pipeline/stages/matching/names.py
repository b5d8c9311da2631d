"""Names that targets have in all cameras, and no two of them share."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.matching import MatchedTarget, TrackName


def common_names(targets: Sequence[MatchedTarget]) -> dict[TrackName, str]:
    """The name of every track's target. A common target is called as its first camera calls it; a track that stays
    alone keeps its name where no other camera uses it. Other names get their camera's behind them.
    """
    users: dict[str, set[str]] = {}
    for target in targets:
        for track in target.tracks:
            users.setdefault(track.target, set()).add(track.camera)
    taken: set[str] = set()
    found: dict[TrackName, str] = {}
    for target in sorted(targets, key=lambda one: len(one.tracks) < 2):
        first = target.tracks[0]
        alone = len(target.tracks) < 2 and len(users[first.target]) > 1
        name = _free(f"{first.target}-{first.camera}" if alone else first.target, first.camera, taken)
        taken.add(name)
        found |= dict.fromkeys(target.tracks, name)
    return found


def _free(name: str, camera: str, taken: set[str]) -> str:
    """`name`, or one like it that no other target has."""
    if name not in taken:
        return name
    name = f"{name}-{camera}"
    number = 2
    while name in taken:
        name, number = f"{name.rstrip('0123456789')}{number}", number + 1
    return name
