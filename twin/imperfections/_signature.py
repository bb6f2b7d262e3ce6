"""The signature of an imperfection, and what its experiment needs of the twin."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True)
class Axis:
    """The label of an axis and the unit of its data."""

    name: str
    unit: str


@dataclass(frozen=True)
class Line:
    """x and y (n,) in the units of the axes; `on`: with the imperfection; `dots`: points without a line."""

    x: np.ndarray
    y: np.ndarray
    on: bool = True
    dots: bool = False
    steps: bool = False


@dataclass(frozen=True)
class Mark:
    """A dimension arrow from `start` to `end` (x, y) in data units; `text` shows the parameter's `value` [unit].

    `place` is the position of the text relative to the arrow: right, left, above, below, upper right (corner), upper
    left (top left), or right of it beyond the data (outside).
    """

    start: tuple[float, float]
    end: tuple[float, float]
    value: float
    unit: str
    text: str = "{}"
    place: str = "right"


@dataclass(frozen=True)
class Size:
    """A size measured in the picture's data, with and without the imperfection [unit], and its true value.

    nan if the data show none. `rows` names the parameters that give `true`.
    """

    name: str
    shown: Sequence[float]
    true: float
    unit: str
    rows: tuple[str, ...]

    @property
    def measured(self) -> float:
        """The size with the imperfection."""
        return self.shown[0]

    @property
    def off(self) -> float:
        """The size with the imperfection switched off."""
        return self.shown[1]

    def as_dict(self) -> dict[str, Any]:
        """The same as plain numbers."""
        values = {"measured": self.measured, "off": self.off, "true": self.true}
        return {"name": self.name, **values, "unit": self.unit, "parameters": list(self.rows)}


@dataclass(frozen=True)
class Signature:
    """An experiment that shows one imperfection: lines with and without it, marks, sizes and a caption.

    `name` is the switch of `twin.IMPERFECTIONS`; `key` distinguishes several signatures of one switch.
    """

    name: str
    title: str
    joint: str
    x: Axis
    y: Axis
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...]
    sizes: tuple[Size, ...]
    sentence: str
    variant: str = ""

    @property
    def key(self) -> str:
        """Its name in the table of signatures."""
        return self.variant or self.name

    def as_dict(self) -> dict[str, Any]:
        """The measured sizes, ready for JSON; without the lines."""
        header = {"name": self.name, "title": self.title, "joint": self.joint, "sentence": self.sentence}
        return {"key": self.key, **header, "sizes": [size.as_dict() for size in self.sizes]}


@dataclass(frozen=True)
class Trial:
    """An experiment's record, all (N,): times t [s], command u [V], angles [rad], motor voltage [V].

    The angles are the angle between the links, the reading and the logged angle. A sample is taken before its command
    reaches the board: volts[k + 1] belongs to u[k].
    """

    t: np.ndarray
    u: np.ndarray
    angle: np.ndarray
    reading: np.ndarray
    volts: np.ndarray
    logged: np.ndarray


class Lab(Protocol):
    """The bench of the experiments, as far as an imperfection knows it: `twin.signatures.lab`, where each is described.

    `p` are the twin's parameters, which an imperfection does not know by type.
    """

    def pair(
        self, name: str, other_names: Sequence[str], p: Any, joint: str, u: np.ndarray, Ts: float, **settings
    ) -> tuple[Trial, Trial]:
        """The same trial with and without the imperfection `name`."""
        ...

    def free(self, p: Any, joint: str) -> Any:
        """The parameters of a joint that only back-EMF brakes."""
        ...

    def lag(self, p: Any, joint: str) -> float:
        """Time constant [s] of the free joint's speed."""
        ...

    def tick(self, p: Any) -> float:
        """The board's reading interval [s]."""
        ...


Show = Callable[[Any, Lab], Signature]  # of the parameters


def holds(levels: np.ndarray, n: int) -> np.ndarray:
    """Each level for n samples."""
    return np.repeat(np.asarray(levels, dtype=float), n)


def steady_speeds(trial: Trial, n: int, last: int) -> np.ndarray:
    """Speed [rad/s] over the last `last` intervals of each hold of n samples."""
    angle = np.append(trial.angle, 2 * trial.angle[-1] - trial.angle[-2])
    ends = np.arange(n, len(trial.angle) + 1, n)
    return (angle[ends] - angle[ends - last]) / (last * (trial.t[1] - trial.t[0]))


def line_fit(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and value at 0 of the straight line through points (n,); nan if they determine none."""
    if len(x) < 2 or np.ptp(x) == 0.0:
        return np.nan, np.nan
    x_mean, y_mean = float(np.mean(x)), float(np.mean(y))
    slope = float(np.sum((x - x_mean) * (y - y_mean)) / np.sum((x - x_mean) ** 2))
    return slope, y_mean - slope * x_mean
