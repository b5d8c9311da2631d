"""A target watched by two that do not know of each other: the alignment of its surface, and the box tracker.

surface   `follow`: a point of the target to a fraction of a pixel, as long as that looks like itself
box       `box_tracker`: the middle of the whole target to a tenth of its side; it speaks where the
          surface does not
parted    where the two part, the one whose look had become doubtful before is to blame: the surface point is lost, or
          the box starts again; of a target that does not keep its look it is always the surface point
slide     whatever is followed and begins to move as the scene does, and was seen in the scene before, is lost since it
          was last certain (`slide`); what had been handed on since then is taken back
told      so is a small target whose box something else left, or holds what the scene had there before (`told`)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.records import Box
from pipeline.tracking.following.follow import begin, carry, follow, hide
from pipeline.tracking.presence.slide import Trail, carried_trail, extended, first_trail, has_slid, is_other, proved
from pipeline.tracking.presence.told import doubted_since, not_there, told
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene
from pipeline.tracking.settings import BOX_TRACKER, INSTANT_S, SLIDE, WATCH, TrackingSettings
from pipeline.tracking.target.box_tracker import BoxTrack, look_box, start_box
from pipeline.tracking.target.kinematics import Course, carried, corrected, first_course
from pipeline.tracking.target.track_state import Fix, TrackState


@dataclass(frozen=True, kw_only=True, eq=False)
class Watched:
    """A target between two frames, as both have it.

    surface, box    the two; no box while the target is not seen by it
    course          of the box's centre
    trail           where the target was
    safe, tried     the surface at a frame at which it was certain, and at one that is to become so; carried along
    safe_at, tried_at  those frames
    offset_px       (2,) the box's centre from the surface point, when they last agreed
    agreed          frame number of that
    together        whether surface point and box spoke on the last frame, and agreed
    lost            whether neither spoke on the last frame
    returned        frame number at which it was found after that, as long as nothing has proved that it was
    doubted         frame number at which the surface point's look was last doubtful
    blind_s         for how long nothing could be measured: the frames were damaged
    """

    surface: TrackState
    box: BoxTrack | None
    course: Course
    trail: Trail
    safe: TrackState
    tried: TrackState
    tried_at: int
    offset_px: Floats
    agreed: int
    doubted: int = -(10**9)
    together: bool = True
    lost: bool = False
    returned: int | None = None
    blind_s: float = 0.0

    @property
    def keeps_look(self) -> bool:
        """Whether it looks as a car does from frame to frame, not as a body that moves."""
        return bool(self.surface.usual[0] > WATCH.rigid_score)

    @property
    def size_px(self) -> Floats:
        """(2,) sides of the target now, as far as that is known."""
        if self.surface.hidden and self.box is not None:
            return self.box.size_px
        return np.array(self.surface.template.size_px) * self.surface.scale


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What one frame brought: fixes, and numbers of frames whose fixes are taken back."""

    fixes: tuple[Fix, ...] = ()
    taken_back: tuple[int, ...] = ()


def begin_watch(scene: Scene, box: Box, settings: TrackingSettings, known: TrackState | None) -> tuple[Watched, Fix]:
    """Takes up a target at its first box."""
    surface, fix = begin(scene.pixels, box, settings, known)
    centre, size = np.array(box.centre_px), np.array([box.width, box.height])
    watched = Watched(
        surface=surface,
        box=start_box(scene.pixels, centre, size, scene.time_s),
        course=first_course(centre, float(size.max())),
        trail=first_trail(scene.frame, scene.time_s, centre),
        safe=surface,
        tried=surface,
        tried_at=scene.frame,
        offset_px=np.zeros(2),
        agreed=scene.frame,
    )
    return watched, fix


