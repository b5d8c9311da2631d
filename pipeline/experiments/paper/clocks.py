"""Figures 7 to 11 and Table 1 of the paper: one target, two cameras that nobody synchronised."""

from __future__ import annotations

from functools import partial

from pipeline.experiments.declare import Cell, Curve, Experiment, Grid, Path3D
from pipeline.experiments.paper import noise_levels
from pipeline.experiments.paper.approaches import (
    ABOUT_LI,
    ALGORITHM_1,
    LI,
    LI_TO_THE_END,
    MAP,
    MULTI_TI,
    PLAIN_LI,
    PLAIN_LI_TO_THE_END,
)
from pipeline.experiments.paper.scenes import PAPER_ARCS, paper_flight

OFFSETS = tuple(range(1, 11))
EARLIER = (
    "Camera 2 starts the stated number of frames before camera 1: with this sign a frame rate given too low makes "
    "things worse, as in the paper's Table 2; with the other sign the two errors cancel."
)
ABOUT_RATE = "The wrong rate is that of camera 2; wrong in both it would only rename the seconds."


def offset() -> Experiment:
    """Fig. 7."""
    cells = tuple(
        Cell(
            values={"noise": name, "offset_frames": frames},
            scene=partial(paper_flight, earlier_frames=frames, arcs=PAPER_ARCS),
            noise=noise,
        )
        for name, noise in (("high", noise_levels.HIGH), ("low", noise_levels.LOW))
        for frames in OFFSETS
    )
    return Experiment(
        name="offset",
        title="How well the time offset is found",
        paper="Fig. 7",
        about="Error of the estimated offset of camera 2, in frames of 0.1 s, for true offsets of 1 to 10 frames under "
        "high and low noise. Bars show the deviation of a single run, as in the paper.",
        geometry=PAPER_ARCS.words(),
        cells=cells,
        approaches=(ALGORITHM_1, MAP),
        drawings=(
            Curve(
                caption="Offset error, frames", measure="offset_frames", x="offset_frames", panel="noise",
                spread="deviation",
            ),
            Curve(
                caption="Root mean square of the offset error, frames, and the bound", measure="offset_rms_frames",
                x="offset_frames", panel="noise",
            ),
        ),
        remarks=(noise_levels.ABOUT, noise_levels.ABOUT_LOW, EARLIER),
    )  # fmt: skip


def _against_offset(name: str, title: str, paper: str, rate_hz: float) -> Experiment:
    cells = tuple(
        Cell(
            values={"order": order, "offset_frames": frames},
            scene=partial(paper_flight, order=order, earlier_frames=frames, given_rate_hz=rate_hz, arcs=PAPER_ARCS),
            noise=noise_levels.HIGH,
        )
        for order in (1, 2)
        for frames in OFFSETS
    )
    return Experiment(
        name=name,
        title=title,
        paper=paper,
        about="Mean distance between found and true position over all viewpoints, for uniform motion (order 1) and "
        "uniform acceleration (order 2), against the true offset of camera 2."
        + (f" The solver is told {rate_hz:g} Hz for camera 2, which runs at 10 Hz." if rate_hz != 10 else ""),
        geometry=PAPER_ARCS.words(),
        cells=cells,
        approaches=(MULTI_TI, LI, ALGORITHM_1, MAP),
        drawings=(
            Curve(caption="Mean error, m", measure="error_m", x="offset_frames", panel="order"),
            Path3D(caption="One flight, order 1, offset 10 frames", cell=9),
            Path3D(caption="One flight, order 2, offset 10 frames", cell=19),
        ),
        remarks=(noise_levels.ABOUT, EARLIER, ABOUT_LI, *((ABOUT_RATE,) if rate_hz != 10 else ())),
    )


def accuracy() -> Experiment:
    """Fig. 8 and 9."""
    return _against_offset("accuracy", "Error against the offset", "Fig. 8 and 9", 10.0)


def frame_rate() -> Experiment:
    """Fig. 10 and 11."""
    return _against_offset("frame-rate", "Error against the offset, frame rate wrong", "Fig. 10 and 11", 9.0)


def speed() -> Experiment:
    """Table 1."""
    published = tuple(
        {"Li, plain": li, "Li": li, "Algorithm 1": ours} for li, ours in ((0.0543, 0.0128), (0.0771, 0.0186))
    )
    cells = tuple(
        Cell(
            values={"order": order}, scene=partial(paper_flight, order=order, arcs=PAPER_ARCS), noise=noise_levels.HIGH,
            published=published[order - 1],
        )
        for order in (1, 2)
    )  # fmt: skip
    return Experiment(
        name="speed",
        title="How long it takes",
        paper="Table 1",
        about="Mean seconds of one solve, from the packed sightings to the optimum, each approach through all flights "
        "with nothing else in between.",
        geometry=PAPER_ARCS.words(),
        cells=cells,
        approaches=(PLAIN_LI, PLAIN_LI_TO_THE_END, LI, LI_TO_THE_END, ALGORITHM_1, MAP),
        drawings=(
            Grid(caption="Seconds of the numerical solve", measure="solver_seconds"),
            Grid(caption="Times quicker than plain Li run to the end", measure="quicker_than_plain_to_the_end"),
            Grid(caption="Times quicker than plain Li of 8 rounds", measure="quicker_than_plain"),
            Grid(caption="Times quicker than Li run to the end", measure="quicker_than_li_to_the_end"),
            Grid(caption="Times quicker than Li of 8 rounds", measure="quicker_than_li"),
            Grid(caption="Seconds of the whole call, uncertainty and record included", measure="seconds"),
            Grid(caption="Iterations (rounds of Li)", measure="iterations"),
        ),
        timed=True,
        remarks=(
            "The paper timed an Intel i9-12900H; ours are the seconds of the machine that made this page, so the "
            "ratios between rows compare, not the seconds. Run it with --jobs 1 on an idle machine.",
            '"Li, plain" is the iteration as one writes it with NumPy and SciPy: a dense least squares for the motion, '
            'MINPACK for every offset. "Li" shares the compiled elimination and descent of our solver.',
            ABOUT_LI,
        ),
    )
