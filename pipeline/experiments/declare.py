"""What an experiment is: data, from which one runner, one measure and one page make everything else.

An experiment is a list of cells (one scene under one noise) and a list of approaches (one way to solve). Every cell is
flown `runs` times with fresh noise; every approach solves the same flights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from pipeline.records import SolverSettings
from pipeline.synthetic.scene import Scene
from pipeline.synthetic.simulate import Noise

Value = float | int | str
Told = Callable[[Noise], Noise]


@dataclass(frozen=True, kw_only=True)
class Approach:
    """One way to solve a flight.

    name      as the paper or this project calls it
    settings  of the solver; for "li" `max_iterations` is the most rounds
    ours      whether it is this project's, not the paper's
    told      what the solver is told of the instruments, from the noise there truly is; None: the truth
    plain     Li alone: by NumPy and SciPy (`li_plain`), not by this project's solver
    """

    name: str
    settings: SolverSettings
    ours: bool = False
    told: Told | None = None
    plain: bool = False


@dataclass(frozen=True, kw_only=True)
class Spell:
    """Frames `first` to `last` (exclusive) of camera number `camera` do not see target number `target`."""

    camera: int
    target: int
    first: int
    last: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Cell:
    """One scene under one noise.

    values     the factors that set it apart, as the tables name them
    scene      builds it
    noise      drawn anew for every run
    hidden     what is not seen
    published  the paper's figure per approach, where it prints one
    leave_out  approaches that make no sense here
    """

    values: Mapping[str, Value]
    scene: Callable[[], Scene]
    noise: Noise
    hidden: tuple[Spell, ...] = ()
    published: Mapping[str, float] = field(default_factory=dict)
    leave_out: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A figure: `measure` of every approach over factor `x`, one panel for each value of `panel`.

    spread  what the bars show: "error" of the mean, or "deviation" of the single run
    """

    caption: str
    measure: str
    x: str
    panel: str = ""
    spread: Literal["error", "deviation"] = "error"
    log_y: bool = False


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table: approaches down, cells across, `measure` inside, the published figure beside it."""

    caption: str
    measure: str


@dataclass(frozen=True, kw_only=True)
class Axes:
    """A table for one cell in the form of the paper's Tables 3 and 4: errors by axis and in space."""

    caption: str
    cell: int


@dataclass(frozen=True, kw_only=True)
class Path3D:
    """One run of one cell: true and found trajectories from above and from the side (paper Fig. 9 and 11)."""

    caption: str
    cell: int


Drawing = Curve | Grid | Axes | Path3D


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One of the paper's experiments, or one of ours.

    name      on the command line
    paper     where the paper has it
    about     what is done, for a reader of the page
    geometry  the scene in words: the paper does not publish its own
    target    number of the target whose errors are measured
    reference name of the approach that the others are compared with
    timed     whether seconds are among the results (then the bytes of two runs differ)
    refused   whether refusals are: the geometry cannot determine an answer everywhere
    remarks   what a reader must know to judge the figures, one sentence each
    """

    name: str
    title: str
    paper: str
    about: str
    geometry: str
    cells: tuple[Cell, ...]
    approaches: tuple[Approach, ...]
    drawings: tuple[Drawing, ...]
    target: int = 0
    reference: str = "map"
    timed: bool = False
    refused: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def whole_calls(self) -> bool:
        """Whether every answer is the whole call of a user, not the numerical solve alone (`answers`)."""
        return self.timed or self.refused

    def approach(self, name: str) -> int:
        """Place of an approach."""
        return next(i for i, a in enumerate(self.approaches) if a.name == name)
