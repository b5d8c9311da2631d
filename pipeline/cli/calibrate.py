"""`runningfix calibrate`: board photos -> camera.json."""

from __future__ import annotations

import math
import time
from argparse import Namespace
from pathlib import Path
from typing import Any

from calibration import Board, Calibration, CameraModel, calibrate_files, calibration_page, pictures, write_camera
from calibration.foundation.errors import CalibrationError, RunningFixError, UsageError
from calibration.foundation.files import write_whole
from calibration.judgement.coverage import map_in_words
from pipeline.cli.board import read_board
from pipeline.cli.camera import for_video
from pipeline.cli.console import Console

SUFFIXES = {"json": ".json", "opencv-xml": ".xml", "caliscope": ".toml", "aniposelib": ".toml"}
VERDICTS = ("poor", "usable", "good")


def run(arguments: Namespace, console: Console) -> int:
    """Calibrates, writes the camera file, says how far to believe it."""
    board = read_board(arguments)
    if arguments.crop is not None and arguments.video is None:
        raise UsageError(
            where="--crop", seen="without --for", expected="the video that shows this part", advice="add --for VIDEO"
        )
    if arguments.each:
        return _run_each(arguments, board, console)
    report, text = _calibrated(arguments.sources, arguments.output, board, arguments, console)
    console.result(report, text)
    return _code(report, arguments)


def _run_each(arguments: Namespace, board: Board, console: Console) -> int:
    """One camera after the other; one that fails is told, and the others go on."""
    cameras: dict[str, Any] = {}
    texts, codes = [], []
    for source in arguments.sources:
        name = source.resolve().name if source.is_dir() else source.stem
        if name in cameras:
            raise UsageError(
                where="--each", seen=f"two sources named {name}", expected="a name for each camera", advice="rename one"
            )
        output = arguments.output / (name + SUFFIXES.get(arguments.format, ".yaml"))
        try:
            cameras[name], text = _calibrated([source], output, board, arguments, console)
            codes.append(_code(cameras[name], arguments))
        except RunningFixError as error:
            cameras[name], text = {"status": "error", "exit_code": error.exit_code, "error": str(error)}, str(error)
            console.error(f"{name}: {error}")
            codes.append(error.exit_code)
        texts.append(f"{name}\n{text}")
    done = {"status": "done" if not any(codes) else "error", "command": "calibrate", "cameras": cameras}
    files = [file for camera in cameras.values() for file in camera.get("files", [])]
    console.result({**done, "files": files}, "\n\n".join(texts))
    return next((code for code in codes if code), 0)


def _calibrated(
    sources: list[Path], output: Path, board: Board, arguments: Namespace, console: Console
) -> tuple[dict[str, Any], str]:
    """One camera: its files written; the summary for machines and for people."""
    begin = time.perf_counter()
    stage = f"photos of {output.stem}"
    found = calibrate_files(
        sources, board, progress=lambda done, total: console.progress(stage, done, total), terms=arguments.terms
    )
    camera = found.camera if arguments.video is None else for_video(
        found.camera, output, arguments.video, arguments.crop
    )  # fmt: skip
    write_camera(output, camera, format_name=arguments.format)
    files = [str(output)]
    if arguments.report:
        page = output.with_suffix(".html")
        write_whole(
            page, calibration_page(found, title=f"Calibration of {output.stem}", pictures=pictures(sources, found))
        )
        files.append(str(page))
    seconds = time.perf_counter() - begin
    fit = {} if arguments.video is None else {"for": {"video": str(arguments.video), **_numbers(camera)}}
    for line in found.warnings:
        console.say(f"note: {line}")
    return {**summary(found, files, seconds), **fit}, words(found, files)


def _numbers(camera: CameraModel) -> dict[str, Any]:
    return {"image_size": list(camera.image_size), "K": camera.K.tolist(), "distortion": camera.distortion.tolist()}


def _code(report: dict[str, Any], arguments: Namespace) -> int:
    """5 where the verdict is worse than what was asked for."""
    wanted = arguments.at_least
    if wanted is None or VERDICTS.index(report["verdict"]) >= VERDICTS.index(wanted):
        return 0
    return CalibrationError.exit_code


def summary(found: Calibration, files: list[str], seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    return {
        "status": "done",
        "command": "calibrate",
        "method": found.lens,
        "verdict": found.verdict,
        "rms_px": found.rms_px,
        "held_out_px": found.held_out_px,
        "K": found.camera.K.tolist(),
        "distortion": found.camera.distortion.tolist(),
        "sigma": found.sigma.tolist(),
        "direction_sigma_px": {
            "typical": found.direction_sigma.typical_px,
            "worst": found.direction_sigma.worst_px,
            "where_no_board_was": _finite(found.direction_sigma.beyond_px),
        },
        "part": found.part,
        "coverage": {"boards": found.coverage.boards.tolist(), "share": round(found.coverage.area, 4)},
        "views": [
            {"name": view.name, "rms_px": view.rms_px, "held_out_px": view.held_out_px, "tilt_deg": view.tilt_deg}
            for view in found.views
        ],
        "rejected": [{"name": view.name, "reason": view.reason} for view in found.rejected],
        "warnings": list(found.warnings),
        "advice": list(found.advice),
        "seconds": {"calibrate": round(seconds, 3)},
        "files": files,
    }


def coverage_words(found: Calibration) -> list[str]:
    """The picture in five by five parts: how many boards were in each."""
    rows = map_in_words(found.coverage.boards)
    return [f"{'boards seen' if i == 0 else '':<16}{row}" for i, row in enumerate(rows)]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def words(found: Calibration, files: list[str]) -> str:
    """The same for people."""
    (fx, _, cx), (_, fy, cy), _ = found.camera.K
    rows = [f"{'view':<28}{'rms px':>8}{'held out':>10}{'tilt deg':>10}{'distance m':>12}"]
    rows += [
        f"{view.name[-28:]:<28}{view.rms_px:>8.3f}{view.held_out_px:>10.3f}{view.tilt_deg:>10.1f}{view.distance_m:>12.3f}"
        for view in found.views
    ]
    rows += [f"{view.name[-28:]:<28}not used: {view.reason}" for view in found.rejected]
    return "\n".join([
        *rows,
        "",
        f"focal length     {fx:.2f} +- {found.sigma[0]:.2f}  x  {fy:.2f} +- {found.sigma[1]:.2f} px",
        f"principal point  {cx:.2f} +- {found.sigma[2]:.2f},   {cy:.2f} +- {found.sigma[3]:.2f} px",
        f"lens             {found.lens}",
        f"reprojection     {found.rms_px:.3f} px RMS, {found.held_out_px:.3f} px for views left out",
        f"a direction      {found.direction_sigma.typical_px:.2f} px (one sigma, where boards were seen)",
        *coverage_words(found),
        f"verdict          {found.verdict}" + ("" if found.verdict == "poor" else f", {found.part}"),
        *(f"{'to photograph' if i == 0 else '':<17}{line}" for i, line in enumerate(found.advice)),
        f"written          {', '.join(files)}",
    ])  # fmt: skip
