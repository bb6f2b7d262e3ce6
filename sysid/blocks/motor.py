"""Motor with friction: voltage in, position out, with stiction and end stops."""

from dataclasses import dataclass
from functools import cached_property
from math import exp
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError, unknown
from sysid.block.block import Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.step import advance_lag, ago, floor, sign, time_to_reach
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer, solved
from sysid.blocks._motor_load import lever_at, load_at, lost_of, rise_at
from sysid.blocks.linkage import SHAPE, SHAPE_SLOTS
from sysid.motor_parts import ABSENT, TABLE, MotorPart, drag_of_parts, drive_of_parts

_FASTEST = 1e-3  # samples; a lag below it cannot be told from none
LONGEST = 20.0  # samples of delay
SHORTEST = 1e-12  # samples; what is left of a sample below it is over
MOST_WAVES = 2  # harmonics of a periodic load
STOPS: dict[str, bool | str] = {"both": True, "lower": "lower", "upper": "upper", "none": False}
LOADS = tuple(f"load{i}" for i in range(4))  # coefficients of the load over the position
_VOLTS = ("rise", "fall", "stick", "stick_down", "bearing", *LOADS)
MOST_LOSS = 3.0  # of the load: a screw that raises with an efficiency of a quarter


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
    """A time h of constant input; the Stribeck curve is taken from its start, the load from the middle of the way.

    The load stays through a reversal: taken anew there, it would give a spring energy at each.
    """
    load, hold, rise, bend, fresh = 0.0, 0.0, 0.0, 0.0, True
    w = drive_of_parts(s, w, h, p, block)
    for _ in range(6):  # one pass is usual; a turn, a strike or a jam takes one more
        if block.jams and s.jammed > 0.0:
            kept = min(s.jammed, h)
            s.jammed -= kept
            h -= kept
            if s.jammed > 0.0:
                break
        if block.loaded and fresh:
            if block.lever:
                load, hold, rise, bend = lever_at(s.position, p, block)
            else:
                load = load_at(s.position, p, block)
        way = sign(s.speed)
        stick_down = p.stick_down if block.sided else p.stick
        if way == 0.0 and w - load > p.rise + p.stick + lost_of(load, hold, 1.0, p) and s.position < p.upper:
            way = 1.0
        elif way == 0.0 and w - load < -(p.fall + stick_down + lost_of(load, hold, -1.0, p)) and s.position > p.lower:
            way = -1.0
        if way == 0.0:  # friction or a stop holds it
            s.speed = 0.0
            break
        drag = p.rise if way > 0.0 else p.fall
        if block.stribeck:
            ratio = s.speed / p.stick_speed
            drag += (p.stick if way > 0.0 else stick_down) * exp(-ratio * ratio)
        drag += drag_of_parts(s, p, block)
        decay = exp(-h / p.lag)
        if block.bent and fresh:
            if not block.lever:
                rise = rise_at(s.position, p, block)
            target = p.gain * (w - load - way * (drag + lost_of(load, hold, way, p)))
            held = p.lag * (1.0 - decay)
            # The middle of the way that is left, as far as the stops leave it. Where the load rises the way is that of
            # the implicit midpoint rule, which no stiff load makes unstable.
            half = 0.5 * (target * (h - held) + s.speed * held) / (1.0 + 0.5 * p.gain * max(rise, 0.0) * (h - held))
            x = min(max(s.position + half, p.lower), p.upper)
            if block.lever:
                load += (x - s.position) * rise
                hold += (x - s.position) * bend
            else:
                load = load_at(x, p, block)
        target = p.gain * (w - load - way * (drag + lost_of(load, hold, way, p)))
        begins, before = s.position, s.speed
        span, turns = advance_lag(s, target, p.lag, way, h, decay)
        fresh = (way > 0.0 and s.position >= p.upper) or (way < 0.0 and s.position <= p.lower)
        if not turns and not fresh:
            break
        if fresh:
            ends = max(min(s.position, p.upper), p.lower)
            span, speed = time_to_reach(before, target, p.lag, way, ends - begins, span)
            if block.jams:
                s.jammed = p.jam * abs(speed)
            s.position, s.speed = ends, 0.0
        h -= span
        if h <= SHORTEST:
            break


