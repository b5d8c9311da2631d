"""What of tracking can be set; the defaults suit vehicles of 10 to 60 pixels in aerial video."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.records import TrackerName

INSTANT_S = 1e-6
"""Times closer than that are the same: no decision hangs on how a container's times are rounded."""


@dataclass(frozen=True, kw_only=True)
class TrackingSettings:
    """Few settings, all with defaults.

    tracker        the coarse tracker that says where the target went; "kcf" (fast) or "csrt" (slow)
    accept_score   correlation with the template (-1 to 1) below which a target counts as hidden
    return_score   correlation at which a hidden target counts as found again
    adaptation     share of every accepted frame that enters the template, 0 to 1; much more than 0.05 drifts
    longest_loss_s how long a hidden target is looked for; after that it could be anywhere, and stays lost
    telling_px     size of a first box from which a look tells its target from others over as long a time; a smaller one
                   is looked for that much shorter: halved, eleven pixels are found on other cars
    """

    tracker: TrackerName = "kcf"
    accept_score: float = 0.6
    return_score: float = 0.7
    adaptation: float = 0.02
    longest_loss_s: float = 8.0
    telling_px: float = 24.0


@dataclass(frozen=True, kw_only=True)
class BoxTrackerSettings:
    """The independent box tracker (CSRT in a chip); tried on labelled aerial video of people, boats and trucks.

    box_px         side of the target's box in the chip; at 32 it strays more on four of five sequences
    chip_over_box  side of the chip; halved, a target that jumps by its own size is lost
    largest_scale  image enlarged at most so much: more adds no detail
    template_px    side to which CSRT itself brings what it learns; halved, people are lost
    scales         sizes tried at every look; doubled, it costs half as much again
    restart_off    share of the chip, and `restart_size` of the box, from which it starts again at its own answer
    area_below     image reduced by averaging from this scale down
    every_s, every_rigid_s  between looks while nothing is in doubt, and at what keeps its look; halved, tracking of
                   four targets takes half as long again
    look_px        side of the picture that is kept of what the box held
    remember       share of a new look in that; doubled, what slowly covers a target is taken for it
    least_likeness correlation with that below which the target is covered
    sigma_share    what its centre is worth, one sigma per axis, in sides of the box: labels differ by half of
                   that; halved, its fixes claim what they do not hold
    """

    box_px: float = 24.0
    chip_over_box: float = 5.0
    largest_scale: float = 3.0
    template_px: float = 100.0
    scales: int = 17
    restart_off: float = 0.2
    restart_size: tuple[float, float] = (0.5, 1.8)
    area_below: float = 0.5
    every_s: float = 0.25
    every_rigid_s: float = 0.6
    look_px: int = 24
    remember: float = 0.3
    least_likeness: float = 0.4
    sigma_share: float = 0.12


BOX_TRACKER = BoxTrackerSettings()


