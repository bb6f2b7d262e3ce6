"""Motor in the position loop of its own servo: goal in, position out."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.block.block import Slot
from sysid.block.step import ago, floor
from sysid.block.symmetry import Symmetry
from sysid.block.writing import CCode, Code, Writer
from sysid.blocks.motor import Motor, stretch
from sysid.motor_parts import TABLE

LOOPS = ("p", "pd", "pid")
MOST_SAG = 3.0  # resistance of supply and driver over that of the motor
_STABLE = 1.0 - 1e-9  # largest modulus of a pole of the sampled loop
_FIRST_GAIN = 3.0  # of the largest drive, over the range of the goal


def begin(s, x, p):
    s.position, s.speed, s.integral = p.x0, p.v0, p.i0


def step(s, x, p, block):
    y, whole = s.position, int(floor(p.delay))
    late = p.delay - whole
    for part in range(2):  # a sample sees the end of one goal and the beginning of the next
        goal = ago(x, whole + 1 - part)
        length = late if part == 0 else 1.0 - late
        if length > 0.0 or block.delayed:  # the derivative by a whole delay sees a part that has no length yet
            for _ in range(block.updates):
                drive(s, goal, length / block.updates, p, block)
    return y


def drive(s, goal, h, p, block):
    """A time h of constant drive, from the error at its middle; of a loop that holds, at its start."""
    error = goal - s.position
    if not block.held:
        error -= 0.5 * h * s.speed
    error -= min(max(error, -p.dead), p.dead)
    asked = p.kp * error - p.kd * s.speed + s.integral
    w = min(max(asked, -p.limit), p.limit)
    if block.integrates and w == asked:  # a loop at its limit does not integrate
        s.integral += p.ki * error * h
    if block.sags:
        share = w / p.limit
        w = (w + p.sag * share * share * s.speed / p.gain) / (1.0 + p.sag * share * share)
    for _ in range(block.shares):
        stretch(s, w, h / block.shares, p, block)


@checked
@dataclass(frozen=True)
class ServoMotor(Motor):
    """`Motor` driven by w = clip(kp e - kd v + i, -limit, limit) with the error e = goal - x, i' = ki e.

    The loop reads the motor's own position x and speed v: the derivative acts on the measurement, as in most bus
    servos, and a step of the goal makes no spike. e is zero within `dead` of the goal and counts from there. At the
    limit the integral stands still. `loop` is "p", "pd" or "pid". The goal arrives `delay` samples late.

    The unit of the drive is free: with limit = 1 gain is the speed at full duty, kp is duty per unit of x, and the
    frictions are shares of full duty; with limit in volts they are speed per volt, volts per unit, volts. A record
    that never reaches the limit determines gain kp, rise / kp and fall / kp only, and one that never does so with
    "pd" lag / (1 + gain kd) and kp / (1 + gain kd) only, unless gains are fixed.

    With `sags` the source has a resistance, `sag` times the motor's: a bridge that is on for a share d of the time
    draws d times the motor's current, so w becomes (w + sag d^2 v / gain) / (1 + sag d^2) with d = w / limit.

    `updates` parts of a sample follow the loop. Without `held` they approximate a fast loop, its proportional part to
    second order; with `held` they are the loop itself, whose drive is constant over each part. `scheduled` takes a
    second input channel, constant over a record: the factor of kp, kd and ki in this record, such as a gain register
    of known value.
    Everything else is that of `Motor`; `substeps` above `updates` divide these further.
    """

    functions: ClassVar = {"step": step, "begin": begin}
    absent: ClassVar = {**Motor.absent, **dict.fromkeys(("kd", "ki", "dead", "i0", "sag"), 0.0)}

    loop: str = "p"
    dead: bool = False
    sags: bool = False
    updates: int = 4
    held: bool = False
    scheduled: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.loop not in LOOPS:
            raise unknown("loop of a servo", self.loop, LOOPS)
        if self.updates < 1:
            raise InputError(f"updates is {self.updates}; give at least 1 update of the loop per sample")

    @property
    def integrates(self) -> bool:
        """Whether the loop has an integral."""
        return self.loop == "pid"

    @property
    def channels(self) -> tuple[int, int]:
        return (2 if self.scheduled else 1), 1

    @property
    def shares(self) -> int:
        """Parts of one update: as many as make at least `substeps` parts of a sample."""
        return -(-self.substeps // self.updates)

    def slots(self) -> tuple[Slot, ...]:
        slots = [Slot("kp", "V", lower=0.0)]
        if self.loop != "p":
            slots.append(Slot("kd", "V samples", lower=0.0))
        if self.integrates:
            slots += [Slot("ki", "V/sample", lower=0.0), Slot("i0", "V", initial=True)]
        if self.dead:
            slots.append(Slot("dead", lower=0.0))
        slots.append(Slot("limit", "V", lower=1e-9))
        if self.sags:
            slots.append(Slot("sag", lower=0.0, upper=MOST_SAG))
        return (*slots, *super().slots())

    def propagate_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        if not self.scheduled:
            return super().propagate_all(theta, xs, Js, q)
        goal, factors = xs
        if len(factors) and np.ptp(factors) > 0.0:
            raise InputError(
                "the second input of a scheduled servo varies within a record; split the record where its gain changes"
            )
        if q:
            raise InputError("a scheduled servo is the first block of its chain; leave out what is before it")
        factor = float(factors[0]) if len(factors) else 1.0
        scale = self._scale(factor)
        y = self.propagate(theta * scale, goal, Js[0], 0)
        if Js[0].shape[1]:
            Js[0][:, : len(theta)] *= scale
        return [y], Js[:1]

    def _scale(self, factor: float) -> np.ndarray:
        return np.array([factor if slot.name in ("kp", "kd", "ki") else 1.0 for slot in self.slots()])

    def start(self, x: np.ndarray) -> np.ndarray:
        """A motor that crosses the goal's range in a tenth of the record at the limit, with friction left out."""
        span = max(float(np.ptp(x)), 1e-9)
        first = {"kp": _FIRST_GAIN / span, "limit": 1.0, "gain": 10.0 * span / len(x), "lag": 0.5, "stick_speed": 0.01}
        first |= {"lower": float(x.min()) - span, "upper": float(x.max()) + span, "x0": float(x[0])}
        return np.array([first.get(slot.name, 0.0) for slot in self.slots()])

    def admissible(self, theta: np.ndarray) -> bool:
        """False where `Motor` is not, or if the sampled loop without friction and limit is unstable."""
        return super().admissible(theta) and self._slowest(theta) <= _STABLE

    def _slowest(self, theta: np.ndarray) -> float:
        """Largest modulus of the loop's poles over one of `updates` parts, motion solved exactly over it."""
        m, h = {**self.absent, **self.by_name(theta)}, 1.0 / self.updates
        ahead = 0.0 if self.held else 0.5 * h
        decay = np.exp(-h / m["lag"])
        slip = m["lag"] * (1.0 - decay)
        plant = np.array([[1.0, slip, 0.0], [0.0, decay, 0.0], [0.0, 0.0, 1.0]])
        push = m["gain"] * np.array([h - slip, 1.0 - decay, 0.0])
        error = np.array([-1.0, -ahead, 0.0])
        loop = plant + np.outer(push, m["kp"] * error - [0.0, m["kd"], -1.0])
        loop[2] += m["ki"] * h * error
        order = 3 if self.integrates and m["ki"] > 0.0 else 2
        if m["kp"] * m["gain"] == 0.0:
            return 0.0
        return float(np.abs(np.linalg.eigvals(loop[:order, :order])).max())

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        names = [slot.name for slot in self.slots()]

        def along(moves: dict[str, float]) -> np.ndarray:
            return np.array([moves.get(name, 0.0) * value for name, value in zip(names, theta, strict=True)])

        volts = {slot.name: 1.0 for slot in self.slots() if slot.unit.startswith("V")}
        volts |= {name: power for part in self.further for name, power in TABLE[part].volts.items()}
        changes = [Symmetry(along({"gain": -1.0} | volts))]
        if self.load and not self.loss:  # a constant load is a difference between the frictions
            moves = {"rise": 1.0, "fall": -1.0, "load0": -1.0}
            changes.append(Symmetry(np.array([moves.get(name, 0.0) for name in names])))
        if not self.bent and not self.scheduled:  # a load over position would have to be scaled about `at`
            places = dict.fromkeys(("gain", "stick_speed", "lower", "upper", "x0", "v0", "dead"), 1.0) | {"jam": -1.0}
            places |= dict.fromkeys(("kp", "kd", "ki"), -1.0)
            places |= {name: power for part in self.further for name, power in TABLE[part].places.items()}
            changes.append(Symmetry(along(places), in_scale=1.0, out_scale=1.0))
            shift = np.array([float(name in ("lower", "upper", "x0")) for name in names])
            changes.append(Symmetry(shift, in_shift=1.0, out_shift=1.0))
        return changes

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """`Motor.vary`, and the loop's gains changed by a factor of up to about two."""
        spread = np.array([0.5 * (slot.name in ("kp", "kd", "ki")) for slot in self.slots()])
        return super().vary(theta, rng) * np.exp(spread * rng.normal(size=len(theta)))

    def c(self, theta: np.ndarray) -> CCode:
        self._check_export()
        return super().c(theta)

    def python(self, theta: np.ndarray) -> Code:
        self._check_export()
        return super().python(theta)

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The loop, and the equation of motion in v', not the exact solution used in the step."""
        self._check_export()
        m = self.by_name(theta)
        terms = [(m["kp"], "e"), (-m.get("kd", 0.0), "v"), (float(self.integrates), "i")]
        limit = w.num(m["limit"])
        late = f", {w.x} {w.num(m['delay'])} samples late" if m.get("delay") else ""
        lines = [f"W = min(max({w.sum(terms)}, -{limit}), {limit}), e = {w.x} - {w.y}{late}, held for one sample"]
        if self.dead:
            lines.append(f"  e is 0 within {w.num(m['dead'])} of 0 and counts from there")
        if self.integrates:
            lines.append(f"  i' = {w.num(m['ki'])}*e, 0 where W is at its limit; i = {w.num(m['i0'])} at first")
        if self.sags:
            share = f"{w.num(m['sag'])}*(W/{limit})^2"
            lines.append(f"  W acts as (W + {share}*v/{w.num(m['gain'])})/(1 + {share})")
        place = "start" if self.held else "middle"
        lines.append(f"  W from the {place} of each of {self.updates} equal parts of a sample")
        motion = super().equations(theta, replace(w, x="W"))
        return [*lines, *(line for line in motion if "is held for" not in line)]

    def _check_export(self) -> None:
        if self.scheduled:
            raise InputError(
                "a scheduled servo has its gain as an input; export the chain with scheduled=False and the gains fixed"
            )
