"""How many pictures a report gets, how large, and what reading them may cost. No result depends on it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """Limits of the pictures.

    outlier_sigmas     residual from which on a sighting is shown; 4: three in ten thousand go as far by chance
    outliers, losses   shown of each camera at most, the largest and the longest first
    apart_s            between two outliers of one track: a slide is shown once
    boxes_wide         side of a cut-out in sides of the target's box; doubled, more surroundings and half the detail
    least_px, most_px  side of a cut-out in the video; `unknown_px` where no box says how large the target is
    encoded_px         side of the encoded picture at most; doubled, four times the bytes
    quality            of the JPEG, 0 to 100
    most_bytes         of all pictures together; a third more in the page
    decoded_px         pixels decoded in all, beyond the first frames of each video: about 2 s of one processor
    film_frames        of each camera, beside the slider; film_px  longer side of one; film_quality  of the JPEG
    film_bytes         of all films together; a third more in the page
    film_decoded_px    as `decoded_px`, for the films
    ground_frames      of each camera that are projected on the ground; doubled, twice the time, and fewer gaps
    ground_quality     of the WebP; ground_least_share  of a map that has to be covered for it to be shown
    ground_px_per_unit picture of a map in units of its drawing; doubled, four times the bytes
    """

    outlier_sigmas: float = 4.0
    outliers: int = 6
    losses: int = 4
    apart_s: float = 1.0
    boxes_wide: float = 4.0
    least_px: int = 72
    most_px: int = 480
    unknown_px: int = 140
    encoded_px: int = 224
    quality: int = 86
    most_bytes: int = 1_800_000
    decoded_px: float = 6e8
    film_frames: int = 40
    film_px: int = 352
    film_quality: int = 60
    film_bytes: int = 1_300_000
    film_decoded_px: float = 6e8
    ground_frames: int = 10
    ground_quality: int = 70
    ground_least_share: float = 0.02
    ground_px_per_unit: float = 1.2


SETTINGS = PictureSettings()
