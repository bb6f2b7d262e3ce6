"""Output of a block for exports: code of an exported function, and names and numbers of an equation."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Code:
    """Body of an exported function of `x`; it may read tables by name and store `state` numbers in `s`.

    `start` holds the names and initial values of the first of these numbers; all others start at zero.
    """

    body: str
    state: int = 0
    tables: dict[str, np.ndarray] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    channels: tuple[int, int] = (1, 1)  # of several, `x` is an array, and so is what comes out


@dataclass(frozen=True)
class CCode:
    """Body of a C99 function of `x`, of a struct `s` of states and a struct `p` of parameters.

    Both structs have fields of doubles: `states` by length (0: one number), `fields` by the position in theta (a tuple:
    an array). `begin` sets the states that do not start at zero. `feeds` says whether the output hangs on the input of
    the same sample, `limits` the largest value that memory has room for, by the position of the parameter.
    """

    body: str
    states: Mapping[str, int] = field(default_factory=dict)
    fields: Mapping[str, int | tuple[int, ...]] = field(default_factory=dict)
    begin: str = ""
    tables: Mapping[str, np.ndarray] = field(default_factory=dict)
    channels: tuple[int, int] = (1, 1)  # of several, `x` and `y` are arrays
    feeds: bool = True
    limits: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Writer:
    """Names of a unit's input x and output y, and the number of digits (None: exact)."""

    x: str
    y: str
    digits: int | None

    def num(self, value: float) -> str:
        """A number, in brackets where it is negative."""
        plain = number(value) if self.digits is None else f"{float(value):.{self.digits}g}"
        return f"({plain})" if plain.startswith("-") else plain

    def sum(self, terms: list[tuple[float, str]]) -> str:
        """c1*a + c2*b - ... without terms of weight zero; an empty name means only the number."""
        parts: list[str] = []
        for c, name in terms:
            if c == 0.0:
                continue
            sign = ("-" if c < 0 else "") if not parts else (" - " if c < 0 else " + ")
            size = self.num(abs(c))
            factor = size if not name else (name if size in ("1", "1.0") else f"{size}*{name}")
            parts.append(sign + factor)
        return "".join(parts) or "0"

    def minus(self, value: float) -> str:
        """(x - value) as a factor."""
        return self.x if value == 0.0 else f"({self.sum([(1.0, self.x), (-value, '')])})"

    def pieces(self, edges: np.ndarray, curves: list[str]) -> list[str]:
        """One formula for each piece between the edges; the first and the last are unbounded."""
        lines = []
        for i, curve in enumerate(curves):
            above = f"{self.num(edges[i - 1])} < " if i > 0 else ""
            below = f" <= {self.num(edges[i])}" if i < len(edges) else ""
            where = f"   where {above}{self.x}{below}" if above or below else ""
            lines.append(f"{self.y} = {curve}{where}")
        return lines

    def straight(self, x: np.ndarray, y: np.ndarray) -> list[str]:
        """Straight lines through the points (x, y); the outer lines are unbounded."""
        slopes = np.diff(y) / np.diff(x)
        curves = [self.sum([(y[i], ""), (slopes[i], self.minus(x[i]))]) for i in range(len(slopes))]
        return self.pieces(x[1:-1], curves)

    def list(self, values: np.ndarray) -> str:
        """Numbers in a row."""
        return ", ".join(self.num(v) for v in values)


def solved(frozen: str, substeps: int, held: str = "held input") -> str:
    """A line on the solution of the motion between switches and the values held constant in it."""
    text = "  between these switches the motion is solved exactly"
    stretch = f"each {held}" if substeps == 1 else f"each of {substeps} equal parts of a {held}"
    return f"{text}, {frozen} from the start of {stretch}" if frozen else text


def number(value: float) -> str:
    """The shortest text that C and Python read back as exactly this float."""
    return repr(float(value))
