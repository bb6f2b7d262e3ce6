"""Servo joint: goal position to angle of a motor in its own position loop, backlash, sensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Play, ServoMotor, static
from sysid.blocks.servo_motor import LOOPS
from sysid.data.record import IOData
from sysid.data.wraps import turn_of
from sysid.model.chain import Chain
from sysid.model.recipes import Map, Recipe, choice, number, static_map

LOADS = ("pendulum", "polynomial")
SUPPLIES = ("stiff", "sags")


@checked
def servo_joint(
    motor: ServoMotor | None = None,
    play: bool | Play | CoastingPlay = True,
    command: Map | None = None,
    sensor: Map | None = None,
    limit: float = 1.0,
    fixed: Mapping[str, Any] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    kp: float | None = None,
    kd: float | None = None,
    ki: float | None = None,
    Ts: float | None = None,
) -> Chain:
    """Goal position to angle y of a servo-driven joint, with physical parameters.

    goal -> command (a static map, for a goal in another unit than y; None: none) -> `ServoMotor` (the servo's loop
    around lag, dry friction with stick, the pull of a pendulum, delay) -> `Play`, or the given `play` (False: none) ->
    sensor (a static map; None: none) -> y. The servo reads its position ahead of the backlash.

    `limit` is the largest drive and gives its unit: 1 for shares of full duty, the supply voltage for volts. kp [drive
    per unit of y], kd [drive s per unit of y] and ki [drive per unit of y and s] are the gains that are known, for
    example kp=4.0 for full duty at an error of 0.25; kd and ki need the sampling time Ts [s]. `fixed` and `bounds` of
    the chain are by parameter, whose time counts in samples. Raises InputError for a limit that is not positive, for a
    gain that the loop does not have, is negative, or is also in `fixed`, and for kd or ki without Ts.
    """
    if not 0.0 < limit < math.inf:
        raise InputError(f"the servo's limit is {limit}; give its largest drive: 1 for full duty, or volts")
    block = motor if motor is not None else ServoMotor(load=0, periodic=1, stops=False, at=0.0)
    known_gains = _known(block, {"kp": kp, "kd": kd, "ki": ki}, Ts)
    if twice := [name for name in known_gains if name in (fixed or {})]:
        raise InputError(f"{twice[0]} is given as a gain and in fixed; leave one of the two out")
    blocks: list[Block] = [static(command, "command")] if command is not None else []
    blocks.append(replace(block, role="motor"))
    if play:
        blocks.append(replace(Play() if play is True else play, role="play"))
    if sensor is not None:
        blocks.append(static(sensor, "sensor"))
    constants = {"motor.v0": 0.0, "motor.limit": float(limit)}
    if block.load and not block.loss:  # a constant load is a difference between the frictions
        constants["motor.load0"] = 0.0
    constants |= known_gains | dict(fixed or {})
    return Chain(tuple(blocks), structure="servo_joint", fixed=constants, bounds=dict(bounds or {}))


def _known(motor: ServoMotor, gains: Mapping[str, float | None], Ts: float | None) -> dict[str, float]:
    """The gains that are known by parameter, in samples of Ts [s]."""
    named_gains = {name: value for name, value in gains.items() if value is not None}
    names = {slot.name for slot in motor.slots()}
    for name, value in named_gains.items():
        if name not in names:
            raise InputError(
                f"{name} of the servo is {value} and its loop {motor.loop!r}, which has none; leave {name} out or give "
                f"loop {'pid' if name == 'ki' else 'pd'}"
            )
        if not 0.0 <= value < math.inf or (name == "kp" and value == 0.0):
            least = "a number above 0" if name == "kp" else "0 or more"
            raise InputError(f"{name} of the servo is {value}; give {least}, or leave it out")
    if Ts is None and any(name != "kp" for name in named_gains):
        raise InputError("kd and ki of a servo count in seconds; give Ts, the sampling time [s]")
    factor = {"kp": 1.0, "kd": 1.0 / (Ts or 1.0), "ki": Ts or 1.0}
    return {f"motor.{name}": value * factor[name] for name, value in named_gains.items()}


@checked
@dataclass(frozen=True)
class ServoJoint(Recipe):
    """Settings of a servo joint with all parts (`sysid.fit_joint`); the gains are found where they are not known.

    loop: "p", "pd" or "pid". load: "pendulum" (weight, sine and cosine of the angle) or "polynomial" (springs, a
    parabola over the angle). supply: "stiff" or "sags" (it loses voltage under the servo's current). turn [unit of the
    output]: a full turn, of a pendulum; by default 360 of a record in degrees and 2 pi of another. kp [unit of the
    limit per unit of the output]; kd, the same times s; ki, the same per s; dead [unit of the output]. limit:
    largest drive, 1 for shares of full duty, or the supply [V]. Raises InputError for a gain that is negative or that
    the loop does not have, and for a kp or a dead band that is not positive.
    """

    name: ClassVar[str] = "servo_joint"
    searched: ClassVar[bool] = True
    least_starts: ClassVar[int] = 4
    with_parts: ClassVar[bool] = True
    auto: ClassVar[str] = "lm"
    zero: ClassVar[str] = "goals and angles"
    loop: str = choice("p", "loop of the servo", LOOPS)
    load: str = choice("pendulum", "load of the servo over its angle", LOADS)
    supply: str = choice("stiff", "supply of the servo: stiff, or with a resistance", SUPPLIES)
    turn: float | None = number(None, "a full turn of a servo joint [2 pi rad]", unit="Y")
    kp: float | None = number(None, "gain of the servo's loop, if known: drive per error", unit="1/Y")
    dead: float | None = number(None, "dead band of the servo's loop around its goal, if known", unit="Y")
    limit: float = number(1.0, "largest drive of the servo: 1 for shares of full duty, or the supply voltage", unit="V")
    output_map: str | None = static_map("sensor", "a servo joint's sensor")
    kd: float | None = number(None, "derivative gain of the servo's loop, if known: drive per speed", unit="s/Y")
    ki: float | None = number(None, "integral gain of the servo's loop, if known: drive per error, per s", unit="1/Ys")

    def __post_init__(self) -> None:
        if self.dead is not None and not 0.0 < self.dead < math.inf:
            raise InputError(f"dead of the servo is {self.dead}; give a number above 0, or leave it out")
        for name, allowed in (("load", LOADS), ("supply", SUPPLIES)):
            if getattr(self, name) not in allowed:
                raise unknown(f"{name} of a servo joint", getattr(self, name), allowed)
        super().__post_init__()

    @classmethod
    @checked
    def ladder(cls, data: IOData) -> tuple[Recipe, ...]:
        """P and PD, with the turn of the record's unit."""
        plain = cls(turn=turn_of(data))
        return plain, replace(plain, loop="pd")

    def neighbours(self) -> tuple[Recipe, ...]:
        """A loop with one term more or less that has every known gain, the other load, and the other supply."""
        k, least = LOOPS.index(self.loop), 2 if self.ki is not None else 1 if self.kd is not None else 0
        recipes = [replace(self, loop=LOOPS[i]) for i in (k - 1, k + 1) if least <= i < len(LOOPS)]
        recipes += [replace(self, load=load) for load in LOADS if load != self.load]
        return (*recipes, *(replace(self, supply=supply) for supply in SUPPLIES if supply != self.supply))

    def model(self) -> Chain:
        """With gains per sample of one second, and a turn of 2 pi where none is given."""
        return self._model(1.0, 2.0 * math.pi)

    def model_of(self, data: IOData) -> Chain:
        """With gains per sample of the record, and the turn of its unit where none is given."""
        return self._model(data.Ts, turn_of(data))

    def _model(self, Ts: float, turn: float) -> Chain:
        motor = ServoMotor(stops=False, loop=self.loop, dead=self.dead is not None, sags=self.supply == "sags", at=0.0)
        if self.load == "polynomial":
            motor = replace(motor, load=3)
        else:
            motor = replace(motor, load=0, periodic=1, period=turn if self.turn is None else self.turn)
        constants = {} if self.dead is None else {"motor.dead": self.dead}
        gains: dict[str, Any] = {"kp": self.kp, "kd": self.kd, "ki": self.ki, "Ts": Ts}
        return servo_joint(motor, play=False, sensor=self.output_map, limit=self.limit, fixed=constants, **gains)

    def in_words(self, fit: Any = None) -> str:
        parts = f"motor with friction in a {self.loop.upper()} loop, {self.load} load, backlash"
        return ", ".join([f"Servo joint ({parts})", *self.maps_in_words()])

    def as_subject(self, fit: Any = None) -> str:
        words = self.in_words(fit)
        return f"A {words[0].lower()}{words[1:]}"

    def physics(self) -> dict[str, Any]:
        return {}
