"""Running an iterator ahead of whoever uses it, in a thread of its own; memory stays constant."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class _Failed:
    error: BaseException


@dataclass(frozen=True, kw_only=True)
class _Ready(Generic[Item]):
    item: Item


Ready = queue.Queue[_Ready[Item] | _Failed | None]


def prefetched(source: Iterator[Item], depth: int) -> Generator[Item, None, None]:
    """The items of `source` in order, up to `depth` of them made in advance; its errors come out here.

    When this is closed the source is, in its own thread.
    """
    ready: Ready[Item] = queue.Queue(depth)
    stop = threading.Event()
    worker = threading.Thread(target=_work, args=(source, ready, stop), daemon=True)
    worker.start()
    try:
        while (got := ready.get()) is not None:
            if isinstance(got, _Failed):
                raise got.error
            yield got.item
    finally:
        stop.set()
        while worker.is_alive():
            _drain(ready)
            worker.join(0.02)


def _work(source: Iterator[Item], ready: Ready[Item], stop: threading.Event) -> None:
    try:
        for item in source:
            if stop.is_set():
                break
            ready.put(_Ready(item=item))
    except BaseException as error:
        ready.put(_Failed(error=error))
    else:
        ready.put(None)
    finally:
        close = getattr(source, "close", None)
        if close is not None:
            close()


def _drain(ready: Ready[Item]) -> None:
    try:
        while True:
            ready.get_nowait()
    except queue.Empty:
        return
