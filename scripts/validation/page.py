"""The page of accuracy and speed, made from the result file: no figure in it is typed by hand.

A row says what was measured, by which check, and how its figures read. A check that is not in the file has no figure on
the page, and the page says so.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scripts.validation.checks import CHECKS

Figures = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Row:
    """What a check's figures say, in words."""

    check: str
    what: str
    words: Callable[[Figures], str]


def demo_rows(f: Figures, unit: str) -> str:
    """The demo's comparison in one unit."""
    rows = [(name, v) for name, v in f.items() if isinstance(v, dict) and v.get("unit") == unit]
    return "; ".join(
        f"{name}: {v['after']:.3g} {unit}, claimed {v['sigma']:.3g}, before {v['before']:.3g}" for name, v in rows
    )


def tracking(f: Figures) -> str:
    """Ours over all cars of the ten scenes."""
    ours, kcf = f["ours"], f["kcf"]
    x, y = ours["rms_px"]
    return (
        f"{x:.2f} and {y:.2f} px RMS, 95 % of errors within {ours['within_95_percent_px']:.2f} px, coverage "
        f"{ours['coverage']:.3f}, fixes while hidden {ours['false_fixes']}, "
        f"{ours['found_again']} of {ours['hidden']} found again, error over sigma {ours['error_over_sigma']:.2f}, "
        f"{f['cpu_ms_a_frame']:.0f} ms of processor time a frame; {f['failed']} of {f['cars']} cars failed. Raw KCF: "
        f"{kcf['rms_px'][0]:.1f} and {kcf['rms_px'][1]:.1f} px, coverage {kcf['coverage']:.2f}, "
        f"{kcf['found_again']} of {kcf['hidden']} found again"
    )


def correlation(f: Figures) -> str:
    """How alike errors are some frames apart."""
    return ", ".join(f"{value:.2f} after {lag}" for lag, value in f["correlation_after_frames"].items())


def robust(f: Figures) -> str:
    """Error over robust sigma by kind of error; plain in brackets."""
    return "; ".join(
        f"{kind}: offset {v['offset_robust']:.2f} ({v['offset_plain']:.2f}), positions {v['position_robust']:.2f} "
        f"({v['position_plain']:.2f})"
        for kind, v in f.items()
    )


def solver_rows(f: Figures) -> str:
    """Seconds by size, and over the peers where they ran."""
    texts = []
    for size, v in f.items():
        more = "".join(
            f", {peer} takes {v[key]:.1f} times as long"
            for peer, key in (("Ceres", "ratio"), ("Li", "li_ratio"))
            if key in v
        )
        texts.append(f"{size}: {1e3 * v['seconds']:.2f} ms, {v['iterations']} iterations, {v['peak_gb']:.2f} GB{more}")
    return "; ".join(texts)


def flight_rows(f: Figures) -> str:
    """Seconds of the solver by size and kind of poses, over Ceres' where it ran, and the whole command's."""
    return "; ".join(
        f"{kind}: {1e3 * v['solver_s']:.1f} ms"
        + (f", Ceres takes {v['ratio']:.1f} times as long, {1e3 * v['apart_m']:.1f} mm apart" if "ratio" in v else "")
        + f"; the command {v['processor_s']:.1f} s of processor time"
        for kind, v in f.items()
    )


def corruption(f: Figures) -> str:
    """Sums over all kinds of damage."""
    total = {key: sum(v.get(key, 0) for v in f.values()) for key in ("runs", "crash", "wrong", "fewer", "theirs wrong")}
    return (
        f"{total['runs']} damaged logs: {total['crash']} crashes, {total['wrong']} wrong messages (pymavlink: "
        f"{total['theirs wrong']}), {total['fewer']} logs with fewer good messages than pymavlink finds"
    )


def readers(f: Figures) -> str:
    """Sums over all logs, whole and with broken definitions."""
    total = {key: sum(v[key] for v in f.values()) for key in ("theirs", "lacking", "compared", "differ")}
    broken = [v["broken definitions"] for v in f.values() if "broken definitions" in v]
    return (
        f"{len(f)} logs: {total['lacking']} of their {total['theirs']} messages lacking, {total['differ']} of "
        f"{total['compared']} values differ; {sum(b['runs'] for b in broken)} broken definitions: fewer good "
        f"messages in {sum(b.get('fewer', 0) for b in broken)}"
    )


def shutters(f: Figures) -> str:
    """Errors over those of a global shutter, and what was said."""
    return (
        f"{f['flights']} flights: given {f['given_over_global']:.3f}, refined {f['refined_over_global']:.3f}, ignored "
        f"{f['ignored_over_global']:.2f}; refined within 3 sigma {100 * f['refined_within_3_sigma']:.1f} %, error over "
        f"sigma {f['refined_error_over_sigma']:.2f}; ignored, and said in {100 * f['ignored_said']:.0f} %; said of a "
        f"global shutter in {100 * f['global_said']:.0f} %"
    )


