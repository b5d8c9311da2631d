"""The flights that are flown: the paper's section 3.1 and 3.2, and their relatives.

The paper does not publish its geometry. These are chosen so that its own methods come near the figures it prints, and
stated beside every table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.synthetic.scene import Path, Platform, Scene, SceneCamera, SceneTarget, look_at, polynomial_motion
from pipeline.synthetic.scenes import ORIGIN, plain_lens

PAPER_RATE_HZ = 10.0
PAPER_FRAMES = 50
MIDDLE_S = 2.5
LONG_RATE_HZ = 25.0
LONG_FRAMES = 1500
LONG_EARLIER_FRAMES = 40
LONG_SPEED_MPS = 70.0
LONG_CURVE_M = 4000.0
LONG_FOCAL_PX = 12000.0
VEHICLE_MPS = 60.0 / 3.6


@dataclass(frozen=True, kw_only=True)
class Arcs:
    """UAVs on rising or sinking arcs around the targets' middle, at which they look; the targets cross it.

    range_m, height_m  of the UAVs from the middle, along the ground and above it, half-way
    crossing_rad       angle on the ground between the first and the second UAV
    speed_mps, climb_mps  of the UAVs; every other one climbs where the first sinks
    same_way           whether all UAVs fly around the targets the same way
    heading_rad        of the first target
    target_mps, turn_mps2  speed of all targets, and sideways acceleration where the order is 2
    spread_m           distance of the other targets' paths from the first
    """

    range_m: float
    height_m: float
    crossing_rad: float
    speed_mps: float
    climb_mps: float
    same_way: bool
    climb_alike: bool
    heading_rad: float
    target_mps: float
    turn_mps2: float
    spread_m: float

    def words(self) -> str:
        """For the page."""
        return (
            f"UAVs {self.range_m:.0f} m away along the ground and {self.height_m:.0f} m up, "
            f"{np.degrees(self.crossing_rad):.0f} degrees apart as the targets see them, flying arcs at "
            f"{self.speed_mps:.0f} m/s while climbing or sinking at {self.climb_mps:.1f} m/s; targets at "
            f"{self.target_mps:.0f} m/s (order 2: {self.turn_mps2:.1f} m/s\u00b2 sideways) through the middle, up to "
            f"{self.spread_m:.0f} m apart; 1280 x 720 pixels, focal length 1000 pixels; 10 Hz, 50 frames each; found "
            "by drawing geometries at random until Multi-TI, Li and Algorithm 1 came near the paper's Table 2 "
            "and Algorithm 2 was of use, without looking at map"
        )


PAPER_ARCS = Arcs(
    range_m=107.7, height_m=50.7, crossing_rad=float(np.radians(152.6)), speed_mps=45.2, climb_mps=1.5, same_way=True,
    climb_alike=True, heading_rad=float(np.radians(42.6)), target_mps=12.3, turn_mps2=1.4, spread_m=14.6,
)  # fmt: skip
"""Found by drawing geometries at random and keeping the one whose Multi-TI, Li and Algorithm 1 come nearest the
paper's Table 2, among those where Algorithm 2 is of any use; `map` was not looked at."""


def paper_flight(
    *, order: int = 1, targets: int = 1, cameras: int = 2, earlier_frames: float = 5.0,
    given_rate_hz: float = PAPER_RATE_HZ, known_clocks: bool = False, arcs: Arcs = PAPER_ARCS,
) -> Scene:  # fmt: skip
    """The simulated flight of section 3.1. Every camera but the first starts `earlier_frames` frames before it.

    The solver is told `given_rate_hz` for them and an offset of zero, or the true offset where clocks are known.
    """
    span = (-2.0, 8.0)
    offset_s = [-_share(c) * earlier_frames / PAPER_RATE_HZ for c in range(cameras)]
    return Scene(
        name="paper",
        cameras=tuple(
            SceneCamera(
                name=f"uav{c + 1}", lens=plain_lens(), platform=_arc(arcs, c, span), frame_rate=PAPER_RATE_HZ,
                nominal_rate=given_rate_hz if c else PAPER_RATE_HZ, offset_s=offset_s[c],
                given_offset_s=offset_s[c] if known_clocks else 0.0, frames=PAPER_FRAMES,
            )
            for c in range(cameras)
        ),
        targets=tuple(_target(arcs, n, order, span) for n in range(targets)),
        origin=ORIGIN,
    )  # fmt: skip


