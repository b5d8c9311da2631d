"""Files by path or URL. Paths are the machine's own; URLs go through fsspec, which knows S3, HTTP, SSH and others."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from calibration.foundation.errors import InputFileError, RunningFixError, UsageError, WriteError

SCHEME = re.compile(r"^([a-zA-Z][a-zA-Z0-9+.-]+)://")
"""At least two letters, so that a Windows drive is none."""


def is_url(name: str) -> bool:
    """Whether `name` is a URL; `file://` counts, and chains of protocols are URLs that are refused."""
    return SCHEME.match(name) is not None


def as_path(name: str) -> Path | None:
    """The path of a name on this machine; None where it is elsewhere."""
    if not is_url(name):
        return Path(name)
    return Path(name[len("file://") :]) if name.startswith("file://") else None


def check_place(out: str) -> None:
    """Raises UsageError where a protocol is named and no place behind it."""
    if is_url(out) and not inside(out):
        raise UsageError(
            where="-o",
            seen=f"{out}, a protocol and no place",
            expected="a folder or URL",
            advice="-o s3://bucket/batch",
        )


def file_system(url: str) -> Any:
    """The file system of a URL.

    Raises UsageError where the protocol or its package is missing, InputFileError where it does not answer.
    """
    fsspec = _fsspec()
    if "::" in url:
        raise UsageError(where=url, seen="a chain of protocols", expected="one URL", advice="name the place itself")
    try:
        with reaching(url, passing=(ImportError, ValueError)):
            return fsspec.core.url_to_fs(url)[0]
    except (ImportError, ValueError) as error:
        raise UsageError(
            where=url, seen=str(error), expected="a path, or a URL that fsspec knows", advice="s3:// needs s3fs"
        ) from None


def _fsspec() -> Any:
    try:
        import fsspec
    except ImportError:
        raise UsageError(
            where="a URL", seen="the package 'fsspec' is not installed", expected="it, to open URLs",
            advice="pip install 'runningfix[batch]'",
        ) from None  # fmt: skip
    return fsspec


@contextmanager
def reaching(url: str, *, to_write: bool = False, passing: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """What goes wrong with a place elsewhere, but `passing`, becomes one kind of error, whatever library it is of."""
    known: tuple[type[Exception], ...] = (RunningFixError, *passing)
    try:
        yield
    except known:
        raise
    except FileNotFoundError:
        raise InputFileError(where=url, seen="no such file", expected="a file there", advice="check the URL") from None
    except Exception as error:  # every library of a protocol has exceptions of its own
        kind = WriteError if to_write else InputFileError
        raise kind(
            where=url,
            seen=f"cannot be {'written' if to_write else 'read'} ({type(error).__name__}: {error})",
            expected="a place that answers",
            advice="check the URL, the network and what you may do there",
        ) from None


def matching(pattern: str) -> list[str]:
    """URLs that a pattern stands for, in order. Raises InputFileError."""
    found = file_system(pattern)
    scheme = SCHEME.match(pattern)
    assert scheme is not None
    with reaching(pattern):
        return [f"{scheme[1]}://{str(name).lstrip('/')}" for name in sorted(found.glob(pattern))]


def inside(url: str) -> str:
    """The path of a URL in its own place: bucket and all."""
    return SCHEME.sub("", url).lstrip("/")
