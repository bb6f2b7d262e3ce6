"""Backlash of a link with inertia: it coasts when the drive slows down, and rests on the side of its weight."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.step import sign
from sysid.block.writing import Writer, solved


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
    """One sample of free motion under a constant pull: the link may stop and fall in the other direction."""
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


@checked
@dataclass(frozen=True)
class CoastingPlay(Recursion):
    """y is from x - width / 2 to x + width / 2; between these limits v' = -(pull0 + pull1 y) - drag sign v.

    x is linear between samples, and a link that meets a side moves with it (no rebound). drag [y/sample^2] is the
    friction of the link's bearing over its inertia; pull0 [y/sample^2] and pull1 [1/sample^2] are its weight. With
    large drag and no pull this is `Play`. With small drag the link coasts ahead when the drive stops. With a dominant
    pull the link stays on one side, and the data do not determine the width. `rest` is the initial position within the
    backlash, from -1/2 to 1/2, at rest. Derivatives at a switch are those of the branch taken.
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
        """The equation of motion in v', not the exact solution used in the step."""
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