def _share(camera: int) -> float:
    """Offsets of further cameras lie between the first's and the second's."""
    return (0.0, 1.0, 0.5, 0.8, 0.3, 0.6)[camera % 6]


def _arc(arcs: Arcs, number: int, span_s: tuple[float, float]) -> Platform:
    time = np.linspace(*span_s, 21) - MIDDLE_S
    second = number % 2 == 1
    way = 1.0 if arcs.same_way or not second else -1.0
    climb = arcs.climb_mps if arcs.climb_alike or not second else -arcs.climb_mps
    azimuth = np.pi + arcs.crossing_rad * (0.5, -0.5, 0.0, 1.1, -1.1, 1.7)[number % 6]
    around = azimuth + way * arcs.speed_mps * time / arcs.range_m
    up = arcs.height_m + climb * (time + 0.15 * time**2)
    position = np.stack([arcs.range_m * np.sin(around), arcs.range_m * np.cos(around), up], axis=1)
    return _looking(time + MIDDLE_S, position, np.zeros(3), np.radians(2.0) * np.sin(0.8 * time + azimuth))


def _looking(time_s: Floats, position_m: Floats, at_m: Floats, roll_rad: Floats) -> Platform:
    """A platform on a path whose camera looks at one place."""
    yaw, pitch = look_at(position_m, at_m)
    angles = np.stack([yaw, pitch, roll_rad], axis=1)
    return Platform(
        position_enu_m=Path(time_s=time_s, value=position_m), yaw_pitch_roll_rad=Path(time_s=time_s, value=angles)
    )


_PLACES = np.array(
    [[0, 0, 0], [0.9, 0.5, 0.1], [-0.75, 0.7, 0.0], [0.4, -1.0, 0.2], [-0.9, -0.4, 0.1], [0.2, 0.9, 0.0]]
)
_TURNS = np.radians([0.0, 70.0, 160.0, 250.0, 110.0, 310.0])


