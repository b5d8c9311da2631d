"""What the flight file knows beside sightings, in the flight's ENU: the ground, and landmarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.foundation.errors import UsageError
from pipeline.flight import Flight, GroundSettings, LandmarkSettings
from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic
from pipeline.records import CameraInput, Ground, ImageTrack, SurveyedPlace, TargetInput
from pipeline.telemetry import geoid_height_m
from pipeline.terrain import level_ground, read_terrain

LEVEL_CELL_M = 10.0
"""Distance over which a level ground's rise and fall is alike: a street's width."""


def ground_of(
    flight: Flight, cameras: Sequence[CameraInput], origin: Geodetic | None
) -> tuple[Ground | None, tuple[str, ...]]:
    """The ground of a flight, where a target is on it, and a sentence on what it is.

    Raises UsageError without an origin, InputFileError for a terrain model that is not usable.
    """
    given = flight.ground
    if given is None or not any(t.on_ground for t in flight.targets):
        return None, () if given is None else ("[ground] is given, but no target is on_ground: it is not used",)
    if origin is None:
        raise _no_origin(flight, "ground")
    if given.terrain is None:
        assert given.height_m is not None
        sea = given.datum == "msl"
        at = level_ground(given.height_m, origin, given.sigma_m, geoid_height_m if sea else None)
        what = "mean sea level" if sea else "the ellipsoid"
        return _ground(given, at, LEVEL_CELL_M, f"level ground {given.height_m:g} m above {what}"), ()
    around = np.concatenate([c.poses.position_enu_m[:, :2] for c in cameras])
    model = read_terrain(
        given.terrain, origin=origin, around_m=around, geoid=geoid_height_m, datum=given.datum,
        key=f"{flight.path}: ground.datum",
    )  # fmt: skip
    return _ground(given, model.at, model.cell_m, given.terrain.name), (f"ground: {model.words}",)


def _ground(given: GroundSettings, at: object, cell_m: float, source: str) -> Ground:
    return Ground(at=at, sigma_m=given.sigma_m, common_m=given.common_m, cell_m=cell_m, source=source)  # type: ignore[arg-type]


def landmarks(flight: Flight, tracks: Sequence[ImageTrack], origin: Geodetic | None) -> tuple[TargetInput, ...]:
    """The landmarks of a flight that are seen, as still targets. Raises UsageError without an origin."""
    seen = {t.target for t in tracks if t.seen.any()}
    return tuple(
        TargetInput(
            target=mark.name, motion="polynomial", order=0, landmark=True, check=mark.check,
            surveyed=_place(flight, mark, origin),
        )
        for mark in flight.landmarks
        if mark.name in seen
    )  # fmt: skip


def _place(flight: Flight, mark: LandmarkSettings, origin: Geodetic | None) -> SurveyedPlace | None:
    if not mark.surveyed:
        return None
    place = mark.enu_m
    if mark.place is not None:
        if origin is None:
            raise _no_origin(flight, f"landmarks.{mark.name}.lat")
        lat, lon = np.array(mark.place.lat_rad), np.array(mark.place.lon_rad)
        height = mark.place.height_m
        if mark.datum == "msl":
            height += float(geoid_height_m(lat[None], lon[None])[0])
        east, north, up = enu_from_geodetic(lat, lon, np.array(height), origin)
        place = float(east), float(north), float(up)
    assert place is not None
    return SurveyedPlace(position_enu_m=place, sigma_m=(mark.sigma_m, mark.sigma_m, mark.sigma_up_m))


def _no_origin(flight: Flight, key: str) -> UsageError:
    return UsageError(
        where=f"{flight.path}: {key}", seen="a place on the earth, but the flight's own origin is not known",
        expected="where local east, north and up begin", advice="write origin = { lat = ..., lon = ..., height = ... }",
    )  # fmt: skip
