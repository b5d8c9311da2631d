"""What of tracking can be set; the defaults suit vehicles of 10 to 60 pixels in aerial video."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.records import TrackerName


@dataclass(frozen=True, kw_only=True)
class TrackingSettings:
    """Few settings, all with defaults.

    tracker        the coarse tracker that says where the target went; "kcf" (fast) or "csrt" (slow)
    accept_score   correlation with the template (-1 to 1) below which a target counts as hidden
    return_score   correlation at which a hidden target counts as found again
    adaptation     share of every accepted frame that enters the template, 0 to 1; much more than 0.05 drifts
    longest_loss_s how long a hidden target is looked for; after that it could be anywhere, and stays lost
    """

    tracker: TrackerName = "kcf"
    accept_score: float = 0.6
    return_score: float = 0.7
    adaptation: float = 0.02
    longest_loss_s: float = 8.0
