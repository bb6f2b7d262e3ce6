"""Motor with position-dependent dry friction and load, without stops: voltage in, position out."""

from dataclasses import dataclass, replace
from math import exp
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.step import advance_lag, ago, floor, sign
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer, solved

LONGEST = 20.0  # samples of delay
SHORTEST = 1e-12  # samples; what is left of a sample below it is over


def begin(s, x, p):
    s.position, s.speed = p.x0, p.v0


def step(s, x, p, block):
    y, whole = s.position, int(floor(p.delay))
    late = p.delay - whole
    for part in range(2):  # a sample sees the end of one input and the beginning of the next
        w = ago(x, whole + 1 - part)
        length = late if part == 0 else 1.0 - late
        if length > 0.0 or block.delayed:  # the derivative by a whole delay sees a part that has no length yet
            for _ in range(block.substeps):
                stretch(s, w, length / block.substeps, p, block)
    return y


def stretch(s, w, h, p, block):
    """A time h of constant input; the profiles are taken from its start, or midway in it also after a reversal."""
    at, fresh = s.position, True
    for _ in range(4):  # one pass is usual, a turn takes one more
        i, j, share, slope = segment(at, block)
        way = sign(s.speed)
        if way == 0.0 and w > level(p.rise, i, j, share):
            way = 1.0
        elif way == 0.0 and w < -level(p.fall, i, j, share):
            way = -1.0
        if way == 0.0:  # friction holds it
            s.speed = 0.0
            break
        drag = p.drag_up if way > 0.0 else p.drag_down
        decay = exp(-h * drag / p.inertia)
        if fresh and block.midway:
            held = p.inertia / drag * (1.0 - decay)
            if way > 0.0:
                force, rises = level(p.rise, i, j, share), slope * (p.rise[j] - p.rise[i])
            else:
                force, rises = -level(p.fall, i, j, share), slope * (p.fall[i] - p.fall[j])
            half = 0.5 * ((w - force) / drag * (h - held) + s.speed * held)
            # Where the load rises, that of the implicit midpoint rule, which no stiff load makes unstable.
            at += half / (1.0 + 0.5 * max(rises, 0.0) / drag * (h - held))
            i, j, share, slope = segment(at, block)
        force = level(p.rise, i, j, share) if way > 0.0 else -level(p.fall, i, j, share)
        span, turns = advance_lag(s, (w - force) / drag, p.inertia / drag, way, h, decay)
        if not turns:
            break
        fresh = False
        if not block.midway:
            at = s.position
        h -= span
        if h <= SHORTEST:
            break


def segment(x, block):
    """The knots before and behind x, the share of the way between them, and steps a unit (0 where it is constant)."""
    place = (x - block.low) * block.density
    slope = block.density
    if block.periodic:
        place -= block.knots * floor(place / block.knots)
        i = int(min(floor(place), block.knots - 1.0))
        j = int(i + 1.0 if i + 1.0 < block.knots else 0.0)
    else:
        if place < 0.0 or place > block.knots - 1.0:
            slope = 0.0
        i = int(min(max(floor(place), 0.0), max(block.knots - 2.0, 0.0)))
        j = int(min(i + 1.0, block.knots - 1.0))
    share = min(max(place - i, 0.0), 1.0)
    return i, j, share, slope


def level(row, i, j, share):
    """A profile, `share` of the way from knot i to knot j."""
    return row[i] + share * (row[j] - row[i])


