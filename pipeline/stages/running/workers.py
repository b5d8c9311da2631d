"""Tracking several videos at once, one process per camera.

Workers end with their parent, however it ends; what they report goes through a queue.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any

from calibration.foundation.progress import Progress
from pipeline.flight import Flight
from pipeline.stages.inputs.tracks import track_camera
from pipeline.tracking import VideoTracks

_reports: Any = None
PATIENCE_S = 0.2


def track_all(flight: Flight, names: Sequence[str], progress: Progress) -> Iterator[tuple[str, VideoTracks]]:
    """The tracks of each named camera, as they get ready."""
    count = min(len(names), os.cpu_count() or 1)
    if count < 2:
        for name in names:
            yield name, track_camera(flight, flight.camera(name), _named(progress, name))
        return
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    with ProcessPoolExecutor(count, context, _begin, (reports, os.getpid())) as pool:
        running = {pool.submit(_track, flight, name): name for name in names}
        try:
            yield from _collect(running, reports, progress)
        finally:
            if running:  # one camera failed: the others' work is not waited for, nor left to fail aloud
                for process in multiprocessing.active_children():
                    process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)


def _collect(
    running: dict[Future[VideoTracks], str], reports: Any, progress: Progress
) -> Iterator[tuple[str, VideoTracks]]:
    while running:
        done, _ = wait(running, timeout=PATIENCE_S, return_when=FIRST_COMPLETED)
        while True:
            try:
                progress(*reports.get_nowait())
            except queue.Empty:
                break
        for future in done:
            yield running.pop(future), future.result()


def _named(progress: Progress, name: str) -> Callable[[int, int], None]:
    return lambda done, total: progress(f"track {name}", done, total)


def _begin(reports: Any, parent: int) -> None:
    global _reports
    _reports = reports
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    """Ends this process when its parent is gone: a killed run leaves no workers behind."""
    while os.getppid() == parent:
        time.sleep(PATIENCE_S)
    os._exit(1)


def _track(flight: Flight, name: str) -> VideoTracks:
    def tell(done: int, total: int) -> None:
        if done % 10 == 0 or done == total:
            _reports.put((f"track {name}", done, total))

    return track_camera(flight, flight.camera(name), tell)
