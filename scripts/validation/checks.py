"""What can be checked: every validation and benchmark by name, with how long it takes on two cores of 3 GHz."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Check:
    """One module of this folder with its arguments.

    minutes    about how long it takes
    says       what its figures are about
    needs      what it cannot run without, beyond the extras of `test`; empty: nothing
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    minutes: float
    says: str
    needs: str = ""

    @property
    def program(self) -> tuple[str, ...]:
        """What follows `python`."""
        return ("-m", f"scripts.validation.{self.module}", *self.arguments)


CHECKS = (
    Check(
        name="ground",
        module="check_ground",
        minutes=60,
        says="one camera over cars on level and hilly ground: errors against claims, hovering and flying",
        needs="the extra terrain",
    ),
    Check(
        name="landmarks",
        module="check_landmarks",
        minutes=15,
        says="data/flight with surveyed landmarks, and check points on drawn flights: errors against claims",
    ),
    Check(
        name="rolling-shutter",
        module="check_rolling_shutter",
        minutes=25,
        says="swinging cameras with a readout of 20 ms: given, refined, ignored, beside a global shutter",
    ),
    Check(
        name="demo",
        module="check_demo",
        minutes=3,
        says="the rendered demo: every error against the truth, and the claimed sigma",
    ),
    Check(
        name="board-finding",
        module="bench_calibration",
        minutes=2,
        says="finding a checkerboard: milliseconds and pixels, beside OpenCV's two ways",
    ),
    Check(
        name="calibration",
        module="check_calibration",
        minutes=20,
        says="84 rendered photo sets: errors of corners and focal length, error over sigma",
    ),
    Check(
        name="mixed-cameras",
        module="check_mixed_cameras",
        minutes=8,
        says="40 rendered pairs of like cameras in one folder, and 20 single cameras: refused or named where wrong",
    ),
    Check(
        name="camera-mistakes",
        module="check_camera_mistakes",
        minutes=2,
        says="camera files of data/flight that do not fit its video; copies of calibration photos",
    ),
    Check(
        name="charuco",
        module="check_charuco",
        minutes=6,
        says="ChArUco corners beside a checkerboard's and OpenCV's on the same 40 rendered photos",
    ),
    Check(
        name="tracking",
        module="check_tracking",
        minutes=6,
        says="ten rendered scenes: pixel errors, coverage, false fixes, losses, beside KCF as it comes",
    ),
    Check(
        name="tracking-csrt",
        module="check_tracking",
        arguments=("--tracker", "csrt"),
        minutes=12,
        says="the same with CSRT as the coarse tracker",
    ),
    Check(
        name="tracking-lossless",
        module="check_tracking",
        arguments=("--lossless",),
        minutes=6,
        says="the same without the errors of compression",
    ),
    Check(
        name="tracking-effect",
        module="check_tracking_effect",
        minutes=2,
        says="positions of a flight solved with raw KCF centres and with ours",
    ),
    Check(
        name="tracking-speed",
        module="bench_tracking",
        arguments=("--rounds", "9"),
        minutes=2,
        says="tracking against decoding alone",
    ),
    Check(
        name="tracking-memory",
        module="bench_tracking",
        arguments=("--minutes", "30"),
        minutes=8,
        says="memory while 30 minutes of video are tracked",
    ),
    Check(
        name="correlated-errors",
        module="check_correlated_errors",
        arguments=("--runs", "200"),
        minutes=10,
        says="error over sigma where errors of tracked centres last",
    ),
    Check(
        name="start-auto",
        module="check_start_auto",
        minutes=12,
        says="20 rendered flights: the video's start found on the log's clock",
    ),
    Check(
        name="logs",
        module="bench_telemetry",
        minutes=4,
        says="log readers beside pymavlink's, warm and in fresh processes, every value compared",
    ),
    Check(
        name="logs-large",
        module="bench_telemetry",
        arguments=("--large",),
        minutes=3,
        says="a .tlog of 1 GB: seconds and memory, whole and in part",
    ),
    Check(
        name="log-corruption",
        module="check_log_corruption",
        minutes=15,
        says="1000 corruptions each of two kinds of log, beside pymavlink",
    ),
    Check(
        name="log-readers",
        module="check_log_readers",
        minutes=6,
        says="real logs beside pymavlink and pyulog: every message and value, and with broken definitions",
        needs="a folder of logs as --real FOLDER",
    ),
    Check(
        name="log-fuzzing",
        module="check_log_corruption",
        arguments=("--fuzz", "10"),
        minutes=10,
        says="every reader on mangled files: crashes, hangs, memory",
    ),
    Check(
        name="offset-search",
        module="check_offset_search",
        minutes=2,
        says="100 random flights, clocks unknown by a minute",
    ),
    Check(
        name="match",
        module="check_match",
        minutes=8,
        says="100 drawn flights with strangers and unknown clocks: pairs found, wrong ones told",
    ),
    Check(
        name="ordinary-flights",
        module="check_ordinary_flights",
        minutes=40,
        says="ordinary flights with nothing but defaults: error over claim, and beside the true motion given",
    ),
    Check(
        name="gnss-walk",
        module="check_ordinary_flights",
        arguments=("--walk", "gnss10", "--flights", "50", "--seed", "6000"),
        minutes=40,
        says="the same with positions that walk by 1 m in 10 s, claimed white",
    ),
    Check(
        name="attitude-walk",
        module="check_ordinary_flights",
        arguments=("--walk", "attitude", "--flights", "50", "--seed", "7000"),
        minutes=40,
        says="the same with attitudes that walk by 0.3 degrees in 10 s, claimed white",
    ),
    Check(
        name="depth-intervals",
        module="check_depth_intervals",
        minutes=10,
        says="two cameras 15 m apart, 360 m away: how often the intervals of distances hold",
    ),
    Check(
        name="demo-order",
        module="check_demo_order",
        minutes=1,
        says="mean position error of every method on ten drawn flights",
    ),
    Check(
        name="solver-limit",
        module="check_solver_limit",
        minutes=6,
        says="map over the Cramer-Rao bound and over its own covariance, 16 cells of 200 flights",
    ),
    Check(
        name="solver-speed",
        module="bench_solver",
        arguments=("--li", "--repeats", "9"),
        minutes=2,
        says="one solve of three sizes, beside Li's method and (where ceres_map is installed) Ceres",
    ),
    Check(
        name="flight-speed",
        module="bench_flight",
        minutes=6,
        says="`runningfix solve` on flight files of three sizes, poses by frame, by time and from logs, beside Ceres",
    ),
    Check(
        name="solver-hour",
        module="bench_solver",
        arguments=("--sizes", "4x5625x4,4x22500x4,4x90000x4"),
        minutes=2,
        says="one solve of up to an hour of four cameras: seconds and memory",
    ),
    Check(
        name="experiments",
        module="check_experiments",
        minutes=30,
        says="the paper's experiments, 1000 flights each: map against every method and the bound",
    ),
    Check(
        name="mutants",
        module="check_mutants",
        minutes=240,
        says="150 small faults put into the code, one at a time: how many of them the tests find",
    ),
    Check(
        name="resume",
        module="check_resume",
        minutes=3,
        says="a run killed at ten random moments and started again: the same bytes",
    ),
    Check(
        name="batch",
        module="check_batch",
        minutes=12,
        says="200 flights, two workers, one killed, one flight endless, one too large: 198 done, the same bytes, time",
    ),
    Check(
        name="batch-cluster",
        module="check_batch",
        arguments=("--scheduler",),
        minutes=12,
        says="the same on a local Dask cluster",
    ),
    Check(
        name="hour",
        module="check_hour",
        minutes=30,
        says="an hour of two videos with twenty targets through `runningfix run`: memory over time, seconds",
    ),
    Check(
        name="kills",
        module="check_kills",
        arguments=("--kills", "100"),
        minutes=180,
        says="run, solve, track, calibrate and batch killed at 100 random moments each: the same bytes",
    ),
    Check(
        name="fuzz",
        module="check_fuzzing",
        minutes=115,
        says="every kind of input for ten minutes each, made as coverage leads: crashes, hangs, memory",
        needs="the extra `fuzz`",
    ),
    Check(
        name="verdict",
        module="check_verdict",
        minutes=40,
        says="30 kinds of mistake: never good where it matters, the culprit named; ordinary flights without alarms",
    ),
    Check(
        name="real-flights",
        module="check_flights",
        minutes=1,
        says="two real flights against RTK: errors, clocks, coverage",
        needs="the flights' folder as --real FOLDER",
    ),
    Check(
        name="flight-chance",
        module="check_flight_chance",
        minutes=1,
        says="what coverage of one flight would be if its claimed sigmas were exactly true",
        needs="a flight's file whose tracks are files, as --real FILE",
    ),
)


def named(names: list[str]) -> list[Check]:
    """The checks of these names, each once and in this module's order; `all` is every one that needs nothing.

    Raises KeyError with the first name that is none.
    """
    known = {check.name: check for check in CHECKS}
    wanted = {name for name in names if name != "all"}
    for name in names:
        if name != "all" and name not in known:
            raise KeyError(name)
    if "all" in names:
        wanted |= {check.name for check in CHECKS if not check.needs}
    return [check for check in CHECKS if check.name in wanted]