@checked
@dataclass(frozen=True)
class Motor(Recursion):
    """lag v' + v = gain (u - L(x) - F sign v), x' = v, with or without end stops; time in samples, x in strokes.

    gain is the speed per volt, lag the motor's time constant. F is dry friction in volts: `rise` against upward and
    `fall` against downward motion, plus loss |L|, the screw friction of the load. With `stribeck` it grows by `stick`
    as the speed falls below stick_speed, with `sided` by stick_down against downward motion. At rest the motor stands
    until the input exceeds friction and load: stick is a state, not a steep slope. L(x) = load0 + load1 (x - at) +
    load2 (x - at)^2, with `load` coefficients up to 3 (4 of a lever), plus sine_k sin(2 pi k x / period) +
    cosine_k cos(2 pi k x / period) for k up to `periodic`, as a pendulum pulls over many turns (period 360 where x is
    in degrees). `stops` (True or "both", "lower", "upper", False or "none") end the motion at `lower` and `upper`,
    where the speed becomes zero; fix both at 0 and 1 with x in strokes, or leave them free and fix the next map. With
    `jams` a motor that hits a stop at speed v stays there for a time jam |v|, like a screw that jams. Each input is
    held for one sample and is delayed by `delay`.
    Between switches the lag is solved exactly, and stops are met in the middle of a sample, so a sample may be longer
    than the lag. A load that changes with x acts as in the middle of the way, to second order; `substeps` parts of a
    sample follow it more closely, the Stribeck curve, and the `further` parts, names of `sysid.motor_parts.TABLE`.
    Derivatives are exact; at a switch they are those of the branch taken, at a delay of whole samples those of a longer
    delay.
    """

    functions: ClassVar = {"step": step, "begin": begin}
    absent: ClassVar = {
        **dict.fromkeys(("stick", "stick_down", *LOADS, "loss", "jam", "delay", "bearing", *SHAPE), 0.0),
        **dict.fromkeys((f"{wave}{k}" for k in range(1, MOST_WAVES + 1) for wave in ("sine", "cosine")), 0.0),
        **{"stick_speed": 1.0, "lower": -np.inf, "upper": np.inf},
        **ABSENT,
    }
    compiles_long: ClassVar = True
    rare: ClassVar = tuple(f"has_{part}" for part in TABLE)

    load: int = 1
    lever: bool = False
    loss: bool = False
    stribeck: bool = False
    sided: bool = False
    jams: bool = False
    delayed: bool = True
    stops: Any = True  # bool, or a name of STOPS
    at: float = 0.5
    substeps: int = 1
    periodic: int = 0
    period: float = 2.0 * np.pi
    further: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        most = len(LOADS) if self.lever else 3
        if not 0 <= self.load <= most:
            raise InputError(f"load is {self.load}; give 0 to {most} coefficients of the position-dependent load")
        if not 0 <= self.periodic <= MOST_WAVES:
            raise InputError(f"periodic is {self.periodic}; give 0 to {MOST_WAVES} harmonics of the periodic load")
        if not 0.0 < self.period < np.inf:
            raise InputError(f"the period is {self.period}; give the length of a turn above 0, 2 pi or 360")
        if self.loss and not (self.load or self.periodic):
            raise InputError("loss=True needs a load; give load from 1 to 3, or periodic, or loss=False")
        if isinstance(self.stops, str):
            if self.stops not in STOPS:
                raise unknown("kind of stops", self.stops, STOPS)
            object.__setattr__(self, "stops", STOPS[self.stops])
        elif not isinstance(self.stops, bool | np.bool_):
            raise InputError(f"stops is {short_text(self.stops)}; give True, False or one of {', '.join(STOPS)}")
        if self.sided and not self.stribeck:
            raise InputError("sided=True needs friction at rest; give stribeck=True or sided=False")
        if self.jams and not self.stops:
            raise InputError("jams=True needs end stops; give stops=True or jams=False")
        for part in self.further:
            if part not in TABLE:
                raise unknown("part of a motor", part, TABLE)
        # Beyond its ends no triangle closes.
        if self.lever and (self.periodic or not (self.load and self.stops is True)):
            raise InputError(
                "lever=True needs a load from 1 to 4, none that is periodic, and both end stops; give load=4, "
                "periodic=0 and stops=True"
            )
        if self.substeps < 1:
            raise InputError(f"substeps is {self.substeps}; give at least 1")

    def __getattr__(self, name: str) -> bool:
        """`has_NAME`: whether the motor has the part NAME, for the step."""
        if name.removeprefix("has_") in TABLE and name.startswith("has_"):
            return name.removeprefix("has_") in self.further
        raise AttributeError(f"{type(self).__name__} has no {name!r}")

    @property
    def ends(self) -> tuple[str, ...]:
        """Names of the stops that it has, "lower" and "upper"."""
        if self.stops in ("lower", "upper"):
            return (self.stops,)
        return ("lower", "upper") if self.stops else ()

    @property
    def loaded(self) -> bool:
        """Whether there is a load."""
        return bool(self.load or self.periodic)

    @property
    def bent(self) -> bool:
        """Whether the load changes with the position."""
        return self.load > 1 or self.periodic > 0 or self.lever

    @property
    def turn(self) -> float:
        """2 pi / period."""
        return 2.0 * np.pi / self.period

    @property
    def waves(self) -> tuple[str, ...]:
        """Names of the periodic load's coefficients."""
        return tuple(f"{wave}{k}" for k in range(1, self.periodic + 1) for wave in ("sine", "cosine"))

    def slots(self) -> tuple[Slot, ...]:
        return self._slots

    @cached_property
    def _slots(self) -> tuple[Slot, ...]:
        """Made once: a search asks for them at each of its points."""
        slots = [
            Slot("gain", "1/V/sample", lower=0.0),
            Slot("lag", "samples", lower=_FASTEST),
            Slot("rise", "V", lower=0.0),
            Slot("fall", "V", lower=0.0),
        ]
        if self.stribeck:
            slots += [Slot("stick", "V", lower=0.0), Slot("stick_speed", "1/sample", lower=1e-9)]
        if self.sided:
            slots.append(Slot("stick_down", "V", lower=0.0))
        slots += [Slot(name, "V") for name in (*LOADS[: self.load], *self.waves)]
        if self.lever:
            slots += [Slot("bearing", "V", lower=0.0), *SHAPE_SLOTS]
        if self.loss:
            slots.append(Slot("loss", lower=0.0, upper=MOST_LOSS))
        if self.jams:
            slots.append(Slot("jam", "samples^2", lower=0.0))
        slots += [slot for part in self.further for slot in TABLE[part].slots]
        if self.delayed:
            slots.append(Slot("delay", "samples", lower=0.0, upper=LONGEST))
        slots += [Slot(name) for name in self.ends]
        return (*slots, Slot("x0", initial=True, holds=True), Slot("v0", "1/sample", initial=True))

    def value(self, theta: np.ndarray, name: str) -> float:
        """The parameter `name`; what acts in its place (0, or an end at infinity) if this motor does not have it."""
        place = self._places.get(name)
        return self.absent.get(name, 0.0) if place is None else float(theta[place])

    def named(self, theta: np.ndarray) -> SimpleNamespace:
        """theta as the functions of the step read it."""
        return SimpleNamespace(**{**self.absent, **self.by_name(theta)})

    def borne(self, theta: np.ndarray, x: float) -> tuple[float, float]:
        """The load, and the friction of a bearing behind a lever, at place x [V]."""
        p = self.named(theta)
        load, hold = lever_at(x, p, self)[:2] if self.lever else (load_at(x, p, self), 0.0)
        return float(load), float(hold)

    @cached_property
    def _places(self) -> dict[str, int]:
        """Where each parameter stands in theta; each step of a search asks."""
        return {slot.name: k for k, slot in enumerate(self.slots())}

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest theta (p,)."""
        lower, upper = zip(*((slot.lower, slot.upper) for slot in self.slots()), strict=True)
        return np.array(lower), np.array(upper)

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The equation of motion in v', not the exact solution used in the step."""
        m = self.by_name(theta)
        away = f"({w.sum([(1.0, 's' if self.lever else w.y), (-self.at, '')])})"
        net = f"{w.x} - L" if self.load or self.periodic else w.x
        powers = ("", away, *(f"{away}^{i}" for i in range(2, len(LOADS))))
        load = [(m[name], power) for name, power in zip(LOADS[: self.load], powers, strict=False)]
        for name in self.waves:
            turns = w.num(int(name[-1]) * self.turn)
            load.append((m[name], f"{'sin' if name.startswith('s') else 'cos'}({turns}*{w.y})"))
        stick = "S" if self.sided else w.num(m["stick"]) if self.stribeck else ""
        extra = [f"{stick}*exp(-(v/{w.num(m['stick_speed'])})^2)"] if self.stribeck else []
        borne = "L + B sign(v)" if self.lever else "L"
        extra += [f"{w.num(m['bearing'])}*s'"] if self.lever else []
        extra += [f"{w.num(m['loss'])}*|{borne}|"] if self.loss else []
        up = w.num(m["rise"]) + (" + R" if extra else "")
        down = f"-({w.num(m['fall'])} + R)" if extra else w.num(-m["fall"])
        places = " and at ".join(w.num(m[name]) for name in self.ends)
        ends = f"  {w.y} ends at {places}, where v becomes 0" if self.stops else ""
        ends += f" and stays 0 for a time {w.num(m['jam'])}*|v| after an impact at speed v" if self.jams else ""
        late = f" and acts {w.num(m['delay'])} samples late" if m.get("delay") else ""
        lines = [
            f"{w.num(m['lag'])}*v' + v = {w.num(m['gain'])}*({net} - F), {w.y}' = v, time in samples",
            f"  L = {self._lever_in_words(w.sum(load), m, w) if self.lever else w.sum(load)}" if load else "",
            f"  S = {w.num(m['stick'])} against upward, {w.num(m['stick_down'])} against downward motion"
            if self.sided
            else "",
            f"  R = {' + '.join(extra)}" if extra else "",
            f"  F = {up} where v > 0, F = {down} where v < 0",
            f"  v stays 0 where {down} <= {net} <= {up}",
            *(f"  {self._part_in_words(TABLE[part], m, w)}" for part in self.further),
            ends,
            f"  {w.x} is held for one sample{late}",
            self._solution_notes(),
        ]
        return [line for line in lines if line]

    def _lever_in_words(self, torque: str, m: dict[str, float], w: Writer) -> str:
        a, b, c = (w.num(m[name]) for name in SHAPE)
        angle = f"acos((1 - h)*cos({a}) + h*cos({b})), h = {w.y} - {c}*{w.y}*(1 - {w.y})/2"
        return f"({torque})*s', B = {w.num(m['bearing'])}*s', s = (a - {a})/({b} - {a}), s' = ds/d{w.y}, a = {angle}"

    def _part_in_words(self, part: MotorPart, m: dict[str, float], w: Writer) -> str:
        return part.equation.format(*(w.num(m[slot.name]) for slot in part.slots))

    def _solution_notes(self) -> str:
        each = "held input" if self.substeps == 1 else f"of {self.substeps} equal parts of a held input"
        notes = [f"L is that in the middle of the way over each {each}"] if self.bent else []
        notes += [f"v in R is that at the start of each {each}"] if self.stribeck else []
        return ", ".join([solved("", self.substeps), *notes])

    def start(self, x: np.ndarray) -> np.ndarray:
        """A motor that moves through the stroke in a tenth of the record at the largest input."""
        largest = max(float(np.abs(x).max()), 1e-9)
        first = {"gain": 10.0 / (len(x) * largest), "lag": 0.5, "stick_speed": 0.01, "upper": 1.0, "x0": 0.5}
        return np.array([first.get(slot.name, 0.0) for slot in self.slots()])

    def admissible(self, theta: np.ndarray) -> bool:
        if not self.value(theta, "lower") < self.value(theta, "upper"):
            return False
        lower, upper = self._bounds
        return bool(np.all((lower <= theta) & (theta <= upper)))

    def remarks(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[str]:
        """Whether it passes a place from which its load drives it on against friction and the largest input."""
        largest, m = float(np.abs(x).max()), {**self.absent, **self.by_name(theta)}
        waves = sum(abs(m[name]) for name in self.waves)
        for side, friction, end in ((1.0, m["rise"], m["upper"]), (-1.0, m["fall"], m["lower"])):
            # Outwards by side, away from `at`: -load(away) against all that may hold it.
            load = [-m[name] * side ** (i + 1) for i, name in enumerate(LOADS)]
            load[0] -= friction + largest + waves
            drives = np.polynomial.Polynomial(load).trim()
            if np.isfinite(end) or drives.degree() == 0 or drives.coef[-1] <= 0.0:
                continue
            roots = drives.roots()
            last = max([0.0, *roots[np.abs(roots.imag) < 1e-9].real])
            distance = float(np.nanmax(side * (y - self.at)))
            if not np.all(np.isfinite(y)) or distance > last:
                place = self.at + side * last
                return [
                    f"beyond {place:.4g} the load drives the {self.role} away from any input of this record, and the "
                    f"run gets to {self.at + side * distance:.3g}: give the motor an end stop, or a spring or periodic "
                    "load"
                ]
        return []

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        names = [slot.name for slot in self.slots()]

        def along(moves: dict[str, float]) -> np.ndarray:
            return np.array([moves.get(name, 0.0) * value for name, value in zip(names, theta, strict=True)])

        volts = {"gain": -1.0, **dict.fromkeys(_VOLTS, 1.0), **dict.fromkeys(self.waves, 1.0)}
        volts |= {name: power for part in self.further for name, power in TABLE[part].volts.items()}
        changes = [Symmetry(along(volts), in_scale=1.0)]
        if self.load and not self.lever:
            changes.append(Symmetry(np.array([float(name == "load0") for name in names]), in_shift=1.0))
        if self.load and not self.loss and not self.lever:  # a constant load is a difference between the frictions
            moves = {"rise": 1.0, "fall": -1.0, "load0": -1.0}
            changes.append(Symmetry(np.array([moves.get(name, 0.0) for name in names])))
        if not self.bent:  # a load over position would have to be scaled about `at`
            places = dict.fromkeys(("gain", "stick_speed", "lower", "upper", "x0", "v0"), 1.0) | {"jam": -1.0}
            places |= {name: power for part in self.further for name, power in TABLE[part].places.items()}
            changes.append(Symmetry(along(places), out_scale=1.0))
            shift = np.array([float(name in ("lower", "upper", "x0")) for name in names])
            changes.append(Symmetry(shift, out_shift=1.0))
        return changes

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Speed, lag and friction changed by a factor of up to about two."""
        factor = {"gain": 0.3, "lag": 0.7, "rise": 0.5, "fall": 0.5}
        names = [slot.name for slot in self.slots()]
        spread = np.array([factor.get(name, 0.0) for name in names])
        return theta * np.exp(spread * rng.normal(size=len(theta)))
