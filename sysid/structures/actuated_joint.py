"""Actuated joint: driver, motor with friction between two end stops, linkage, backlash, sensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Compliance, Linkage, Motor, Play, Quantiser, TravelMap, static
from sysid.blocks.motor import STOPS
from sysid.data.record import IOData
from sysid.data.wraps import turn_of
from sysid.model.chain import Chain
from sysid.model.recipes import Map, Recipe, choice, number, static_map
from sysid.structures.hammerstein_wiener import HammersteinWiener

_BENDS = 4  # knots of a linkage that may be bent at its ends


@checked
def actuated_joint(
    driver: Map | None = None,
    motor: Motor | None = None,
    knots: int | None = 0,
    play: bool | Play | CoastingPlay = True,
    compliance: bool | Compliance = False,
    sensor: Map | None = None,
    driver_step: float | None = None,
    fixed: Mapping[str, Any] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Chain:
    """Voltage u to angle y of a motor-driven joint between two end stops, with physical parameters.

    u [V] -> driver levels at intervals of `driver_step` [V] (None: none) -> driver (a static map, for example
    "dead_zone_saturation"; None: none) -> `Motor` (lag, dry friction with stick, load over position, delay, end stops)
    -> `Linkage`, or a smooth `TravelMap` of `knots` (None: neither) -> `Play`, or the given `play` (False: none)
    -> `Compliance`, a link on a spring (False: none) -> sensor (a static map, for example a `Custom` absolute value for
    a sensor without sign; None: none) -> y. With a linkage or travel map the motor's position is in strokes, its stops
    are fixed at 0 and 1, and `map.low` and `map.high` are the angles of the ends. With neither the position is in the
    unit of y and has no stops unless `motor` has them.

    `fixed` and `bounds` of the chain are by parameter, for example fixed={"play": [0.0]}. Dry friction and the driver's
    dead zone have the same effect unless the motor coasts: leave one of them out.
    """
    block = motor if motor is not None else Motor(load=3, stops=knots is not None)
    blocks: list[Block] = [Quantiser(driver_step, role="levels")] if driver_step is not None else []
    if driver is not None:
        blocks.append(static(driver, "driver"))
    blocks.append(replace(block, role="motor"))
    if knots is not None:
        curve = TravelMap(knots, smooth=True, bent_ends=knots >= _BENDS) if knots else Linkage()
        blocks.append(replace(curve, role="map"))
    if play:
        blocks.append(replace(Play() if play is True else play, role="play"))
    if compliance:
        blocks.append(replace(Compliance() if compliance is True else compliance, role="link"))
    if sensor is not None:
        blocks.append(static(sensor, "sensor"))
    # At the first sample only position counts: a speed is gone within a lag. A constant load is no more than a
    # difference between the frictions up and down, unless the screw takes a share of it.
    constants = {"motor.v0": 0.0}
    if block.load and not block.loss:
        constants["motor.load0"] = 0.0
    if knots is not None:
        constants |= {f"motor.{end}": float(end == "upper") for end in block.ends}
    if compliance:  # nor does the link swing yet
        constants |= {"link.lead0": 0.0, "link.speed0": 0.0}
    constants |= fixed or {}
    return Chain(tuple(blocks), structure="actuated_joint", fixed=constants, bounds=dict(bounds or {}))


_ENDED = {
    **{"both": "between two end stops", "none": "without end stops"},
    **{"lower": "with a lower end stop", "upper": "with an upper end stop"},
}
_LOADED = {"polynomial": "", "periodic": " and a periodic load", "spring": " and a spring", "none": " and no load"}
LOADS = tuple(_LOADED)


@checked
def joint_motor(load: str = "polynomial", stops: str = "both", period: float | None = None) -> Motor:
    """The motor of a joint with a load of one of `LOADS` and end stops of one of `STOPS`.

    A polynomial load is a parabola over the stroke, a periodic one has two harmonics of `period` (None: 2 pi) over the
    angle, a spring one rises with the angle. Raises InputError for another name.
    """
    if load not in LOADS:
        raise unknown("load of a joint", load, LOADS)
    if load == "periodic":
        return Motor(load=0, stops=stops, periodic=2, period=2.0 * math.pi if period is None else period, at=0.0)
    if period is not None:
        raise InputError(f"the period is {period} and the load {load}; leave the period out or give load periodic")
    return Motor(load={"polynomial": 3, "spring": 2, "none": 0}[load], stops=stops, at=0.5 if stops == "both" else 0.0)


@checked
@dataclass(frozen=True)
class ActuatedJoint(Recipe):
    """Settings of an actuated joint with all parts (`sysid.fit_joint`), from the plain `actuated_joint`.

    load: "polynomial" over the stroke, "periodic" over the angle (a pendulum that turns over; `period` is a turn, by
    default 360 of a record in degrees and 2 pi of another), "spring" or "none". stops: those that it may have. A joint
    with both stops and no periodic load has a linkage between motor and joint; of the others the angle is proportional
    to the motor's. compliance: "on" for a link on a spring. driver_step [V]: interval between the driver's levels;
    sensor_linearity [unit of the output]: largest deviation of the sensor from a straight line; data sheets give both
    numbers.
    """

    name: ClassVar[str] = "actuated_joint"
    searched: ClassVar[bool] = True
    least_starts: ClassVar[int] = 10  # a record in blocks has an initial position for each, and more local optima
    with_parts: ClassVar[bool] = True
    auto: ClassVar[str] = "lm"  # a joint's cost bends too much for the changes of method that "auto" makes
    zero: ClassVar[str] = "volts and angles"
    moves: ClassVar[bool] = True
    input_map: str | None = static_map("driver", "an actuated joint's driver")
    output_map: str | None = static_map("sensor", "an actuated joint's sensor")
    driver_step: float | None = number(
        None, "interval between the driver levels of an actuated joint, if known", unit="V"
    )
    sensor_linearity: float = number(
        0.0, "largest deviation of an actuated joint's sensor from a straight line, if known", unit="Y"
    )
    load: str = choice("polynomial", "load of an actuated joint", LOADS)
    stops: str = choice("both", "end stops that an actuated joint begins with", tuple(STOPS))
    compliance: str = choice("off", "a spring between an actuated joint's drive and its link", ("off", "on"))
    period: float | None = number(None, "a turn of an actuated joint with a periodic load [2 pi rad]", unit="Y")

    def __post_init__(self) -> None:
        if not 0.0 <= self.sensor_linearity < math.inf:
            raise InputError(
                f"the sensor's linearity is {self.sensor_linearity}; give its largest deviation from a line, 0 or more"
            )
        super().__post_init__()

    def model(self) -> Chain:
        for name, value in (("load", LOADS), ("stops", tuple(STOPS)), ("compliance", ("off", "on"))):
            if getattr(self, name) not in value:
                raise unknown(f"{name} of a joint", getattr(self, name), value)
        return actuated_joint(
            driver=self.input_map,
            motor=joint_motor(self.load, self.stops, self.period),
            knots=0 if self.mapped else None,
            play=False,
            compliance=self.compliance == "on",
            sensor=self.output_map,
            driver_step=self.driver_step,
            bounds={"motor.load1": (0.0, math.inf)} if self.load == "spring" else None,
        )

    def blocks_to_compile(self) -> tuple[Block, ...]:
        """With the backlash that is tried, and the general model beside which a joint is judged."""
        return (*super().blocks_to_compile(), CoastingPlay(), *HammersteinWiener().model().blocks)

    def model_of(self, data: IOData) -> Chain:
        """With 360 for a turn of a periodic load where the record is in degrees."""
        if self.load == "periodic" and self.period is None:
            return replace(self, period=turn_of(data)).model()
        return self.model()

    @property
    def mapped(self) -> bool:
        """Whether a linkage is between the motor and the joint."""
        return self.stops == "both" and self.load != "periodic"

    def in_words(self, fit: Any = None) -> str:
        parts = f"motor with friction {_ENDED[self.stops]}{_LOADED[self.load]}"
        blocks = () if fit is None else fit.model.blocks
        parts += (", linkage" if self.mapped else "") + (", backlash" if any(b.role == "play" for b in blocks) else "")
        parts += ", link on a spring" if self.compliance == "on" else ""
        return ", ".join([f"Actuated joint ({parts})", *self.maps_in_words()])

    def as_subject(self, fit: Any = None) -> str:
        words = self.in_words(fit)
        return f"An {words[0].lower()}{words[1:]}"

    def physics(self) -> dict[str, Any]:
        return {"linearity": self.sensor_linearity}
