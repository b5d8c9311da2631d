"""Tracks rendered scenes with known truth, ours and OpenCV's KCF as it comes side by side, and prints the table.

usage: python -m scripts.validation.check_tracking [--seeds 14001 14002 ...] [--keep FOLDER] [--tracker csrt]
           [--lossless]

The default seeds are ten scenes: each draws its own ground, cars of 10 to 50 px, speeds, blur, noise, one occlusion of
5 to 25 frames per car, and is compressed by H.264 at one of two qualities. Nothing was tuned on them (7001 to 7010,
9001 to 9010, 11002, 12005 to 12007 were looked at). Needs the extra `demo` for the encoder; about half a
minute a scene.

Below the table: how alike the errors of the cars that did not fail are some frames apart, and of which parts they are
made; all cars, both axes and all pairs of frames in one pool.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.errors import TrackingError
from pipeline.records import TRACKERS, Box
from pipeline.synthetic.moving_cars import Car, Scene, first_box, render, scene, truth, write
from pipeline.tracking import TrackingSettings, track_video
from scripts.validation.figures import tell

HELD_OUT = tuple(range(14001, 14011))
VISIBLE, HIDDEN, SOON_FRAMES, NEAR_PX = 0.9, 0.1, 25, 3.0
LAGS = (1, 5, 25)  # frames


@dataclass(frozen=True, kw_only=True)
class Figures:
    """One car of one scene, and what was counted.

    off    (frames, 2) errors, px, where it is in view and fixed; NaN elsewhere
    sigma  (frames,) theirs
    """

    off: np.ndarray
    sigma: np.ndarray
    visible: int
    false_fixes: int
    occluded: bool
    found_again: bool

    @property
    def fixed(self) -> np.ndarray:
        """(frames,) where there is an error."""
        return np.isfinite(self.off[:, 0])

    @property
    def errors(self) -> np.ndarray:
        """(n, 2) px."""
        return self.off[self.fixed]

    @property
    def sigmas(self) -> np.ndarray:
        """(n,) of the errors."""
        return self.sigma[self.fixed]


def drawn_scene(seed: int) -> tuple[Scene, int]:
    """A scene and its H.264 quality (crf)."""
    rng = np.random.default_rng(seed)
    lengths = tuple(np.sort(np.exp(rng.uniform(np.log(10), np.log(50), 4))))
    hidden = tuple(int(n) for n in rng.integers(5, 26, 4))
    return scene(seed, lengths=lengths, hidden=hidden, speed=rng.uniform(1.0, 3.0)), 18 if seed % 2 else 28


def first_in_view(made: Scene, car: Car) -> int:
    """The first frame from which a car is wholly in view for ten frames: there its box is drawn."""
    inside = truth(made, car, first_box(made, car))[1] > 0.99
    return next((f for f in range(len(inside) - 10) if inside[f : f + 10].all()), 0)


def whole(rows: np.ndarray, frames: int) -> np.ndarray:
    """A track's rows, NaN before its first."""
    out = np.full((frames, *rows.shape[1:]), np.nan)
    out[frames - len(rows) :] = rows
    return out


def figures(xy: np.ndarray, sigma: np.ndarray, true: np.ndarray, share: np.ndarray) -> Figures:
    """What a track (frames, 2; NaN where there is no fix) is worth."""
    fixed = np.isfinite(xy).all(axis=1)
    good, hidden = fixed & (share > VISIBLE), np.flatnonzero(share < HIDDEN)
    off = np.hypot(*(xy - true).T)
    back = np.flatnonzero((share > VISIBLE) & (np.arange(len(xy)) > hidden[-1])) if len(hidden) else np.array([], int)
    soon = back[:SOON_FRAMES]
    near = fixed[back] & (off[back] < NEAR_PX)
    found = bool(len(back) and near[: len(soon)].any() and near.sum() >= 0.9 * fixed[back].sum())
    return Figures(
        off=np.where(good[:, None], xy - true, np.nan), sigma=sigma, visible=int((share > VISIBLE).sum()),
        false_fixes=int(fixed[hidden].sum()), occluded=len(back) >= SOON_FRAMES, found_again=found,
    )  # fmt: skip


