"""What decides a match: how same and different targets are expected to look. Metres, seconds; natural logs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class MatchSettings:
    """Settings of a match. None was fitted to a flight; the margins' figures are in docs/accuracy.md.

    search_s        how far offsets are searched, plus and minus, where nothing is known. Doubled: twice the time, and
                    every match has to be worth 0.7 more
    step_s          of the even samples, and of the offsets tried first. A car at 15 m/s moves 4 m in it; doubled,
                    narrow basins (turns, stops) are stepped over
    gap_s           between two fixes of a track, up to which it is taken as straight in between
    most_samples    of two tracks, in the sweep and afterwards
    sure            margin in log-likelihood from which a pair is told: 400 to one. Lower: more pairs, more wrong ones
    orders          polynomials in time by which two tracks' misses are judged, 0 to 4: what is faster is noise
    apart_m         how far apart two different targets are, one sigma; the size of a scene
    speed_mps       by how much velocities of different targets differ, one sigma; of those that drive alike, alike_mps
    bend_mps2       the same of accelerations, alike_mps2
    free, alike     shares of pairs of different targets that move freely, and that drive alike (a convoy, a lane)
    wild            share of those whose rays meet anywhere: wild_factor times as far apart as the free ones
    still           share of pairs, of two tracks that may both be of something that stands still, that do so apart
    follower        chance that what moves has another behind it that moves the same way, later: where the clock is not
                    known, k targets that tie it may all be such pairs, and no margin is above k log (1 / follower)
    twin            share of pairs of other tracks that move as one, apart
    near_m          half of those that stand are that near to each other (slots), and a share `near` of those that move
    still_m         how far the rays of a track may miss one point, beside noise, for it to stand still
    place_m         how far apart the points are that two cameras track of one target, one sigma: half a car
    drift_m         by which that changes while both look
    relief_m        how far the ground departs from a plane, one sigma; slope: of the plane
    on_ground       share of targets on the ground: a help, never a must
    lasting         share of an instrument's moving error that lasts as long as a track
    behind          share of samples at which two rays may meet behind a camera
    least_s         what two tracks must have in common, seconds
    """

    search_s: float = 120.0
    step_s: float = 0.25
    gap_s: float = 1.0
    most_samples: int = 48
    sure: float = 6.0
    orders: int = 5
    apart_m: float = 50.0
    speed_mps: float = 8.0
    alike_mps: float = 1.0
    bend_mps2: float = 1.0
    alike_mps2: float = 0.3
    free: float = 0.65
    wild: float = 0.1
    wild_factor: float = 8.0
    alike: float = 0.25
    still: float = 0.4
    follower: float = 0.02
    twin: float = 0.0005
    near_m: float = 10.0
    near: float = 0.1
    still_m: float = 1.0
    place_m: float = 0.7
    drift_m: float = 0.3
    relief_m: float = 3.0
    slope: float = 0.05
    on_ground: float = 0.85
    lasting: float = 0.3
    behind: float = 0.2
    least_s: float = 1.0
