"""Servo joint: goal position to angle of a motor in its own position loop, backlash, sensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.errors import InputError, unknown
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Play, ServoMotor, static
from sysid.blocks.servo_motor import LOOPS
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.model.recipes import Map, Recipe, choice, number, static_map

LOADS = ("pendulum", "polynomial")
SUPPLIES = ("stiff", "sags")
TURN = 2.0 * math.pi
_DEGREES = ("deg", "°", "degree", "degrees")


def servo_joint(
    motor: ServoMotor | None = None,
    play: bool | Play | CoastingPlay = True,
    command: Map | None = None,
    sensor: Map | None = None,
    limit: float = 1.0,
    fixed: Mapping[str, Any] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Chain:
    """Goal position to angle y of a servo-driven joint, with physical parameters.

    goal -> command (a static map, for a goal in another unit than y; None: none) -> `ServoMotor` (the servo's loop
    around lag, dry friction with stick, the pull of a pendulum, delay) -> `Play`, or the given `play` (False: none) ->
    sensor (a static map; None: none) -> y. The servo reads its position ahead of the backlash.

    `limit` is the largest drive and gives its unit: 1 for shares of full duty, the supply voltage for volts. Gains
    that are known go into `fixed`, for example fixed={"motor.kp": 4.0} for full duty at an error of 0.25.
    `fixed` and `bounds` of the chain are by parameter. Raises InputError for a limit that is not positive.
    """
    if not 0.0 < limit < math.inf:
        raise InputError(f"the servo's limit is {limit}; give its largest drive: 1 for full duty, or volts")
    own = motor if motor is not None else ServoMotor(load=0, periodic=1, stops=False)
    blocks: list[Block] = [static(command, "command")] if command is not None else []
    blocks.append(replace(own, role="motor"))
    if play:
        blocks.append(replace(Play() if play is True else play, role="play"))
    if sensor is not None:
        blocks.append(static(sensor, "sensor"))
    held = {"motor.v0": 0.0, "motor.limit": float(limit)}
    if own.load and not own.loss:  # a constant load is a difference between the frictions
        held["motor.load0"] = 0.0
    return Chain(tuple(blocks), structure="servo_joint", fixed=held | dict(fixed or {}), bounds=dict(bounds or {}))


@dataclass(frozen=True)
class ServoJoint(Recipe):
    """Settings of a joint that grows from the plain `servo_joint`; the gains are found where they are not known.

    loop: "p", "pd" or "pid". load: "pendulum" (weight, sine and cosine of the angle) or "polynomial" (springs, a
    parabola over the angle). supply: "stiff" or "sags" (it loses voltage under the servo's current). turn [unit of the
    output]: a full turn, of a pendulum. kp [unit of the limit per unit of the output]; dead [unit of the output].
    limit: largest drive, 1 for shares of full duty, or the supply [V]. Raises InputError for a gain or a dead band
    that is not positive.
    """

    name: ClassVar[str] = "servo_joint"
    searched: ClassVar[bool] = True
    least_starts: ClassVar[int] = 4
    grown: ClassVar[bool] = True
    auto: ClassVar[str] = "lm"
    zero: ClassVar[str] = "goals and angles"
    loop: str = choice("p", "loop of the servo", LOOPS)
    load: str = choice("pendulum", "load of the servo over its angle", LOADS)
    supply: str = choice("stiff", "supply of the servo: stiff, or with a resistance", SUPPLIES)
    turn: float = number(TURN, "a full turn of a servo joint, 360 for degrees", unit="Y")
    kp: float | None = number(None, "gain of the servo's loop, if known: drive per error", unit="1/Y")
    dead: float | None = number(None, "dead band of the servo's loop around its goal, if known", unit="Y")
    limit: float = number(1.0, "largest drive of the servo: 1 for shares of full duty, or the supply voltage", unit="V")
    output_map: str | None = static_map("sensor", "a servo joint's sensor")

    def __post_init__(self) -> None:
        for name in ("kp", "dead"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InputError(f"{name} of the servo is {value}; give a number above 0, or leave it out")
        for name, allowed in (("load", LOADS), ("supply", SUPPLIES)):
            if getattr(self, name) not in allowed:
                raise unknown(f"{name} of a servo joint", getattr(self, name), allowed)
        super().__post_init__()

    @classmethod
    def ladder(cls, data: IOData) -> tuple[Recipe, ...]:
        """P and PD, with the turn of the record's unit."""
        plain = cls(turn=360.0 if data.y_unit in _DEGREES else TURN)
        return plain, replace(plain, loop="pd")

    def neighbours(self) -> tuple[Recipe, ...]:
        """A loop with one term more or less, the other load, and the other supply."""
        k = LOOPS.index(self.loop)
        found = [{"loop": loop} for loop in (*LOOPS[max(k - 1, 0) : k], *LOOPS[k + 1 : k + 2])]
        found += [{"load": load} for load in LOADS if load != self.load]
        found += [{"supply": supply} for supply in SUPPLIES if supply != self.supply]
        return tuple(replace(self, **change) for change in found)

    def model(self) -> Chain:
        loads = {"load": 3, "at": 0.0} if self.load == "polynomial" else {"load": 0, "periodic": 1, "period": self.turn}
        options = {"loop": self.loop, "dead": self.dead is not None, "sags": self.supply == "sags"}
        motor = ServoMotor(stops=False, **options, **loads)
        known = {f"motor.{name}": value for name in ("kp", "dead") if (value := getattr(self, name)) is not None}
        return servo_joint(motor, play=False, sensor=self.output_map, limit=self.limit, fixed=known)

    def in_words(self, fit: Any = None) -> str:
        parts = f"motor with friction in a {self.loop.upper()} loop, {self.load} load, backlash"
        return ", ".join([f"Servo joint ({parts})", *self.maps_in_words()])

    def as_subject(self, fit: Any = None) -> str:
        words = self.in_words(fit)
        return f"A {words[0].lower()}{words[1:]}"

    def physics(self) -> dict[str, Any]:
        return {}