def correlation(series: Sequence[np.ndarray], lag: int) -> float:
    """Of the values of (frames, 2) series with those `lag` frames later, about zero; NaN where there is no value."""
    early = np.concatenate([s[:-lag].ravel() for s in series])
    late = np.concatenate([s[lag:].ravel() for s in series])
    both = np.isfinite(early) & np.isfinite(late)
    early, late = early[both], late[both]
    return float(early @ late / np.sqrt((early @ early) * (late @ late)))


def without_mean(series: np.ndarray) -> np.ndarray:
    """(frames, 2) less its mean over the frames that have a value."""
    return series - np.nanmean(series, axis=0)


def parts(series: Sequence[np.ndarray]) -> dict[str, float]:
    """Root mean square of (frames, 2) errors by parts: constant, on a straight line in time, the rest; of the rest
    what is new in every frame, at most: half the mean square of the steps from one frame to the next."""
    squares: list[np.ndarray] = []
    steps: list[np.ndarray] = []
    for s in series:
        frame = np.flatnonzero(np.isfinite(s[:, 0]))
        value, time_f = s[frame], frame - frame.mean()
        mean = value.mean(axis=0)
        line = np.outer(time_f, time_f @ value / max(float(time_f @ time_f), 1.0))
        split = np.stack([np.broadcast_to(mean, value.shape), line, value - mean - line])
        squares.append((split**2).mean(axis=2).T)
        steps.append((np.diff(value, axis=0)[np.diff(frame) == 1] ** 2 / 2).mean(axis=1))
    constant, line, rest = np.sqrt(np.concatenate(squares).mean(axis=0))
    new = np.sqrt(np.concatenate(steps).mean())
    return {"constant": constant, "on a line": line, "rest": rest, "new in every frame, at most": float(new)}


def memory_words(found: Sequence[Figures]) -> str:
    """How alike errors are some frames apart, and their parts."""
    series = [f.off for f in found]
    bare = [without_mean(s) for s in series]
    lags = ", ".join(map(str, LAGS))
    raw, less = (", ".join(f"{correlation(s, lag):.2f}" for lag in LAGS) for s in (series, bare))
    return (
        f"autocorrelation of the errors after {lags} frames: {raw}; with each car's own mean taken out: {less}\n"
        "their parts, px RMS per axis: " + ", ".join(f"{name} {value:.3f}" for name, value in parts(series).items())
    )