def watch(watched: Watched, scene: Scene, settings: TrackingSettings) -> tuple[Watched, Seen]:
    """One frame further."""
    if watched.surface.gone and watched.box is None:
        return watched, Seen()
    watched = _carried(watched, scene)
    if scene.damaged:
        return _passed(watched, scene), Seen()
    watched = watched if watched.blind_s == 0.0 else changed(watched, blind_s=0.0)
    watched, fixes = _surface(watched, scene, settings)
    here = fixes[-1] if fixes and fixes[-1].frame == scene.frame else None
    held = watched.box is not None and not watched.together
    if here is not None:
        watched = changed(watched, lost=False, returned=fixes[0].frame if watched.lost else watched.returned)
    watched, looked = _box(watched, here, scene)
    watched, seen = _weighed(watched, fixes, here, looked, scene)
    if watched.box is None and here is None:
        unproved, watched = watched.returned, changed(watched, lost=True, returned=None)
        if unproved is not None:
            first, last = sorted((unproved, scene.frame))
            return watched, Seen(taken_back=tuple(range(first, last + 1)))
        if held:
            return _let_go(watched, seen, scene)
    return _slid(watched, seen, scene)


def _passed(watched: Watched, scene: Scene) -> Watched:
    """Over a damaged frame, in which nothing is a measurement; what lasts longer hides the target."""
    blind_s = watched.blind_s + scene.dt_s
    surface = carry(watched.surface, scene)
    if blind_s > WATCH.blind_s + INSTANT_S and not surface.hidden:
        surface = hide(surface, blind_s)
    box = None if blind_s > WATCH.blind_s + INSTANT_S else watched.box
    return changed(watched, surface=surface, box=box, lost=watched.lost or box is None, blind_s=blind_s)


def _let_go(watched: Watched, seen: Seen, scene: Scene) -> tuple[Watched, Seen]:
    """The box tracker lost what it held alone: what is not certain of it may have been what covers the target."""
    trail = watched.trail
    after = trail.by_box & (_after(trail, scene) | _of_late(trail, scene))
    taken = tuple(int(f) for f in trail.frame[after])
    return changed(watched, trail=_cut(trail, ~after)), Seen(fixes=seen.fixes, taken_back=(*seen.taken_back, *taken))


def _after(trail: Trail, scene: Scene) -> Bools:
    """(m,) rows since the target was last certain."""
    return np.asarray(np.abs(scene.frame - trail.frame) < abs(scene.frame - trail.certain))


def _of_late(trail: Trail, scene: Scene) -> Bools:
    """(m,) rows so late that a box which fails now may have been failing then."""
    return np.asarray(np.abs(scene.time_s - trail.time_s) < WATCH.unsure_s - INSTANT_S)


def _cut(trail: Trail, kept: Bools) -> Trail:
    return changed(
        trail, frame=trail.frame[kept], time_s=trail.time_s[kept], own_px=trail.own_px[kept],
        ground_px=trail.ground_px[kept], by_box=trail.by_box[kept], suspicious=0, slow=0, left=None, behind=None,
    )  # fmt: skip


def _carried(watched: Watched, scene: Scene) -> Watched:
    course, _ = carried(watched.course, scene.cur_from_prev, scene.dt_s)
    return changed(
        watched, course=course, trail=carried_trail(watched.trail, scene), safe=carry(watched.safe, scene),
        tried=carry(watched.tried, scene),
    )  # fmt: skip


def _surface(watched: Watched, scene: Scene, settings: TrackingSettings) -> tuple[Watched, tuple[Fix, ...]]:
    """The alignment's view; while the box holds a hidden target it is searched there, and seldom."""
    surface = watched.surface
    if surface.hidden and watched.box is not None:
        size = watched.box.size
        surface = changed(surface, lost_s=min(surface.lost_s, WATCH.held_s), gone=False)
        if scene.frame % WATCH.search_every:
            return changed(watched, surface=carry(surface, scene)), ()
        place = watched.course.position_px - watched.offset_px
        course = changed(
            first_course(place, watched.course.length_px), velocity=watched.course.velocity,
            covariance=np.diag([(BOX_TRACKER.sigma_share * size) ** 2, watched.course.covariance[1, 1]]),
        )  # fmt: skip
        surface = changed(surface, course=course)
    before = surface
    surface, fixes = follow(surface, scene, settings)
    if watched.lost and fixes and before.doubt is not None:
        size_px, was = np.array(surface.template.size_px) * surface.scale, before.doubt.otherwise
        way_px = float(np.hypot(*before.doubt.expected_px))
        if is_other(watched.trail, scene, size_px, np.array(fixes[-1].xy_px), was.lost_s, way_px):
            return changed(watched, surface=carry(was, scene)), ()
    doubtful = bool(fixes) and fixes[-1].score < surface.usual[0] - WATCH.score_drop
    return changed(watched, surface=surface, doubted=scene.frame if doubtful else watched.doubted), fixes


