"""Random draws of the parameters of an ensemble."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from numbers import Real

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from twin.hardware.actuator import check_rotor
from twin.hardware.linkage import clearance, end_angles
from twin.parameters import JOINTS, ORDERED, TABLE, Parameters, Row

ROWS = {row.name: row for row in TABLE}
WHOLE = frozenset({"pwm_bits", "adc_bits"})  # rows with whole numbers
SHAPE = ("retracted_length", "stroke", "base_radius", "rod_radius")  # rows that decide whether a triangle closes
ROTOR = ("rotor_inertia", "gear_ratio", "lead")  # rows of the rotor's mass at the output
TRIES = 100_000  # over the whole box, about every tenth triangle closes


@dataclass(frozen=True)
class Draw:
    """Parameters of one experiment; `redrawn` counts the rejected draws before them."""

    parameters: Parameters
    redrawn: int


@checked(late=True)
@dataclass(frozen=True)
class Draws:
    """Parameters that are drawn for each experiment, independent of each other; the others do not change.

    `spread` gives a relative spread: {"thigh.coulomb": 0.2} is uniform within 20 % of the experiment's value, inside
    the row's bounds. `uniform` and `log_uniform` name rows that are drawn over their whole bounds. Rows with whole
    numbers (pwm_bits, adc_bits) are rounded. Invalid geometries are drawn again, joint by joint; so are rotors too
    light for the simulation and benches with the foot inside the floor.

    The draw of experiment i depends only on `seed` and i. The draw of a row does not depend on other rows, except
    within one joint's triangle. Raises InputError for unknown or repeated names and for invalid bounds or spreads.
    """

    spread: Mapping[str, float] = field(default_factory=dict)
    uniform: Sequence[str] = ()
    log_uniform: Sequence[str] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        for field_name in ("uniform", "log_uniform"):
            if isinstance(getattr(self, field_name), str):
                raise InputError(f"{field_name} is the string {getattr(self, field_name)!r}; give a list of names")
            object.__setattr__(self, field_name, tuple(getattr(self, field_name)))
        if isinstance(self.seed, bool) or not isinstance(self.seed, int | np.integer) or self.seed < 0:
            raise InputError(f"seed of the draws is {self.seed!r}; give a whole number of at least 0")
        names = (*self.spread, *self.uniform, *self.log_uniform)
        for name in names:
            if name not in ROWS:
                raise unknown("parameter", name, ROWS)
            if names.count(name) > 1:
                raise InputError(f"{name} is given in two ways of drawing; give it once")
        for name, part in self.spread.items():
            if isinstance(part, bool) or not isinstance(part, Real) or not 0 < float(part) < np.inf:
                raise InputError(f"the spread of {name} is {part!r}; give a positive number, 0.2 for 20 %")
        for name in self.log_uniform:
            if ROWS[name].lower <= 0:
                raise InputError(
                    f"the lower bound of {name} is {ROWS[name].lower:g}, which has no logarithm; draw it uniformly"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """The rows that are drawn, in the order of the table."""
        names = {*self.spread, *self.uniform, *self.log_uniform}
        return tuple(row.name for row in TABLE if row.name in names)

    @checked(late=True)
    def limits(self, base: Parameters) -> dict[str, tuple[float, float]]:
        """Limits of each row's draw around `base`; raises InputError for a relative spread about 0."""
        for name in self.spread:
            if base[name] == 0:
                raise InputError(f"{name} is 0, so a relative spread has no effect; draw it uniformly")
        return {name: self._limits(ROWS[name], base) for name in self.names}

    def _limits(self, row: Row, base: Parameters) -> tuple[float, float]:
        if row.name not in self.spread:
            return row.lower, row.upper
        half = abs(base[row.name]) * self.spread[row.name]
        return max(row.lower, base[row.name] - half), min(row.upper, base[row.name] + half)

    @checked(late=True)
    def draw(self, base: Parameters, number: int) -> Draw:
        """The parameters of experiment `number`; raises InputError if none of very many draws is a valid leg."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(number,)))
        limits = self.limits(base)
        values = dict(base.values) | self._values(limits, rng)
        redrawn = 0

        def redraw(rows: Sequence[str], is_valid: Callable[[], bool]) -> None:
            nonlocal redrawn
            part = {name: limits[name] for name in rows if name in limits}
            while part and redrawn <= TRIES and not is_valid():
                redrawn += 1
                values.update(self._values(part, rng))

        for joint in JOINTS:
            redraw([f"{joint}.{part}" for part in SHAPE], partial(_closes, values, joint))
            if not _closes(values, joint):
                end_angles(Parameters(values), joint)  # raises with the reason
        for joint in JOINTS:
            redraw([f"{joint}.{part}" for part in ROTOR], partial(_heavy, values, joint))
        redraw(["bench_height"], lambda: clearance(Parameters(values)) >= 0.0)  # else the foot starts inside the floor
        return Draw(Parameters(values), redrawn)

    def _values(self, limits: Mapping[str, tuple[float, float]], rng: np.random.Generator) -> dict[str, float]:
        # Numbers for all rows, so that a row's does not depend on the others; those of new imperfections come
        # from another generator, which leaves the numbers of a second draw as they were.
        numbers = *rng.random(ORDERED), *rng.spawn(1)[0].random(len(ROWS) - ORDERED)
        shares = dict(zip(ROWS, numbers, strict=True))
        return {name: self._value(name, *span, shares[name]) for name, span in limits.items()}

    def _value(self, name: str, low: float, high: float, share: float) -> float:
        if name in self.log_uniform:
            value = float(np.exp(np.log(low) + share * (np.log(high) - np.log(low))))
        else:
            value = low + share * (high - low)
        value = min(max(value, low), high)
        return float(round(value)) if name in WHOLE else value


def whole_box(seed: int = 0) -> Draws:
    """Every row uniform over its bounds."""
    return Draws(uniform=tuple(ROWS), seed=seed)


def _heavy(values: Mapping[str, float], joint: str) -> bool:
    """Whether a joint's rotor is heavy enough for the simulation."""
    try:
        check_rotor(Parameters(values), joint)
    except InputError:
        return False
    return True


def _closes(values: Mapping[str, float], joint: str) -> bool:
    """Whether a joint's triangle closes at both actuator lengths, as `end_angles` needs; does not raise."""
    if joint == "shoulder":
        return True
    base, rod, low, stroke = (
        values[f"{joint}.{part}"] for part in ("base_radius", "rod_radius", "retracted_length", "stroke")
    )
    return all(-1 < (base**2 + rod**2 - length**2) / (2 * base * rod) < 1 for length in (low, low + stroke))
