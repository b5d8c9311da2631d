"""What cannot be known is said: degenerate geometry, found numerically, in words, with what carries it.

    time gauge              shift and scale of common time: held by the reference camera's clock
    one camera (2.2 i)      the camera moves as a polynomial of no higher order than the target: refused
    rays (2.2 ii)           all through one point, or parallel, or the target moves along them: refused
    coplanar rays (2.3)     with offset and frame rate both free: carried by their priors, else refused
    camera line             cameras on one line with free attitudes: rotation about it, carried by the attitude's prior
    constant velocity       offset and position of a camera trade: carried by the position's prior
    too few equations (2.4) refused

Sections are the paper's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import CameraInput, Clock, Finding, Problem, SolverSettings
from pipeline.solver.observability.landmarks import landmarks_known
from pipeline.solver.observability.offset_knowledge import (
    OffsetKnowledge,
    carried,
    offset_knowledge,
    solved_offset_knowledge,
)
from pipeline.solver.observability.ray_bundles import (
    Bundle,
    are_parallel,
    bundle_of,
    lie_in_one_plane,
    meet_in_one_point,
    moves_simply,
    slides_along_rays,
    stand_on_one_line,
    stands_still,
)
from pipeline.solver.observation.selection import on_known_ground, without_landmarks
from pipeline.solver.offset_search.search import setting_order
from pipeline.solver.offset_search.views import View, views

TIMED = ("li", "algorithm-1", "algorithm-2", "map")
"""Methods that estimate clocks."""


def find_degeneracies(
    problem: Problem,
    settings: SolverSettings,
    *,
    clocks: Sequence[Clock] = (),
    orders: Mapping[str, int] | None = None,
    seen: Mapping[str, View] | None = None,
    shared: tuple[Sequence[str], Floats] | None = None,
) -> tuple[Finding, ...]:
    """What the sightings of `problem` leave open, and what decides it instead.

    Without `clocks` only what needs no common time is looked at: do so before solving, to refuse early. With the
    solved `clocks`, and the `orders` that motions of order "auto" were given, everything is. `seen` is
    `views(problem)` where it is at hand; `shared` the names and the covariance of the parameters that `map` solved.

    Raises GeometryError where nothing decides.
    """
    landmarks_known(problem)
    problem = without_landmarks(problem)
    seen = views(problem) if seen is None else seen
    degree = _orders(problem, orders)
    _enough_equations(problem, settings, degree)
    timed = settings.method in TIMED and len(problem.cameras) > 1
    if timed and any(c.offset_s is None for c in _others(problem)):
        setting_order(problem, seen)
    times = _times(problem, settings, clocks)
    findings = list(_gauge(problem)) if timed else []
    bundles = {target: _bundle(seen, times, target) for target in degree}
    held = on_known_ground(problem)
    for target, bundle in bundles.items():
        if bundle is not None and target not in held and settings.method != "triangulation":
            _distance_known(seen, bundle, target, degree[target])
    if timed and times.keys() == seen.keys():
        findings += _plane(problem, settings, [b for b in bundles.values() if b is not None], degree)
    findings += _camera_line(problem, settings, seen)
    if timed and clocks:
        findings += _offsets(problem, settings, seen, times, degree, shared)
    return tuple(findings)


def _others(problem: Problem) -> list[CameraInput]:
    return [c for c in problem.cameras if c.camera != problem.reference_camera]


def _orders(problem: Problem, orders: Mapping[str, int] | None) -> dict[str, int | None]:
    """Order of each target's motion; None for a free one (a spline). What the data shall say is zero before."""
    out: dict[str, int | None] = {}
    for t in problem.targets:
        if t.motion == "spline":
            out[t.target] = None
        elif t.order != "auto":
            out[t.target] = int(t.order)
        else:
            out[t.target] = 0 if orders is None else orders.get(t.target)
    return out


def _times(problem: Problem, settings: SolverSettings, clocks: Sequence[Clock]) -> dict[str, tuple[float, float]]:
    """Offset and clock_scale of every camera whose clock is solved, held or known with a sigma; a bare guess is not."""
    timed = settings.method in TIMED
    known = {
        c.camera: (c.offset_s or 0.0, 1.0)
        for c in problem.cameras
        if not timed or (c.offset_s is not None and c.sigma.offset_s is not None)
    }
    solved = {c.camera: (c.offset_s, c.nominal_rate / c.frame_rate) for c in clocks}
    return {problem.reference_camera: (0.0, 1.0), **known, **solved}


