"""Play of a link with inertia: it coasts where the drive slows down, and lies where its weight pulls."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.block import Slot
from sysid.model.compiler.recursion import Recursion
from sysid.model.step import sign
from sysid.model.writing import Writer, solved


def begin(s, x, p):
    s.place = x + p.rest * p.width
    s.before = x


def step(s, x, p):
    half = 0.5 * p.width
    low, high = x - half, x + half
    if s.begun == 1.0 and (s.place < low or s.place > high):  # a side takes it along
        s.place = low if s.place < low else high
        s.speed = x - s.before
    s.before, s.begun = x, 1.0  # the first output is where the link begins, wherever a search tries that
    y = s.place
    fly(s, p)
    return y


def fly(s, p):
    """One sample of free flight under a constant pull: it may come to rest and fall the other way."""
    pull, left = p.pull0 + p.pull1 * s.place, 1.0
    for _ in range(2):
        way = sign(s.speed)
        if way == 0.0 and abs(pull) > p.drag:
            way = -sign(pull)
        if way == 0.0:  # its bearing holds it
            s.speed = 0.0
            break
        rate = -pull - p.drag * way
        rests = s.speed != 0.0 and (s.speed + rate * left) * way < 0.0
        span = -s.speed / rate if rests else left
        s.place += (s.speed + 0.5 * rate * span) * span
        if not rests:
            s.speed += rate * span
            break
        s.speed = 0.0
        left -= span


@dataclass(frozen=True)
class CoastingPlay(Recursion):
    """y lies within x - width / 2 and x + width / 2; between the two it flies: v' = -(pull0 + pull1 y) - drag sign v.

    x moves evenly from sample to sample, and a link that meets a side goes on with it (no rebound). drag [y/sample^2]
    is the friction of the link's own bearing over its inertia, pull0 [y/sample^2] and pull1 [1/sample^2] its weight.
    With much drag and no pull this is `Play`. With little, a drive that stops finds the link ahead and not behind; with
    a pull that nothing overcomes the link lies on one side, and the width is not in the data. `rest` says where in the
    play it starts, at rest, from -1/2 to 1/2. Derivatives at a switch are those of the branch taken.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    def slots(self) -> tuple[Slot, ...]:
        return (
            Slot("width", lower=0.0),
            Slot("rest", lower=-0.5, upper=0.5, initial=True, holds=True),
            Slot("drag", "y/sample^2", lower=0.0),
            Slot("pull0", "y/sample^2"),
            Slot("pull1", "1/sample^2"),
        )

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The equation of motion in v', not of the exact solution that the step takes."""
        width, _, drag, pull, slope = theta.tolist()
        low, high = f"{w.x}(t) - {w.num(0.5 * width)}", f"{w.x}(t) + {w.num(0.5 * width)}"
        return [
            f"v' = -P - {w.num(drag)}*sign(v), {w.y}' = v, time in samples, while {low} <= {w.y}(t) <= {high}",
            f"  P = {w.sum([(pull, ''), (slope, w.y)])}",
            f"  v stays 0 where |P| <= {w.num(drag)}",
            f"  {w.y}(t) = {low} where it would be less, {high} where more; there v = {w.x}(t) - {w.x}(t-1)",
            solved("P" if slope else "", 1, "sample"),
        ]

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.zeros(self.n_parameters)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[0] >= 0.0 and theta[2] >= 0.0)