def _target(arcs: Arcs, number: int, order: int, span_s: tuple[float, float]) -> SceneTarget:
    kind, ring = number % 6, 1.0 + 0.45 * (number // 6)
    heading = arcs.heading_rad + _TURNS[kind] + 0.4 * (number // 6)
    ahead, aside = np.array([np.sin(heading), np.cos(heading), 0.0]), np.array([np.cos(heading), -np.sin(heading), 0.0])
    velocity, acceleration = arcs.target_mps * ahead, arcs.turn_mps2 * aside
    return _through(f"target{number + 1}", ring * arcs.spread_m * _PLACES[kind], velocity, acceleration, order, span_s)


def _through(
    name: str, place_m: Floats, velocity: Floats, acceleration: Floats, order: int, span_s: tuple[float, float],
    middle_s: float = MIDDLE_S,
) -> SceneTarget:  # fmt: skip
    """A target that is at `place` with `velocity` at the middle of the flight; order 0 stands, 2 accelerates."""
    if order == 0:
        rows = np.array([place_m])
    elif order == 1:
        rows = np.array([place_m - velocity * middle_s, velocity])
    else:
        rows = np.array([
            place_m - velocity * middle_s + acceleration * middle_s**2 / 2, velocity - acceleration * middle_s,
            acceleration / 2,
        ])  # fmt: skip
    return SceneTarget(name=name, motion=polynomial_motion(name, rows, span_s))


def long_range(*, given_rate_hz: float = LONG_RATE_HZ) -> Scene:
    """The real-world experiment of section 3.2 as data: 15 to 20 km away, 20 km base line, four vehicles at 60 km/h."""
    middle = LONG_FRAMES / LONG_RATE_HZ / 2
    span = (-3.0, 2 * middle + 4.0)
    time = np.linspace(*span, 29)
    turn = LONG_SPEED_MPS * (time - middle) / LONG_CURVE_M
    curve = LONG_CURVE_M * np.stack([np.sin(turn), 1 - np.cos(turn), 0 * turn], axis=1)
    places = np.array([[-8500.0, -12500.0, 7500.0], [11500.0, -12500.0, 7500.0]])
    starts = (0.0, -LONG_EARLIER_FRAMES / LONG_RATE_HZ)
    cameras = tuple(
        SceneCamera(
            name=name, lens=plain_lens(focal_px=LONG_FOCAL_PX),
            platform=_looking(time, places[c] + curve, np.zeros(3), np.radians(1.0) * np.sin(0.3 * time + c)),
            frame_rate=LONG_RATE_HZ, nominal_rate=given_rate_hz if c else LONG_RATE_HZ, offset_s=starts[c],
            given_offset_s=0.0, frames=LONG_FRAMES,
        )
        for c, name in enumerate(("uav", "virtual"))
    )  # fmt: skip
    heading = np.radians([20.0, 200.0, 160.0, 340.0])
    velocity = VEHICLE_MPS * np.stack([np.sin(heading), np.cos(heading), 0 * heading], axis=1)
    around = np.array([[0.0, 0.0, 0.0], [260.0, 180.0, 0.0], [-150.0, -80.0, 0.0], [180.0, -300.0, 0.0]])
    targets = tuple(_through(f"vehicle{n + 1}", around[n], velocity[n], np.zeros(3), 1, span, middle) for n in range(4))
    return Scene(name="long-range", cameras=cameras, targets=targets, origin=ORIGIN)


def one_camera(*, kind: str, order: int = 1) -> Scene:
    """One UAV and one target on a polynomial: the cases of the paper's section 2.2.

    kind  "curved": the UAV's path is of a higher order than the target's; "straight": of the same order;
          "still": all sight rays meet in the camera; "parallel": the UAV keeps beside the target
    """
    span = (-2.0, 8.0)
    time = np.linspace(*span, 21)
    target = _through("target1", np.zeros(3), np.array([4.0, 9.0, 0.0]), np.array([1.0, -0.5, 0.0]), order, span)
    start = np.array([-60.0, -40.0, 60.0])
    along = (time - MIDDLE_S)[:, None]
    if kind == "curved":
        turn = 25.0 * along / 40.0
        path = start + 40.0 * np.concatenate([np.sin(turn), 1 - np.cos(turn), 0.1 * turn**2], axis=1)
    elif kind == "straight":
        path = start + along * np.array([20.0, -5.0, 1.0])
    elif kind == "parallel":
        path = start + target.motion.position_enu_m(time)
    else:
        path = np.repeat(start[None], len(time), axis=0)
    platform = _looking(time, path, np.zeros(3), np.zeros(len(time)))
    if kind == "parallel":
        yaw, pitch = look_at(start[None], np.zeros(3))
        angles = np.tile([yaw[0], pitch[0], 0.0], (len(time), 1))
        platform = Platform(position_enu_m=platform.position_enu_m, yaw_pitch_roll_rad=Path(time_s=time, value=angles))
    camera = SceneCamera(
        name="uav1", lens=plain_lens(focal_px=600.0), platform=platform, frame_rate=PAPER_RATE_HZ,
        nominal_rate=PAPER_RATE_HZ, offset_s=0.0, given_offset_s=0.0, frames=PAPER_FRAMES,
    )  # fmt: skip
    return Scene(name=f"one camera, {kind}", cameras=(camera,), targets=(target,), origin=ORIGIN)