@dataclass(frozen=True, kw_only=True)
class SlideSettings:
    """When a track counts as slid onto the scene.

    longest_s       how far back is looked; less, and slow targets cannot be judged
    first_s, fewest, sure_s  seconds and frames from which a velocity is known; seconds where the way is short
    least_way_px, least_way_sizes  that the target should have gone for a judgement; halved, parallax and jitter decide
    keeps_on, goes_on, slid  share of the expected way above which a new velocity is believed, above which a place was
                    certain, below which it is suspicious
    believe         share of a new velocity that is believed; doubled, a slide is learned before it is seen
    frames, doubtful_frames  in a row that must look slid; where only a doubtful look speaks beside the standing still
    stop_frames     of standing still after which a target was seen to stop, or is lost
    apart_sizes, apart_px, apart_enough_sizes  by which an earlier frame must hold target and scene apart, at least;
                    more than the last tells no better
    telling_px, beside_sizes  size of a target below which standing still in doubt is enough, and the scene around it is
                    searched so far for what is there now, as parallax moves it by a part of its size
    past_every_sizes, past_reach_sizes, past_reach_px, pasts  way over the ground between pictures that are kept for
                    that, what they hold on each side, at least, how many (the first among them); halved, slow targets
                    are not told apart
    least_scene, least_target, margin, slow_margin  correlation with the scene, with the target, that proves it; by how
                    much it must beat the other where the track stands still, and where it has slowed down
    as_before       correlation with an earlier picture of a target that never left its place, above which it stood
                    there all the time; at 0.7 a tree beside it passes for it
    ask_every_s     between comparisons of a small target with what the scene held; halved, these cost twice as much
    surely_scene, behind_margin  correlation with the scene, and by how much above that with the target, that speak
                    against a small target whatever its way, once they last `sure_s`
    seen_going_px   way over the ground after a long loss, as the target would have gone, that proves a small one
    kept_sizes      how far from the course of a certain target places may lie that are kept where it is lost later
    inner, sampled, finest_px, reach_sizes  the compared part of the box, samples on a side, their least distance, and
                    how far off a thing may lie from where it was
    """

    longest_s: float = 2.5
    first_s: float = 0.4
    fewest: int = 3
    sure_s: float = 1.0
    least_way_px: float = 3.0
    least_way_sizes: float = 0.3
    keeps_on: float = 0.8
    goes_on: float = 0.6
    slid: float = 0.35
    believe: float = 0.15
    frames: int = 2
    doubtful_frames: int = 3
    stop_frames: int = 6
    apart_sizes: float = 0.25
    apart_px: float = 1.5
    beside_sizes: float = 0.5
    telling_px: float = 24.0
    apart_enough_sizes: float = 1.5
    past_every_sizes: float = 0.7
    past_reach_sizes: float = 4.0
    past_reach_px: float = 120.0
    pasts: int = 5
    least_scene: float = 0.5
    least_target: float = 0.6
    margin: float = 0.05
    slow_margin: float = 0.15
    as_before: float = 0.85
    ask_every_s: float = 0.3
    surely_scene: float = 0.85
    behind_margin: float = 0.1
    seen_going_px: float = 6.0
    kept_sizes: float = 0.2
    inner: float = 0.85
    sampled: float = 20.0
    finest_px: float = 0.7
    reach_sizes: float = 0.25


SLIDE = SlideSettings()


@dataclass(frozen=True, kw_only=True)
class WatchSettings:
    """How surface and box are weighed against each other.

    apart          sides of the box by which a surface point may lie off the box tracker's centre: bodies turn by 0.2
    score_drop     below the usual score from which the surface point is to blame where they part
    memory_frames  for which a drop of the score is remembered
    rigid_score    usual score of a target that keeps its look: rendered cars have 0.95, walkers 0.85
    offset_share   of a new look in the box centre's place beside the surface point
    unsure_s       for which a box that fails when it is alone is not believed before; halved, what covers a target is
                   given as the target for a few frames
    held_s         how long a hidden surface point counts as lost while the box holds the target, at most
    search_every   frames between searches for it then
    least_dim      likeness down to which the box of a target that changes its look is held for `blind_s`, without a fix
    blind_s        for which frames may be damaged until a target counts as hidden; doubled, it is looked for too close
                   to where it was
    """

    apart: float = 0.4
    score_drop: float = 0.1
    memory_frames: int = 10
    rigid_score: float = 0.9
    offset_share: float = 0.3
    unsure_s: float = 1.0
    held_s: float = 1.0
    search_every: int = 3
    least_dim: float = 0.25
    blind_s: float = 0.3


WATCH = WatchSettings()


@dataclass(frozen=True, kw_only=True)
class LabelSettings:
    """How several boxes of a target bind its track.

    apart_sizes  own sizes by which the ways from two boxes may lie apart and still be on the same thing; doubled, a way
                 that strayed onto a neighbour is averaged with the right one
    """

    apart_sizes: float = 0.5


LABELS = LabelSettings()