@checked
@dataclass(frozen=True)
class ProfiledMotor(Recursion):
    """inertia x'' = u - drag x' - friction: time in samples, x in the unit of the output, all forces in volts.

    rise(x) acts against upward and fall(x) against downward motion; both are piecewise linear on `knots` equal steps
    from `low` to `high`, and constant beyond; None is the end of the range of the record that the chain is fitted to.
    With a `period` (2 pi or 360) and one turn from `low` to `high`, `knots` are the equal parts of the turn, and the
    profile repeats. Half their difference is a position-dependent load (a pendulum, a spring), half their sum is dry
    friction. Viscous drag of gears and screws depends on the direction: drag_up and drag_down. At rest the motor stands
    until the input leaves the band from -fall(x) to rise(x). `Motor` describes load and friction by a few physical
    numbers and has end stops; use this block for records that repeat the same path often enough to determine the
    profile. The input is held for one sample and, with `delayed`, acts `delay` samples late. Over each of `substeps`
    parts of a sample the lag inertia / drag is solved exactly, with the profile of its start or, with `midway`, of the
    middle of its way, which is of second order and stable; derivatives at a reversal or a knot are those of the branch
    taken.
    """

    compiles_long: ClassVar = True
    functions: ClassVar = {"step": step, "begin": begin}
    absent: ClassVar = {"delay": 0.0}

    knots: int = 7
    low: float | None = 0.0
    high: float | None = 1.0
    substeps: int = 1
    delayed: bool = False
    period: float = 0.0
    midway: bool = False

    def __post_init__(self) -> None:
        if self.knots < 1 or self.substeps < 1:
            raise InputError(f"knots and substeps are {self.knots} and {self.substeps}; give at least 1 of each")
        if not 0.0 <= self.period < np.inf:
            raise InputError(f"the period is {self.period}; give the length of a turn, or 0 for none")
        if self.low is None or self.high is None:
            return
        if not self.low < self.high:
            raise InputError(f"the profile goes from {self.low} to {self.high}; give low below high")
        if self.period and self.high - self.low > self.period * (1.0 + 1e-9):
            raise InputError(
                f"the profile goes from {self.low} to {self.high} and a turn is {self.period}; give one turn at most"
            )
        if self.periodic and self.knots < 3:
            raise InputError(f"a periodic profile has {self.knots} knot(s); give at least 3")

    def scaled(self, u: np.ndarray | None, y: np.ndarray | None) -> "ProfiledMotor":
        """With the range of y where low or high is None: one turn if it covers a turn."""
        if y is None or not (self.low is None or self.high is None):
            return self
        low = float(np.nanmin(y)) if self.low is None else self.low
        high = float(np.nanmax(y)) if self.high is None else self.high
        if self.period and high - low >= self.period:
            high = low + self.period
        return replace(self, low=low, high=high if high > low else low + 1.0)

    @property
    def ends(self) -> tuple[float, float]:
        """low and high."""
        if self.low is None or self.high is None:
            raise InputError("the profile has no range yet; fit it to a record, or give low and high")
        return self.low, self.high

    @property
    def periodic(self) -> bool:
        """Whether the profile repeats after a turn."""
        low, high = self.ends
        return 0.0 < self.period <= (high - low) * (1.0 + 1e-9)

    @property
    def density(self) -> float:
        """Steps between knots a unit of position."""
        low, high = self.ends
        return (self.knots if self.periodic else self.knots - 1) / (high - low)

    @property
    def places(self) -> np.ndarray:
        """Positions of the knots (knots,)."""
        return self.ends[0] + np.arange(self.knots) / (self.density or 1.0)

    def slots(self) -> tuple[Slot, ...]:
        plain = [
            Slot("inertia", "V sample^2", lower=1e-12),
            *(Slot(name, "V sample", lower=1e-12) for name in ("drag_up", "drag_down")),
        ]
        profiles = [Slot(f"{side}{i}", "V") for side in ("rise", "fall") for i in range(self.knots)]
        late = [Slot("delay", "samples", lower=0.0, upper=LONGEST)] if self.delayed else []
        return (*plain, *profiles, *late, Slot("x0", initial=True, holds=True), Slot("v0", "1/sample", initial=True))

    def profiles(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """rise (knots,) and fall (knots,) [V] out of theta."""
        return theta[3 : 3 + self.knots], theta[3 + self.knots : 3 + 2 * self.knots]

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The equation of motion in v', not the exact solution used in the step."""
        m, (rise, fall) = self.by_name(theta), self.profiles(theta)
        up, down = w.num(m["drag_up"]), w.num(m["drag_down"])
        beyond = f"repeat every {w.num(self.period)}" if self.periodic else "are constant beyond"
        late = f" and acts {w.num(m['delay'])} samples late" if m.get("delay") else ""
        frozen = f"F is that {'in the middle of the way over' if self.midway else 'at the start of'} each held input"
        if self.substeps > 1:
            frozen = frozen.replace("each held", f"each of {self.substeps} equal parts of a held")
        return [
            f"{w.num(m['inertia'])}*v' = {w.x} - D*v - F, {w.y}' = v, time in samples",
            f"  D = {up}, F = rise({w.y}) where v > 0; D = {down}, F = -fall({w.y}) where v < 0",
            f"  v stays 0 where -fall({w.y}) <= {w.x} <= rise({w.y})",
            f"  rise and fall are straight between these values and {beyond}, at {w.y} = {w.list(self.places)}:",
            f"  rise = {w.list(rise)}",
            f"  fall = {w.list(fall)}",
            f"  {w.x} is held for one sample{late}",
            solved("", self.substeps) + (f", {frozen}" if self.knots > 1 else ""),
        ]

    def start(self, x: np.ndarray) -> np.ndarray:
        """A motor that moves through the profile in a tenth of the record at the largest input."""
        largest, (low, high) = max(float(np.abs(x).max()), 1e-9), self.ends
        theta = np.zeros(self.n_parameters)
        theta[1:3] = largest * len(x) / (10.0 * (high - low))
        theta[0] = theta[1]
        theta[-2] = 0.5 * (low + high)
        return theta

    def outside(self, y: np.ndarray) -> float:
        """Share of the positions y (N,) outside the profile, where friction and load are those of its end."""
        if self.periodic or self.knots == 1:
            return 0.0
        low, high = self.ends
        return float(np.mean((y < low) | (y > high)))

    def remarks(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[str]:
        """How much of a run is outside the profile."""
        share, (low, high) = self.outside(y), self.ends
        if not share:
            return []
        way = f"{low:.4g} to {high:.4g}"
        return [
            f"the {self.role} is outside its profile of {way} in {100 * share:.1f} % of the run, which goes from "
            f"{float(y.min()):.4g} to {float(y.max()):.4g}: friction and load are those of the "
            "profile's ends there; for a joint that turns on and on give the period of a turn"
        ]

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
        return np.concatenate([theta[:3], rise - less, fall - less, theta[3 + 2 * self.knots :]])

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope of both profiles at each inner knot, in units of their mean friction over one segment."""
        D, knots = np.vstack([*self.bends(len(theta))]), self.knots
        bend = D @ theta
        mean = np.zeros(len(theta))
        mean[3 : 3 + 2 * knots] = 0.5 / knots
        level = max(float(mean @ theta), 1e-12)
        return bend / level, D / level - np.outer(bend, mean) / level**2

    def bends(self, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Second differences of rise and of fall, rows over theta: of the inner knots, of a period of all knots."""
        k = self.knots
        inner = range(k) if self.periodic else range(1, k - 1)
        bends = []
        for first in (3, 3 + k):
            D = np.zeros((len(inner), width))
            for row, i in enumerate(inner):
                for at, weight in ((i - 1, 1.0), (i, -2.0), (i + 1, 1.0)):
                    D[row, first + at % k] += weight
            bends.append(D)
        return bends[0], bends[1]

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """Inertia, drag and friction scale with the input voltage. `low` fixes the positions."""
        volts = theta.copy()
        volts[3 + 2 * self.knots :] = 0.0
        load = np.zeros(len(theta))
        load[3 : 3 + self.knots], load[3 + self.knots : 3 + 2 * self.knots] = 1.0, -1.0
        return [Symmetry(volts, in_scale=1.0), Symmetry(load, in_shift=1.0)]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Inertia, drag and friction changed by a factor of up to about two."""
        factors = np.repeat(np.exp([0.5, 0.3, 0.3] * rng.normal(size=3)), [1, 2, 2 * self.knots])
        return np.concatenate([theta[: len(factors)] * factors, theta[len(factors) :]])