def span(values: list[float], digits: int = 2) -> str:
    """Least to most."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


ROWS = (
    Row(
        check="demo",
        what="demo: position of each target, error against the claimed sigma",
        words=lambda f: demo_rows(f, "m"),
    ),
    Row(check="demo", what="demo: clocks", words=lambda f: "; ".join(demo_rows(f, unit) for unit in ("ms", "mHz"))),
    Row(check="demo", what="demo: attitude of the cameras", words=lambda f: demo_rows(f, "deg")),
    Row(
        check="demo-order",
        what="mean position error of the methods over drawn flights of the demo's scene, m",
        words=lambda f: ", ".join(f"`{name}` {value:.2f}" for name, value in f["mean_error_m"].items()),
    ),
    Row(check="tracking", what="ten rendered scenes, not tuned on, cars of 10 to 50 px, hidden once", words=tracking),
    Row(check="tracking-csrt", what='the same with `tracker = "csrt"`', words=tracking),
    Row(check="tracking-lossless", what="the same without the errors of compression", words=tracking),
    Row(check="tracking", what="the same: correlation of the errors some frames apart", words=correlation),
    Row(
        check="correlated-errors",
        what="flights of 10 s whose centres err: error over robust (plain) sigma",
        words=robust,
    ),
    Row(
        check="tracking-effect",
        what="a flight of RTK grade solved with raw KCF centres and with ours, RMS",
        words=lambda f: f"{f['raw_kcf_m']:.2f} m and {f['ours_m']:.2f} m",
    ),
    Row(
        check="tracking-speed",
        what="speed of tracking over that of decoding alone, interleaved, 720p H.264",
        words=lambda f: ", ".join(
            f"{name} {v['of_decoding']:.2f} ({v['least']:.2f} to {v['most']:.2f})" for name, v in f.items()
        ),
    ),
    Row(
        check="tracking-memory",
        what="memory while tracking 30 minutes of video",
        words=lambda f: f"{f['memory_mb'][0]:.0f} to {f['memory_mb'][1]:.0f} MB over {f['frames']} frames",
    ),
    Row(
        check="board-finding",
        what="finding an 11x8 board: time a photo, over ours, corner error RMS",
        words=lambda f: "; ".join(
            f"{name}: {v['ms_a_view']:.1f} ms, {v['times_ours']:.1f}, {v['corner_px']:.3f} px" for name, v in f.items()
        ),
    ),
    Row(
        check="calibration",
        what="rendered photo sets, bad photos among them: corners, focal length, error over sigma",
        words=lambda f: (
            f"{f['sets']} sets: {f['corner_px']:.3f} px RMS, worst {f['corner_worst_px']:.3f}; "
            f"{f['focal_percent']:.3f} % RMS, worst {f['focal_worst_percent']:.3f}; parameters "
            f"{span(list(f['error_over_sigma'].values()))}, directions {f['direction_error_over_sigma']:.2f}"
        ),
    ),
    Row(
        check="mixed-cameras",
        what="photos of two like cameras in one folder (focal lengths 0 to 1 %, principal points 2 to 20 px apart)",
        words=lambda f: (
            f"{f['pairs']} pairs, {f['wrong']} more than 2 sigmas off when mixed: {f['told']} refused or named; of "
            f"{f['single']} single cameras {f['single_alarms']} were"
        ),
    ),
    Row(
        check="camera-mistakes",
        what="camera files of another size, crop or turn than the video's; copies of photos",
        words=lambda f: (
            f"{f['refused']} of {f['mistakes']} refused before tracking; up to {max(f['copies'])} copies change a "
            f"sigma by {100 * f['largest_change_of_a_sigma']:.2f} %"
        ),
    ),
    Row(
        check="charuco",
        what="ChArUco corners beside a checkerboard's on the same photos, RMS per axis, OpenCV's in brackets",
        words=lambda f: (
            f"whole boards {f['charuco_whole_px']:.4f} ({f['opencv_charuco_whole_px']:.4f}), partial "
            f"{f['charuco_partial_px']:.4f} ({f['opencv_charuco_partial_px']:.4f}), checkerboard "
            f"{f['checkerboard_whole_px']:.4f} ({f['opencv_checkerboard_whole_px']:.4f}) px"
        ),
    ),
    Row(
        check="start-auto",
        what='`start = "auto"` on rendered flights (14 s of video in 100 s of log)',
        words=lambda f: (
            f"within half a frame in {f['right']} of {f['flights']}, {f['refused']} refused, {f['wrong']} wrong, "
            f"error over claimed sigma {f['error_over_sigma']:.2f}; still flights refused: "
            f"{f['still_refused_of_3']} of 3"
        ),
    ),
    Row(
        check="offset-search",
        what="offset search on random flights, clocks unknown by a minute",
        words=lambda f: (
            f"right in {f['right']} of {f['flights']}, {f['ambiguous']} flagged as ambiguous, "
            f"{f['wrong_and_silent']} wrong and silent"
        ),
    ),
    Row(
        check="ordinary-flights",
        what="ordinary flights with nothing but defaults",
        words=lambda f: (
            f"error over claim {f['error_over_claim']:.2f} over {f['flights']} flights, at most {f['greatest']:.2f}; "
            f"{f['offsets_beyond_four_sigmas']} offsets more than four sigmas off; "
            + ", ".join(f"{grade} {count}" for grade, count in f.get("grades", {}).items())
        ),
    ),
    Row(
        check="gnss-walk",
        what="the same, positions that walk by 1 m in 10 s",
        words=lambda f: f"error over claim {f['error_over_claim']:.2f} over {f['flights']} flights",
    ),
    Row(
        check="attitude-walk",
        what="the same, attitudes that walk by 0.3 degrees in 10 s",
        words=lambda f: f"error over claim {f['error_over_claim']:.2f} over {f['flights']} flights",
    ),
    Row(
        check="depth-intervals",
        what="intervals of distances, cameras 15 m apart and 360 m away",
        words=lambda f: f"{f['within_68']:.2f} and {f['within_95']:.2f} of {f['intervals']} within 68 and 95 %",
    ),
    Row(
        check="verdict",
        what="verdict on flights with a mistake whose error exceeds two claims, and on ordinary ones",
        words=lambda f: (
            f"{f['not_good']} of {f['beyond_two_claims']} not good, the culprit among the first two in "
            f"{f['culprit_named']}; ordinary: "
            + ", ".join(f"{grade} {count}" for grade, count in f.get("ordinary", {}).items())
        ),
    ),
    Row(
        check="solver-limit",
        what="`map` over the Cramer-Rao bound; squared error over claimed covariance",
        words=lambda f: (
            f"{span(f['over_bound'])}; {span(f['nees'])}; {f['cells_within']} of {f['cells']} cells, "
            f"{f['flights_a_cell']} flights each"
        ),
    ),
    Row(
        check="solver-speed",
        what="one solve, one thread (cameras x frames x targets), beside its peers",
        words=solver_rows,
    ),
    Row(
        check="flight-speed",
        what="`runningfix solve` on flight files, poses by frame, by time, from logs",
        words=flight_rows,
    ),
    Row(check="solver-hour", what="the same up to an hour of four cameras at 25 Hz", words=solver_rows),
    Row(
        check="real-flights",
        what="two real flights against RTK, offsets unknown (data not included)",
        words=lambda f: "; ".join(
            f"{name}: {v['absolute_m']:.2f} m absolute, {v['aligned_m']:.2f} m aligned, {v['seconds']:.0f} s, claimed "
            f"sigmas cover {v['within_1_sigma_percent']:.0f} % at one sigma, "
            f"{v['within_1.96_sigma_percent']:.0f} % at 1.96"
            for name, v in f.items()
        ),
    ),
    Row(
        check="flight-chance",
        what="one such flight's coverage if its claims were exactly true, in 95 of 100 flights",
        words=lambda f: "; ".join(
            f"{target}, {bound}: {v['low_percent']:.0f} to {v['high_percent']:.0f} %"
            for target, told in f.items()
            for bound, v in told.items()
        ),
    ),
    Row(
        check="logs",
        what="log readers, pymavlink's processor time over ours; values compared, values that differ",
        words=lambda f: "; ".join(f"{name}: {value:.0f}" for name, value in f.items() if "pymavlink" not in name),
    ),
    Row(
        check="logs-large",
        what="position, attitude and gimbal out of a `.tlog` of 1 GB, whole, and two minutes of it",
        words=lambda f: (
            f"{f['messages']} messages: {f['seconds']:.1f} s, {f['memory_mb']:.0f} MB beyond the mapped file; "
            f"{f['part_seconds']:.2f} s, {f['part_bytes_mb']:.0f} MB of the file"
        ),
    ),
    Row(check="log-corruption", what="damaged `.tlog` and DataFlash logs, beside pymavlink", words=corruption),
    Row(check="log-readers", what="real logs beside pymavlink and pyulog (data not included)", words=readers),
    Row(
        check="log-fuzzing",
        what="every reader on mangled files",
        words=lambda f: (
            f"{f['files']} files in {f['minutes']:.0f} minutes: {f['crashed']} crashes, "
            f"slowest {f['slowest_s']:.1f} s, memory grew by {f['memory_growth_mb']:.0f} MB"
        ),
    ),
    Row(
        check="resume",
        what="a run killed at random moments and started again",
        words=lambda f: f"{f['files_that_differ']} files differ after {f['hits']} of {f['kills']} kills that hit",
    ),
    Row(
        check="mutants",
        what="small faults put into the code one at a time: found by the tests",
        words=lambda f: f"{f['killed']} of {f['mutants']}; {f['survived_explained']} of the others are explained",
    ),
    Row(
        check="ground",
        what="one camera over cars on the ground, error over claim, level and hilly, hovering and flying past",
        words=lambda f: "; ".join(
            f"{name.removesuffix('_error_over_claim').replace('_', ' ')} {value:.2f}"
            for name, value in f.items()
            if name.endswith("_error_over_claim")
        ),
    ),
    Row(
        check="landmarks",
        what="data/flight with one, three, five surveyed landmarks: position error over that without; error over sigma",
        words=lambda f: "; ".join(
            f"{n}: {f[f'over_without_{n}']:.2f}, {f[f'root_nees_{n}']:.2f}" for n in (1, 3, 5) if f"root_nees_{n}" in f
        ),
    ),
    Row(
        check="landmarks",
        what="check points on drawn flights with three surveyed points: error over sigma",
        words=lambda f: f"{f['check_error_over_sigma']:.2f} ({f['check_points']} points, {f['check_flights']} flights)",
    ),
    Row(
        check="rolling-shutter",
        what="cameras that swing at 20 degrees/s, readout 20 ms: error over that with a global shutter, readouts found",
        words=shutters,
    ),
    Row(
        check="match",
        what="pairs of tracks found, clocks unknown, half of the tracks strangers",
        words=lambda f: (
            f"{f['match_flights']} flights: {100 * f['match_right_share']:.0f} % told and right, "
            f"{100 * f['match_wrong_share']:.1f} % of those told wrong"
        ),
    ),
    *(
        Row(
            check=check,
            what=f"many flights {how}: one worker killed, one flight endless, one too large",
            words=lambda f: (
                f"{f['done']} done, {f['same_as_alone']} the same as alone, {f['timeout'] + f['memory']} reported; "
                f"time {f['ratio']:.2f} of the solves' sum over the processes"
            ),
        )
        for check, how in (("batch", "on all cores"), ("batch-cluster", "on a cluster"))
    ),
    Row(
        check="hour",
        what="an hour of two videos, twenty targets that cross them, `runningfix run`",
        words=lambda f: (
            f"{f['greatest_mb']:.0f} MB at most, while tracking {f['stage_mb'].get('track', 0):.0f} MB (second half "
            f"over first {f['growth']:.2f}); {f['seconds'] / 60:.0f} minutes at {f['rate_hz']:g} Hz; error over claim "
            f"{f['error_over_claim']:.2f}"
        ),
    ),
    Row(
        check="kills",
        what="commands killed at random, results that differ from undisturbed ones",
        words=lambda f: "; ".join(
            f"{name.removesuffix('_hits')} {f[name.replace('_hits', '_wrong')]} of {hits}"
            for name, hits in f.items()
            if name.endswith("_hits")
        ),
    ),
    Row(
        check="fuzz",
        what="inputs of every kind, made as coverage leads",
        words=lambda f: f"{f['minutes_each']:g} minutes each, {f['findings']} kinds with findings",
    ),
)


def accuracy_page(records: Mapping[str, Any]) -> str:
    """Markdown."""
    lines = [HEAD]
    for row in ROWS:
        record = records.get(row.check)
        if record is not None:
            lines.append(f"| {row.what} | {row.words(record['figures'])} | `{row.check}`, {record['day']} |")
    lines.append("")
    absent = [check.name for check in CHECKS if check.name not in records and check.name != "experiments"]
    if absent:
        lines.append(f"Not measured since the result file was begun: {', '.join(f'`{name}`' for name in absent)}.\n")
    return "\n".join(lines) + TAIL


HEAD = """# Accuracy and speed

Made from `docs/figures.json` by `python -m scripts.validation page`; no figure is typed by hand. Each row names its
check: `python -m scripts.validation run NAME` measures it again, `python -m scripts.validation` lists all checks with
how long they take. Two cores; speeds are those of the machine and the day. [](earlier-figures.md) were measured by the
same checks.

| what | figure | check |
| --- | --- | --- |"""
TAIL = """
What the paper's experiments show: [](experiments.md).

What the uncertainty does not cover: a wrong lens model, a target that is not the same physical thing in both cameras,
instruments that are worse than the flight file and the log say, errors that last for a tenth of a short flight or more
without being constant (the robust sigmas allow for them in part).
"""


def read_results(path: Path) -> dict[str, Any]:
    """The result file's records by check."""
    return dict(json.loads(path.read_text(encoding="utf-8")))