def tracked(
    path: Path, boxes: dict[str, Box], frames: int, settings: TrackingSettings
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centres (frames, 2) and sigmas (frames,) of every car; NaN for one that is given up right after its box."""
    try:
        tracks = track_video(path, camera="c", boxes=boxes, settings=settings).tracks
    except TrackingError:
        if len(boxes) > 1:
            return [tracked(path, {name: box}, frames, settings)[0] for name, box in boxes.items()]
        return [(np.full((frames, 2), np.nan), np.full(frames, np.nan))]
    return [(whole(track.xy_px, frames), whole(track.sigma_px, frames)) for track in tracks]


def raw_kcf(path: Path, box: Box) -> np.ndarray:
    """Centres (frames, 2) of OpenCV's KCF as it comes; NaN where it reports nothing."""
    capture, centres, tracker = cv2.VideoCapture(str(path)), [(np.nan, np.nan)] * box.frame, cv2.TrackerKCF.create()
    for _ in range(box.frame):
        capture.read()
    rectangle = tuple(round(v) for v in (box.x, box.y, box.width, box.height))
    while (frame := capture.read())[0]:
        good, found = True, rectangle
        if len(centres) > box.frame:
            good, found = tracker.update(frame[1])
        else:
            tracker.init(frame[1], rectangle)
        centres.append((found[0] + found[2] / 2 - 0.5, found[1] + found[3] / 2 - 0.5) if good else (np.nan, np.nan))
    return np.array(centres)


def summed(found: list[Figures]) -> dict[str, object]:
    """Figures of many cars together."""
    errors = np.concatenate([f.errors for f in found])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    normed = np.concatenate([f.errors / f.sigmas[:, None] for f in found])
    again = [f.found_again for f in found if f.occluded]
    return {
        "rms_px": rms.tolist(), "within_95_percent_px": np.percentile(np.abs(errors), 95),
        "coverage": len(errors) / sum(f.visible for f in found), "false_fixes": sum(f.false_fixes for f in found),
        "found_again": sum(again), "hidden": len(again), "error_over_sigma": np.sqrt(np.mean(normed**2)),
    }  # fmt: skip


def row(name: str, found: list[Figures], with_sigma: bool) -> str:
    """One line of the table."""
    errors = np.concatenate([f.errors for f in found])
    visible = sum(f.visible for f in found)
    again = [f.found_again for f in found if f.occluded]
    if not len(errors):
        return f"{name:<24}{'':>8}{'':>8}{'':>8}{0:>9.3f}"
    rms, p95 = np.sqrt(np.mean(errors**2, axis=0)), np.percentile(np.abs(errors), 95)
    normed = np.concatenate([f.errors / f.sigmas[:, None] for f in found])
    honest = f"{np.sqrt(np.mean(normed**2)):>9.2f}" if with_sigma else f"{'':>9}"
    return (
        f"{name:<24}{rms[0]:>8.3f}{rms[1]:>8.3f}{p95:>8.3f}{len(errors) / visible:>9.3f}"
        f"{sum(f.false_fixes for f in found):>7}{sum(again):>6}/{len(again):<4}{honest}"
    )


def main() -> None:
    """Prints a row for every car, and both methods over all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=HELD_OUT)
    parser.add_argument("--keep", type=Path, help="folder in which rendered videos are kept and looked for")
    parser.add_argument("--tracker", choices=TRACKERS, default="kcf", help="ours, with this coarse tracker")
    parser.add_argument("--lossless", action="store_true", help="videos without the errors of compression")
    arguments = parser.parse_args()
    settings = TrackingSettings(tracker=arguments.tracker)
    ours: list[Figures] = []
    raw: list[Figures] = []
    spent_s, decoded = 0.0, 0
    print(f"{'scene, car':<24}{'rms x':>8}{'rms y':>8}{'95 %':>8}{'coverage':>9}{'false':>7}{'again':>8}   err/sigma")
    with tempfile.TemporaryDirectory() as scratch:
        for seed in arguments.seeds:
            made, crf = drawn_scene(seed)
            name, codec = (f"check-{seed}.mkv", "FFV1") if arguments.lossless else (f"check-{seed}.mp4", "h264")
            path = (arguments.keep or Path(scratch)) / name
            if not path.exists():
                write(render(made), path, codec=codec, crf=crf)
            boxes = {car.name: first_box(made, car, first_in_view(made, car)) for car in made.cars}
            began = time.process_time()
            tracks = tracked(path, boxes, made.frames, settings)
            spent_s, decoded = spent_s + time.process_time() - began, decoded + made.frames
            for car, (xy, sigma) in zip(made.cars, tracks, strict=True):
                true, share = truth(made, car, boxes[car.name])
                ours.append(figures(xy, sigma, true, share))
                kcf = raw_kcf(path, boxes[car.name])
                raw.append(figures(kcf, np.ones(len(kcf)), true, share))
                print(row(f"{seed} {car.name} {car.size[0]:.0f} px", ours[-1:], True), flush=True)
    print(row("ours", ours, True))
    print(row("KCF as it comes", raw, False))
    kept = [f for f in ours if len(f.errors) > 0.8 * f.visible and np.sqrt(np.mean(f.errors**2)) < 1.0]
    print(row(f"ours, {len(ours) - len(kept)} failed left out", kept, True))
    print(memory_words(kept))
    tell({
        "ours": summed(ours), "kcf": summed(raw), "not_failed": summed(kept), "cars": len(ours),
        "failed": len(ours) - len(kept),
        "cpu_ms_a_frame": 1000 * spent_s / decoded,
        "correlation_after_frames": {lag: correlation([f.off for f in kept], lag) for lag in LAGS},
    })  # fmt: skip
    each_ms = 1000 * spent_s / decoded
    print(f"{arguments.tracker}: {each_ms:.1f} ms of processor time a frame of four cars, decoding included")


if __name__ == "__main__":
    main()
