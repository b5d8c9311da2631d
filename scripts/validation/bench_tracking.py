"""Tracking against decoding alone, interleaved in one run on the same 720p video; and memory over a long video.

usage: python -m scripts.validation.bench_tracking [--rounds 7] [--crf 15] [--video FILE --box X,Y,W,H ...]
       python -m scripts.validation.bench_tracking --minutes 30     memory over a long video (480 x 270, two targets)

Without --video a scene with four cars is rendered and compressed by H.264 (extra `demo`). A round decodes the video
with as many threads as tracking lets FFmpeg have, tracks one target, tracks all, tracks all of them four times over,
and decodes with OpenCV as it comes; ratios are of each round's decoding with the same threads, their median is told.
"""

import argparse
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import cv2

from pipeline.records import Box
from pipeline.synthetic.moving_cars import first_box, render, scene, write
from pipeline.tracking import track_video, video_times
from pipeline.tracking.video.frames import opened_to_the_end
from scripts.validation.figures import tell

SEED = 5


def decoded(path: Path) -> tuple[float, float]:
    """Wall and processor seconds of decoding every frame, as tracking does it."""
    begin, used, capture = time.perf_counter(), time.process_time(), opened_to_the_end(path)
    for shot in capture.shots():
        capture.pixels(shot)
    capture.close()
    return time.perf_counter() - begin, time.process_time() - used


def decoded_by_opencv(path: Path) -> tuple[float, float]:
    """The same by OpenCV, with the threads it takes by itself."""
    begin, used, capture = time.perf_counter(), time.process_time(), cv2.VideoCapture(str(path))
    while capture.read()[0]:
        pass
    return time.perf_counter() - begin, time.process_time() - used


def tracked(path: Path, boxes: dict[str, Box]) -> tuple[float, float]:
    """Wall and processor seconds of tracking every target."""
    begin, used = time.perf_counter(), time.process_time()
    track_video(path, camera="c", boxes=boxes)
    return time.perf_counter() - begin, time.process_time() - used


def rendered(folder: Path, crf: int, small: bool) -> tuple[Path, dict[str, Box]]:
    """A video of four cars (two, where it is to be small) in view throughout, 250 frames, and their boxes."""
    made = scene(31, size=(480, 270), lengths=(22, 34), hidden=(0, 0)) if small else scene(SEED, hidden=(0, 0, 0, 0))
    path = folder / "bench.mp4"
    write(render(made), path, codec="h264", crf=crf)
    return path, {car.name: first_box(made, car) for car in made.cars}


def lengthened(path: Path, minutes: float) -> Path:
    """The video forwards and backwards again and again, so that nothing ever jumps."""
    import imageio_ffmpeg

    program, both, long = imageio_ffmpeg.get_ffmpeg_exe(), path.with_name("both.mp4"), path.with_name("long.mp4")
    turned = "[0:v]split[a][b];[b]reverse[r];[a][r]concat"
    encode = [program, "-loglevel", "error", "-i", path, "-filter_complex", turned, "-crf", "23", both]
    subprocess.run(encode, check=True)
    loops = str(round(minutes * 60 / 20) - 1)
    copy = [program, "-loglevel", "error", "-stream_loop", loops, "-i", both, "-c", "copy", long]
    subprocess.run(copy, check=True)
    return long


def resident_mb() -> float:
    """Memory of this process now (Linux)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def memory(path: Path, boxes: dict[str, Box]) -> None:
    """Prints the memory at tenths of the video."""
    told: list[int] = []
    used_mb: list[float] = []

    def progress(done: int, total: int) -> None:
        if done * 10 // total > len(told) - 1 and done > 500:
            told.append(done)
            used_mb.append(resident_mb())
            print(f"{done:>9} of {total} frames{used_mb[-1]:>9.0f} MB", flush=True)

    tracks = track_video(path, camera="c", boxes=boxes, progress=progress).tracks
    tell({"frames": told[-1], "memory_mb": [min(used_mb), max(used_mb)]})
    print("share of frames with a fix: " + ", ".join(f"{track.seen.mean():.3f}" for track in tracks))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--crf", type=int, default=15, help="of the rendered video")
    parser.add_argument("--minutes", type=float, help="measure memory over a video of that length instead")
    parser.add_argument("--video", type=Path)
    parser.add_argument("--box", nargs="+", default=[], help="X,Y,W,H on frame 0")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if arguments.video:
            path, given = arguments.video, [[float(v) for v in box.split(",")] for box in arguments.box]
            boxes = {f"t{i}": Box(frame=0, x=x, y=y, width=w, height=h) for i, (x, y, w, h) in enumerate(given)}
        else:
            path, boxes = rendered(Path(scratch), arguments.crf, bool(arguments.minutes))
        if arguments.minutes:
            memory(lengthened(path, arguments.minutes), boxes)
            return
        times = video_times(path)
        frames, rate = times.frames, times.frame_rate
        print(f"{frames:.0f} frames, {path.stat().st_size * 8e-6 * rate / frames:.1f} Mbit/s")
        one = dict(list(boxes.items())[1:2] or boxes.items())
        tracked(path, boxes)  # compiled code is loaded once
        many = {f"{name}-{k}": box for name, box in boxes.items() for k in range(4)}
        rounds = [
            (decoded(path), tracked(path, one), tracked(path, boxes), tracked(path, many), decoded_by_opencv(path))
            for _ in range(arguments.rounds)
        ]
    names = ("decoding alone", "1 target", f"{len(boxes)} targets", f"{len(many)} targets", "OpenCV decoding")
    for k, name in enumerate(names):
        wall = statistics.median(r[k][0] for r in rounds)
        used = statistics.median(r[k][1] for r in rounds)
        ratios = sorted(r[0][0] / r[k][0] for r in rounds)
        tell({name: {"of_decoding": statistics.median(ratios), "least": ratios[0], "most": ratios[-1]}})
        print(
            f"{name:<18}{frames / wall:>7.0f} frames/s  {used / frames * 1e3:>6.2f} ms CPU a frame   of decoding: "
            f"median {statistics.median(ratios):.2f}, {ratios[0]:.2f} to {ratios[-1]:.2f}"
        )


if __name__ == "__main__":
    main()