def _box(watched: Watched, here: Fix | None, scene: Scene) -> tuple[Watched, bool]:
    """The box tracker's view, where it is due: always while in doubt, else seldom."""
    box, course = watched.box, watched.course
    if box is None:
        if here is None:
            return watched, False
        place = np.array(here.xy_px)
        started = start_box(scene.pixels, place, watched.size_px, scene.time_s)
        course = changed(first_course(place, float(watched.size_px.max())), velocity=watched.surface.course.velocity)
        return changed(watched, box=started, course=course, offset_px=np.zeros(2), agreed=scene.frame), False
    settled = here is not None and watched.doubted != scene.frame and watched.together
    expected = np.array(here.xy_px) + watched.offset_px if here is not None and settled else course.position_px
    rigid = not watched.surface.new and watched.keeps_look
    every_s = BOX_TRACKER.every_rigid_s if rigid else BOX_TRACKER.every_s
    if settled and abs(scene.time_s - box.time_s) < every_s - 0.5 * scene.dt_s - INSTANT_S:
        moved_on = corrected(course, expected, BOX_TRACKER.sigma_share * box.size)
        return changed(watched, box=changed(box, centre_px=expected), course=moved_on), False
    found = look_box(box, scene.pixels, expected, scene.time_s)
    if found is None or found.likeness < BOX_TRACKER.least_likeness:
        dim = found is not None and found.likeness > WATCH.least_dim and not watched.keeps_look
        if found is None or not dim or abs(scene.time_s - box.time_s) > WATCH.blind_s + INSTANT_S:
            return changed(watched, box=None), False
        held = changed(found, look=box.look, time_s=box.time_s)  # says nothing, and learns nothing of what it holds
        return changed(watched, box=held), False
    course = corrected(course, found.centre_px, BOX_TRACKER.sigma_share * found.size)
    return changed(watched, box=found, course=course), True


def _weighed(
    watched: Watched, fixes: tuple[Fix, ...], here: Fix | None, looked: bool, scene: Scene
) -> tuple[Watched, Seen]:
    """What is believed where both speak, or one."""
    box = watched.box
    if here is None:
        if box is None or not looked:
            return watched, Seen(fixes=fixes)
        if not np.isfinite(watched.trail.velocity).all():  # too soon lost for a slide to be seen
            return changed(watched, box=None, together=False), Seen(fixes=fixes)
        fix = _box_fix(watched, box, scene)
        return _went(changed(watched, together=False, agreed=scene.frame), scene, fix), Seen(fixes=(*fixes, fix))
    if box is None and watched.doubted == scene.frame:  # a doubtful look, and nobody else who sees it
        return changed(watched, surface=hide(watched.surface, scene.dt_s), together=False), Seen()
    if box is None or not looked:
        return _went(watched, scene, here), Seen(fixes=fixes)
    off = box.centre_px - np.array(here.xy_px)
    sides = np.maximum(np.array(watched.surface.template.size_px) * watched.surface.scale, box.size_px)
    if float((np.abs(off) / sides).max()) <= WATCH.apart:
        share = WATCH.offset_share
        offset = watched.offset_px + share * (off - watched.offset_px)
        if watched.doubted == scene.frame:  # what the two newly differ by is part of what the fix is worth
            apart_px = float(np.hypot(*(off - watched.offset_px)))
            here = replace(here, sigma_px=math.hypot(here.sigma_px, apart_px / math.sqrt(2)))
            fixes = (*fixes[:-1], here)
        both = changed(watched, agreed=scene.frame, offset_px=offset, together=True)
        return _went(both, scene, here), Seen(fixes=fixes)
    sure = watched.together and abs(scene.frame - watched.doubted) > WATCH.memory_frames
    if sure and watched.keeps_look:
        started = start_box(scene.pixels, np.array(here.xy_px), box.size_px, scene.time_s)
        return _went(changed(watched, box=started, offset_px=np.zeros(2)), scene, here), Seen(fixes=fixes)
    since = [int(f) for f in watched.trail.frame if abs(f - scene.frame) < abs(watched.agreed - scene.frame)]
    fix = _box_fix(watched, box, scene)
    watched = changed(watched, surface=hide(watched.surface, scene.dt_s), offset_px=np.zeros(2), together=False)
    return _went(watched, scene, fix), Seen(fixes=(fix,), taken_back=tuple(since))


