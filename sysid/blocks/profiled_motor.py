"""Motor with position-dependent dry friction and load, without stops: voltage in, position out."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Slot, Symmetry
from sysid.block.compiler.recursion import Recursion
from sysid.block.lag import lagged
from sysid.block.step import exp, floor, sign
from sysid.block.writing import Writer, solved

SHORTEST = 1e-12  # samples; what is left of a sample below it is over


def begin(s, x, p):
    s.position, s.speed = p.x0, p.v0


def level(row, i, share, block):
    """A profile, `share` of the way through its segment i."""
    value = row[i]
    if block.knots > 1:
        value += share * (row[i + 1] - value)
    return value


def step(s, x, p, block):
    y = s.position
    for _ in range(block.substeps):
        h = 1.0 / block.substeps
        for _ in range(4):  # turns: one is usual, two can be
            if h <= SHORTEST:
                break
            place = (s.position - block.low) * ((block.knots - 1) / (block.high - block.low))
            i = int(min(max(floor(place), 0.0), max(block.knots - 2.0, 0.0)))
            share = min(max(place - i, 0.0), 1.0)
            way = sign(s.speed)
            if way == 0.0 and x > level(p.rise, i, share, block):
                way = 1.0
            elif way == 0.0 and x < -level(p.fall, i, share, block):
                way = -1.0
            if way == 0.0:  # friction holds it
                s.speed = 0.0
                break
            if way > 0.0:
                drag = p.drag_up
                target = (x - level(p.rise, i, share, block)) / drag
            else:
                drag = p.drag_down
                target = (x + level(p.fall, i, share, block)) / drag
            span, turns = lagged(s, target, p.inertia / drag, way, h, exp(-h * drag / p.inertia))
            h -= span
            if not turns:
                break
    return y


@dataclass(frozen=True)
class ProfiledMotor(Recursion):
    """inertia x'' = u - drag x' - friction: time in samples, x in the unit of the output, all forces in volts.

    rise(x) acts against upward and fall(x) against downward motion; both are piecewise linear on `knots` equal steps
    from `low` to `high`, and constant beyond. Half their difference is a position-dependent load (a pendulum, a
    spring), half their sum is dry friction. Viscous drag of gears and screws depends on the direction: drag_up and
    drag_down. At rest the motor stands until the input leaves the band from -fall(x) to rise(x). `Motor` describes
    load and friction by a few physical numbers and has end stops; use this block for records that repeat the same path
    often enough to determine the profile. Over each of `substeps` parts of a sample the profile is taken from its
    start and the lag inertia / drag is solved exactly; derivatives at a reversal or a knot are those of the branch
    taken.
    """

    functions: ClassVar = {"step": step, "begin": begin}

    knots: int = 7
    low: float = 0.0
    high: float = 1.0
    substeps: int = 1

    def __post_init__(self) -> None:
        if self.knots < 1 or self.substeps < 1:
            raise InputError(f"knots and substeps are {self.knots} and {self.substeps}; give at least 1 of each")
        if not self.low < self.high:
            raise InputError(f"the profile goes from {self.low} to {self.high}; give low below high")

    def slots(self) -> tuple[Slot, ...]:
        plain = [
            Slot("inertia", "V sample^2", lower=1e-12),
            *(Slot(name, "V sample", lower=1e-12) for name in ("drag_up", "drag_down")),
        ]
        profiles = [Slot(f"{side}{i}", "V") for side in ("rise", "fall") for i in range(self.knots)]
        return (*plain, *profiles, Slot("x0", initial=True, holds=True), Slot("v0", "1/sample", initial=True))

    def profiles(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """rise (knots,) and fall (knots,) [V] out of theta."""
        return theta[3 : 3 + self.knots], theta[3 + self.knots : 3 + 2 * self.knots]

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The equation of motion in v', not the exact solution used in the step."""
        m, (rise, fall) = (
            self.by_name(theta),
            self.profiles(theta),
        )
        up, down = w.num(m["drag_up"]), w.num(m["drag_down"])
        places = np.linspace(self.low, self.high, self.knots) if self.knots > 1 else np.array([self.low])
        return [
            f"{w.num(m['inertia'])}*v' = {w.x} - D*v - F, {w.y}' = v, time in samples",
            f"  D = {up}, F = rise({w.y}) where v > 0; D = {down}, F = -fall({w.y}) where v < 0",
            f"  v stays 0 where -fall({w.y}) <= {w.x} <= rise({w.y})",
            f"  rise and fall are straight between these values, constant beyond, at {w.y} = {w.list(places)}:",
            f"  rise = {w.list(rise)}",
            f"  fall = {w.list(fall)}",
            f"  {w.x} is held for one sample",
            solved("F" if self.knots > 1 else "", self.substeps),
        ]

    def start(self, x: np.ndarray) -> np.ndarray:
        """A motor that moves through the profile in a tenth of the record at the largest input."""
        largest = max(float(np.abs(x).max()), 1e-9)
        theta = np.zeros(self.n_parameters)
        theta[1:3] = largest * len(x) / (10.0 * (self.high - self.low))
        theta[0] = theta[1]
        theta[-2] = 0.5 * (self.low + self.high)
        return theta

    def admissible(self, theta: np.ndarray) -> bool:
        """False without inertia or drag, or if the band of standstill is empty (friction would drive the motor)."""
        rise, fall = self.profiles(theta)
        return bool(np.all(theta[:3] > 0.0) and np.all(rise + fall >= -1e-9))

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """Where friction would drive the motor, both profiles are changed equally."""
        rise, fall = self.profiles(theta)
        less = 0.5 * np.minimum(rise + fall, 0.0)
        if not less.any():
            return theta
        return np.concatenate([theta[:3], rise - less, fall - less, theta[-2:]])

    def kinks(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope of both profiles at each inner knot, in units of their mean friction over one segment."""
        n, knots = max(self.knots - 2, 0), self.knots
        D = np.zeros((2 * n, len(theta)))
        for side in range(2):
            for i in range(n):
                D[side * n + i, 3 + side * knots + i : 3 + side * knots + i + 3] = 1.0, -2.0, 1.0
        bend = D @ theta
        mean = np.zeros(len(theta))
        mean[3 : 3 + 2 * knots] = 0.5 / knots
        level = max(float(mean @ theta), 1e-12)
        return bend / level, D / level - np.outer(bend, mean) / level**2

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """Inertia, drag and friction scale with the input voltage. `low` fixes the positions."""
        volts = theta.copy()
        volts[-2:] = 0.0
        load = np.zeros(len(theta))
        load[3 : 3 + self.knots], load[3 + self.knots : 3 + 2 * self.knots] = 1.0, -1.0
        return [Symmetry(volts, in_scale=1.0), Symmetry(load, in_shift=1.0)]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Inertia, drag and friction changed by a factor of up to about two."""
        factors = np.repeat(np.exp([0.5, 0.3, 0.3] * rng.normal(size=3)), [1, 2, 2 * self.knots])
        return np.concatenate([theta[:-2] * factors, theta[-2:]])
