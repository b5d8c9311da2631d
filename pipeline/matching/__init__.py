"""Which target of one camera is which of another: tracks become targets common to cameras, clocks unknown.

tracks and poses of each camera -> even samples (sampling) -> what every offset is worth (sweep)
-> clocks, constant errors and groups of tracks together (terms, joint, groups) -> margins (match)
"""

from pipeline.matching.match import match_tracks
from pipeline.matching.records import Doubtful, MatchedClock, MatchedPair, MatchedTarget, Matching, TrackName
from pipeline.matching.settings import MatchSettings

__all__ = [
    "Doubtful",
    "MatchSettings",
    "MatchedClock",
    "MatchedPair",
    "MatchedTarget",
    "Matching",
    "TrackName",
    "match_tracks",
]