def _gauge(problem: Problem) -> tuple[Finding, ...]:
    return (
        Finding(
            kind="time-gauge",
            subject="",
            words="no sighting can tell when common time begins and how fast it runs: it is the clock of "
            f"{problem.reference_camera}",
            carried_by="flight.reference_camera: its offset and frame rate are held",
        ),
    )


def _enough_equations(problem: Problem, settings: SolverSettings, degree: Mapping[str, int | None]) -> None:
    """The paper's counting rules (eq. 8 and section 2.4). Raises GeometryError."""
    sightings, held = dict.fromkeys(degree, 0), on_known_ground(problem)
    for camera in problem.cameras:
        for index, name in enumerate(camera.rays.targets):
            if name in sightings:
                sightings[name] += int((camera.rays.target == index).sum())
    for target, order in degree.items():
        unknown = 3 * ((order or 0) + 1)
        if (3 if target in held else 2) * sightings[target] < unknown:
            raise GeometryError(
                where=f"target {target}",
                seen=f"{sightings[target]} sightings, which make {2 * sightings[target]} equations",
                expected=f"at least {unknown} equations for a motion of order {order or 0}",
                advice="track it for longer, lower its order, or leave it out",
            )
    motions = sum(3 * ((k or 0) + 1) for k in degree.values())
    equations = 2 * sum(sightings.values()) + sum(sightings[name] for name in held)
    frames = sum(len(np.unique(c.rays.frame)) for c in problem.cameras)
    clocks = 2 * len(_others(problem)) if settings.method in TIMED else 0
    unknown = motions + (clocks if settings.method != "map" else 0) + 3 * frames * (settings.method == "algorithm-2")
    if equations < unknown:
        raise GeometryError(
            where=f"method {settings.method}",
            seen=f"{equations} equations for {unknown} unknowns ({len(degree)} targets, {frames} frames)",
            expected="at least as many equations as unknowns; free rotations need two targets or more",
            advice='use method = "map", which has priors, or track more targets for longer',
        )


def _bundle(seen: Mapping[str, View], times: Mapping[str, tuple[float, float]], target: str) -> Bundle | None:
    """The rays of a target at common times; None where nobody sees it or a clock that matters is not known."""
    watching = _watching(seen, target)
    if len(watching) == 1:
        return bundle_of([seen[watching[0]]], [(0.0, 1.0)], target)
    if watching and all(name in times for name in watching):
        return bundle_of([seen[n] for n in watching], [times[n] for n in watching], target)
    return None


def _watching(seen: Mapping[str, View], target: str) -> list[str]:
    return [name for name, view in seen.items() if target in view.tracks]


def _distance_known(seen: Mapping[str, View], bundle: Bundle, target: str, order: int | None) -> None:
    """Raises GeometryError where a target can slide along its rays."""
    watching = _watching(seen, target)
    if order is None:
        if len(watching) == 1:
            raise _refused(target, watching, f"only {watching[0]} sees it, and its motion is free (a spline)")
        _overlapping(target, watching, bundle)
    elif slides_along_rays(bundle, order):
        raise _refused(target, watching, _why_it_slides(bundle, order, watching))


def _why_it_slides(bundle: Bundle, order: int, watching: Sequence[str]) -> str:
    """What kind of bundle it is, in words."""
    if are_parallel(bundle):
        return "all of its sight rays are parallel: it moves along them, or with the camera"
    if stands_still(bundle):
        return f"all of its sight rays pass through one point ({watching[0]} stands still)"
    if not moves_simply(bundle, order) and meet_in_one_point(bundle):
        return "all of its sight rays pass through one point"
    return f"{', '.join(watching)} moves no less simply than the target (a polynomial of order {order} or less)"


def _refused(target: str, watching: Sequence[str], seen: str) -> GeometryError:
    return GeometryError(
        where=f"target {target}",
        seen=f"{seen}: how far away it is cannot be known",
        expected="sight rays that fix the distance: a second camera elsewhere, or one that turns and curves",
        advice=f"add a camera that sees it together with {watching[0]}, lower the order of its motion, or leave it out",
    )


def _overlapping(target: str, watching: Sequence[str], bundle: Bundle) -> None:
    """A free motion needs two cameras at one time. Raises GeometryError."""
    spans = [
        (float(bundle.time_s[bundle.camera == i].min()), float(bundle.time_s[bundle.camera == i].max()))
        for i in np.unique(bundle.camera)
    ]
    if not any(min(a[1], b[1]) > max(a[0], b[0]) for k, a in enumerate(spans) for b in spans[k + 1 :]):
        when = ", ".join(f"{n} from {a:.1f} s to {b:.1f} s" for n, (a, b) in zip(watching, spans, strict=True))
        raise GeometryError(
            where=f"target {target}",
            seen=f"no two cameras see it at the same time ({when})",
            expected="sightings that overlap in time, since its motion is free (a spline)",
            advice='check offset_s and the clocks, or give it motion = "polynomial"',
        )


