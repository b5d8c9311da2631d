"""Which files are translated together into one extension, and under which names it is built."""

from __future__ import annotations

import hashlib
from pathlib import Path

from native.translate import Program, read_unit
from native.wrappers import c_file

LOOPS = {
    "pipeline.solver.adjustment": ("_lanes", "_kernels", "_descent", "_assembly", "_band", "log_poses"),
    "pipeline.solver.offset_search": ("_frame_sums",),
}
"""The files of each package whose loops become its extension."""
NAME = "_native"
WIDE = {"_native_avx2": ("-march=x86-64-v3",)}
"""Beside the one for every processor of the kind: for those with AVX2 and FMA, some three times as fast."""
FLAGS = (
    "-O2", "-ftree-vectorize", "-fvect-cost-model=dynamic", "-fno-inline-functions-called-once",
    "-fno-inline-small-functions", "-finline-limit=30", "-std=gnu11", "-fno-math-errno", "-fno-trapping-math",
    "-fno-signed-zeros", "-fassociative-math", "-freciprocal-math", "-ffp-contract=fast", "-Wno-unused-function",
    "-Wno-unused-variable", "-Wno-unused-but-set-variable", "-Wno-clobbered", "-fvisibility=hidden",
)  # fmt: skip
"""As the just-in-time compiler is told: sums may be reordered, infinities and NaN mean what they mean. Little inlining:
-O3 takes three times as long to compile and gains nothing."""


def sources(root: Path, package: str) -> list[Path]:
    """The translated files of a package."""
    return [root.joinpath(*package.split("."), f"{name}.py") for name in LOOPS[package]]


def stamp(root: Path, package: str) -> str:
    """A hash of their text, wherever it is installed: an extension built of other text is not used."""
    digest = hashlib.sha256()
    for path in sources(root, package):
        digest.update(path.read_bytes().replace(b"\r\n", b"\n").replace(b"from runningfix.", b"from "))
    return digest.hexdigest()


def written(root: Path, package: str, name: str = NAME) -> str:
    """The C text of a package's extension `name`."""
    units = {f"{package}.{path.stem}": read_unit(path) for path in sources(root, package)}
    return c_file(Program(units), name, stamp(root, package), next(iter(WIDE)))