def _went(watched: Watched, scene: Scene, fix: Fix) -> Watched:
    """With one more place on the trail; the surface as it is becomes safe once its frame has proved certain."""
    trail = extended(
        watched.trail, scene, np.array(fix.xy_px), float(np.sqrt(watched.size_px.prod())), fix.kind == "box"
    )
    proved = abs(scene.frame - trail.certain) <= abs(scene.frame - watched.tried_at)
    if proved and not watched.surface.hidden and not watched.surface.pending:
        return changed(watched, trail=trail, safe=watched.tried, tried=watched.surface, tried_at=scene.frame)
    return changed(watched, trail=trail)


def _slid(watched: Watched, seen: Seen, scene: Scene) -> tuple[Watched, Seen]:
    """Takes back what was handed on since the target was last certain, where it has slid onto the scene."""
    trail = watched.trail
    if not len(trail.frame):
        return watched, seen
    back = watched.returned is None or abs(scene.frame - trail.certain) <= abs(scene.frame - watched.returned)
    watched = changed(watched, returned=None) if back else watched
    box_alone = not watched.together or not back
    doubtful = box_alone or abs(scene.frame - watched.doubted) < abs(scene.frame - trail.certain)
    slid = has_slid(trail, scene, watched.size_px, doubtful) if trail.frame[-1] == scene.frame else None
    trail = told(trail, scene, watched.size_px)
    watched = changed(watched, trail=trail)
    slid = True if not_there(trail, scene) else slid
    if not slid:
        return (changed(watched, trail=proved(trail)) if slid is False else watched), seen
    size = float(np.sqrt(watched.size_px.prod()))
    since = doubted_since(trail, scene)
    sure = np.abs(scene.frame - trail.frame) >= abs(scene.frame - trail.certain)
    if since is not None:
        sure &= np.abs(scene.frame - trail.frame) > abs(scene.frame - since)
    back = back and since is None
    if sure.any():
        certain = int(np.flatnonzero(sure)[-1])
        dt_s = np.abs(trail.time_s - trail.time_s[certain])
        velocity = np.nan_to_num(trail.velocity)
        expected = trail.ground_px[certain] + velocity * dt_s[:, None]
        off = np.where(sure, 0.0, np.hypot(*(trail.ground_px - expected).T))
        strayed = np.maximum.accumulate(off) > SLIDE.kept_sizes * size
        bad = (~sure & (strayed | (not back))) | (trail.by_box & (~sure | _of_late(trail, scene)))
        place, lost_s = expected[-1], float(dt_s[-1])
    else:
        bad, place, lost_s = ~sure, watched.safe.course.position_px, watched.safe.lost_s
        if since is not None:
            lost_s = float(abs(trail.time_s[-1] - trail.time_s[0]))
    taken = tuple(int(f) for f in trail.frame[bad])
    if not back and watched.returned is not None:
        first, last = sorted((watched.returned, scene.frame))
        taken = tuple(range(first, last + 1))
    course = changed(
        first_course(place, watched.course.length_px), velocity=np.nan_to_num(trail.velocity),
        covariance=np.diag([(0.2 * size) ** 2, (0.5 * size) ** 2]),
    )  # fmt: skip
    surface = hide(changed(watched.safe, course=course), lost_s)
    trail = _cut(trail, ~bad)
    watched = changed(
        watched, surface=surface, tried=surface, safe=surface, box=None, course=course, trail=trail,
        lost=True, returned=None, together=False,
    )  # fmt: skip
    return watched, Seen(fixes=tuple(f for f in seen.fixes if f.frame not in taken), taken_back=taken + seen.taken_back)


def _box_fix(watched: Watched, box: BoxTrack, scene: Scene) -> Fix:
    x, y = box.centre_px.tolist()
    return Fix(
        frame=scene.frame,
        xy_px=(x, y),
        linear=np.diag(box.size_px / np.array(watched.surface.template.size_px)),
        sigma_px=BOX_TRACKER.sigma_share * box.size,
        score=box.likeness,
        kind="box",
    )
