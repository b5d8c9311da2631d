"""What the stages return: frozen records that show themselves as a table and as a drawing.

Those of a folder read its files when they are asked, so that a result opened tomorrow is the result of today.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from calibration import CameraModel
from calibration.judgement.result import Calibration
from pipeline.stages import Outlook
from pipeline.telemetry import FlightLog
from runningfix import drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibrated:
    """A calibrated camera: `calibration` with all that is known of it, `camera` alone, `verdict` in a word."""

    calibration: Calibration

    @property
    def camera(self) -> CameraModel:
        """The camera, as the other stages take it."""
        return self.calibration.camera

    @property
    def verdict(self) -> str:
        """ "good", "usable" or "poor"; `calibration.warnings` says why."""
        return self.calibration.verdict

    def to_dataframe(self) -> pd.DataFrame:
        """A row for each photo used: its corners, errors in pixels, tilt and distance."""
        names = ("name", "rms_px", "held_out_px", "tilt_deg", "distance_m")
        rows = [{**{n: getattr(v, n) for n in names}, "corners": len(v.index)} for v in self.calibration.views]
        return pd.DataFrame(rows, columns=[*names, "corners"])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Every corner where it was seen, with its residual enlarged."""
        return drawing.residuals(self.calibration, ax)

    def __repr__(self) -> str:
        k, rms = self.camera.K, self.calibration.rms_px
        return f"Calibrated({self.verdict}: focal length {k[0, 0]:.1f} x {k[1, 1]:.1f} px, rms {rms:.3f} px)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """A flight log: `log` with its series in radians and seconds on its own clock."""

    log: FlightLog

    def to_dataframe(self) -> pd.DataFrame:
        """A row for each position: log time, degrees, metres (`log.position.datum` says above what), velocity NED."""
        columns = ["time_s", "latitude_deg", "longitude_deg", "height_m", "vn_mps", "ve_mps", "vd_mps"]
        p = self.log.position
        if p is None:
            return pd.DataFrame(columns=columns, dtype=float)
        degrees = np.degrees(np.column_stack([p.lat_rad, p.lon_rad]))
        return pd.DataFrame(np.column_stack([p.time_s, degrees, p.height_m, p.velocity_ned_mps]), columns=columns)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The flown way from above."""
        table = self.to_dataframe()
        return drawing.way(table.longitude_deg, table.latitude_deg, "longitude (deg)", "latitude (deg)", ax)

    def __repr__(self) -> str:
        return f"Log({self.log.path.name}, {self.log.format}, {len(self.to_dataframe())} positions)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Doubts:
    """What can be seen of a flight before tracking; `stops` where other commands would refuse it."""

    outlook: Outlook

    @property
    def stops(self) -> bool:
        """Whether something is certain to be wrong."""
        return bool(self.outlook.errors) or any(doubt.certain for doubt in self.outlook.doubts)

    def to_dataframe(self) -> pd.DataFrame:
        """A row for each finding: certain or doubtful, where, seen, expected, advice."""
        names = ("where", "seen", "expected", "advice")
        rows = [{"certain": True, **{n: getattr(e, n) for n in names}} for e in self.outlook.errors]
        rows += [{"certain": d.certain, **{n: getattr(d, n) for n in names}} for d in self.outlook.doubts]
        return pd.DataFrame(rows, columns=["certain", *names])

    def plot(self, ax: Axes | None = None) -> Axes:
        """What each target's first position can be worth."""
        expected = self.outlook.expected
        return drawing.heights([e.target for e in expected], [e.sigma_m for e in expected], "expected sigma (m)", ax)

    def __repr__(self) -> str:
        lines = [str(error) for error in self.outlook.errors] + [doubt.words for doubt in self.outlook.doubts]
        return "\n".join(lines) or "nothing speaks against this flight"


@dataclass(frozen=True, kw_only=True, eq=False)
class _InFolder:
    """Tables of an output folder; `warnings` a sentence each."""

    folder: Path
    warnings: tuple[str, ...] = ()

    def _table(self, name: str) -> pd.DataFrame:
        return pd.read_csv(self.folder / name)


class Tracks(_InFolder):
    """Where each target was in each video."""

    def to_dataframe(self) -> pd.DataFrame:
        """`tracks.csv`: camera, target, frame, time_s, x_px, y_px, sigma_px, state."""
        return self._table("tracks.csv")

    def plot(self, ax: Axes | None = None) -> Axes:
        """The ways of all targets through the pictures of the first camera, or of one chosen before."""
        return drawing.image_ways(self.to_dataframe(), ax)


class Poses(_InFolder):
    """Where each camera was and how it was turned."""

    def to_dataframe(self) -> pd.DataFrame:
        """`poses.csv`: camera, frame, time_s, east_m, north_m, up_m, qw, qx, qy, qz (enu_from_cam), and refined."""
        return self._table("poses.csv")

    def plot(self, ax: Axes | None = None) -> Axes:
        """The cameras' ways from above."""
        return drawing.plan(self.to_dataframe(), "camera", ax)


class Result(_InFolder):
    """A solved flight: trajectories, offsets, verdict, all read from its folder."""

    @cached_property
    def solution(self) -> dict[str, Any]:
        """`solution.json`: everything that the adjustment knows of itself."""
        content: dict[str, Any] = json.loads((self.folder / "solution.json").read_text(encoding="utf-8"))
        return content

    @property
    def verdict(self) -> str:
        """ "good", "care" or "bad": do not use this; `reasons` says why."""
        return str(self.solution["verdict"]["grade"])

    @property
    def reasons(self) -> list[str]:
        """Why the verdict is what it is, a sentence each."""
        return [str(reason["words"]) for reason in self.solution["verdict"]["reasons"]]

    def to_dataframe(self) -> pd.DataFrame:
        """`trajectory.csv`: every target at even steps with velocity and the position's covariance."""
        return self._table("trajectory.csv")

    def offsets(self) -> pd.DataFrame:
        """`timing.csv`: time offset and frame rate of each camera, with their sigmas."""
        return self._table("timing.csv")

    def corrections(self) -> pd.DataFrame:
        """What was taken from each prior: parameter, value, prior_sigma, sigma (rad, m, s, Hz, px), in_prior_sigmas.

        `beyond` is true beyond three of them; `grade` is what the verdict makes of the parameter's `block`.
        """
        names = ("parameter", "value", "prior_sigma", "sigma", "in_prior_sigmas", "beyond")
        return pd.DataFrame(self.solution["corrections"], columns=[*names, "block", "chi_square", "freedom", "grade"])

    def sightings(self) -> pd.DataFrame:
        """`sightings.csv`: every observation's residual and weight."""
        return self._table("sightings.csv")

    def tracks(self) -> Tracks:
        """The tracks that went in."""
        return Tracks(folder=self.folder)

    def poses(self) -> Poses:
        """The cameras' poses, measured and refined."""
        return Poses(folder=self.folder)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Every target's way from above, with one-sigma ellipses."""
        return drawing.trajectories(self.to_dataframe(), ax)

    def __repr__(self) -> str:
        lines = [f"Result({self.folder}): {self.verdict}", *(f"  {words}" for words in self.reasons)]
        for motion in self.solution["motions"]:
            sigma = motion["typical_sigma_m"]
            lines.append(f"  {motion['target']}: {'unknown' if sigma is None else f'{sigma:.3g} m'} (one sigma)")
        return "\n".join(lines)