def _plane(
    problem: Problem, settings: SolverSettings, bundles: Sequence[Bundle], degree: Mapping[str, int | None]
) -> tuple[Finding, ...]:
    """Coplanar rays leave offset and frame rate open together (paper section 2.3)."""
    if not bundles or not all(lie_in_one_plane(b) for b in bundles):
        return ()
    found = []
    for camera in _others(problem):
        sigma = camera.sigma
        fixed = sigma.offset_s == 0 or not settings.refine_frame_rate or sigma.frame_rate == 0
        if fixed or settings.method == "li":
            continue
        keys = ["frame_rate"] * (None not in degree.values()) + ["offset_s"] * (sigma.offset_s is not None)
        if settings.method != "map" or not keys:
            raise GeometryError(
                where=f"camera {camera.camera}",
                seen="all sight rays lie in one plane while offset and frame rate are both unknown: any line in that "
                "plane fits",
                expected="sight rays out of one plane, or a known clock",
                advice='hold the rates (solve.frame_rate = "fixed"), give offset_s with sigma.offset_s, use '
                'method = "map", or fly the cameras at different heights',
            )
        found.append(
            Finding(
                kind="coplanar-rays",
                subject=camera.camera,
                words=f"all sight rays lie in one plane, where offset and frame rate of {camera.camera} cannot both "
                "be told from the motion",
                carried_by=", ".join(f"cameras.{camera.camera}.sigma.{k}" for k in keys),
            )
        )
    return tuple(found)


def _camera_line(problem: Problem, settings: SolverSettings, seen: Mapping[str, View]) -> tuple[Finding, ...]:
    """Cameras on one line, two still ones above all: everything may turn about it."""
    free = settings.method == "algorithm-2" or (
        settings.method == "map" and all(c.sigma.attitude_bias_rad > 0 for c in problem.cameras)
    )
    looking = [v for v in seen.values() if v.tracks]
    if not free or len(looking) < 2 or not stand_on_one_line(looking):
        return ()
    keys = ", ".join(f"cameras.{c.camera}.sigma.attitude_bias_deg" for c in problem.cameras)
    return (
        Finding(
            kind="rotation-about-base-line",
            subject="",
            words="the cameras stand on one line: turning all of them and every target about it changes no sighting",
            carried_by=keys if settings.method == "map" else "the measured attitudes, where the adjustment starts",
        ),
    )


def _offsets(
    problem: Problem,
    settings: SolverSettings,
    seen: Mapping[str, View],
    times: Mapping[str, tuple[float, float]],
    degree: Mapping[str, int | None],
    shared: tuple[Sequence[str], Floats] | None,
) -> list[Finding]:
    """What each offset rests on. Raises GeometryError where it rests on nothing."""
    names = [c.camera for c in problem.cameras]
    if any(not seen[n].tracks for n in names):
        return []
    looking, clocks = [seen[n] for n in names], [times[n] for n in names]
    if shared is not None and settings.method == "map":
        known = solved_offset_knowledge(problem.cameras, looking, clocks, *shared)
    else:
        free = {t: k for t, k in degree.items() if k is not None}
        orders = free if len(free) == len(degree) else None
        known = offset_knowledge(problem.cameras, looking, clocks, orders, settings, problem.reference_camera)
    found: list[Finding] = []
    for one in known:
        first, last = seen[one.camera].span_s
        if not one.sigma_s < max(0.25 * (last - first), 1.0) and _unknown(problem, one.camera):
            raise _no_offset(one, last - first)
        found += carried(one)
    return found


def _unknown(problem: Problem, name: str) -> bool:
    """Whether nothing was said of an offset."""
    camera = next(c for c in problem.cameras if c.camera == name)
    return camera.offset_s is None or camera.sigma.offset_s is None


def _no_offset(one: OffsetKnowledge, span_s: float) -> GeometryError:
    return GeometryError(
        where=f"camera {one.camera}",
        seen=f"its offset is known to {one.sigma_s:.3g} s only, on a track of {span_s:.3g} s",
        expected="targets whose motion tells the time: seen from the side, not along the ray",
        advice="give offset_s with sigma.offset_s, or track a target that turns or crosses the image",
    )
