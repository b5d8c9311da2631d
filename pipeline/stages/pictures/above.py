"""The maps of the report, seen from above through the cameras of a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.flight import CameraSettings, Flight
from pipeline.records import Ground, GroundPicture, PoseTrack, Results
from pipeline.report.views.overhead_map import map_sheets
from pipeline.stages.inputs.cameras import model_of
from pipeline.stages.inputs.single_frames import Pixels
from pipeline.stages.pictures.ground import LEAST_ABOVE_M, Level, Mosaic, Sheet, level_of, pose_at, refined
from pipeline.stages.pictures.settings import PictureSettings

Look = Callable[[int, Pixels], None]
"""Takes the number and pixels (h, w, 3) of one of a camera's frames."""


class FromAbove:
    """A picture of the ground under each map, that grows by frames."""

    def __init__(self, results: Results, level: Level | str, settings: PictureSettings) -> None:
        self._results, self._level, self._settings = results, level, settings
        self._through: list[str] = []
        self._mosaics = [] if isinstance(level, str) else [Mosaic(s, level) for s in _sheets(results, settings)]

    def through(self, flight: Flight, camera: CameraSettings, poses: Sequence[PoseTrack]) -> Look | None:
        """What takes the frames of one camera; None where its pose or its lens does not allow it."""
        own = next((p for p in poses if p.camera == camera.name), None)
        if own is None or not self._mosaics or isinstance(self._level, str) or not len(own.frame):
            return None
        at = own.position_enu_m
        if float(np.median(at[:, 2] - self._level.at(at[:, :2]))) < LEAST_ABOVE_M:
            return None
        try:
            model = refined(camera.name, model_of(flight, camera), self._results)
        except RunningFixError:  # was told where it was read for the adjustment
            return None
        self._through.append(camera.name)

        def look(frame: int, shown: Pixels) -> None:
            pose = pose_at(own, frame)
            if pose is not None and shown.shape[1::-1] == tuple(model.image_size):
                for mosaic in self._mosaics:
                    mosaic.add(shown, model, *pose)

        return look

    def pictures(self) -> tuple[tuple[GroundPicture, ...], tuple[str, ...]]:
        """One for each map of which enough was seen, and what is to be said where there is none."""
        if isinstance(self._level, str):
            return (), (self._level,)
        if not self._through:
            return (), ()
        words = f"The ground is from the videos of {', '.join(self._through)}, projected {self._level.words}."
        found = (mosaic.picture(words, self._settings) for mosaic in self._mosaics)
        return tuple(p for p in found if p is not None), ()


def from_above(results: Results, ground: Ground | None, settings: PictureSettings) -> FromAbove | None:
    """Ready to take frames; None where the verdict is not to use the result."""
    if results.solution.verdict is not None and results.solution.verdict.grade == "bad":
        return None
    return FromAbove(results, level_of(results, ground), settings)


def _sheets(results: Results, settings: PictureSettings) -> list[Sheet]:
    scale = settings.ground_px_per_unit
    return [
        Sheet(
            west_m=s.west, north_m=s.north, east_m=s.west + s.width / s.scale, south_m=s.north - s.height / s.scale,
            size=(round(s.width * scale), round(s.height * scale)),
        )
        for s in map_sheets(results)
    ]  # fmt: skip
