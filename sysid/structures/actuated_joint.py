"""Actuated joint: driver, motor with friction between two stops, linkage, backlash, sensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.errors import InputError
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, Play, Quantiser, TravelMap, static
from sysid.model.chain import Chain
from sysid.model.recipes import Map, Recipe, number, static_map


def actuated_joint(
    driver: Map | None = None,
    motor: Motor | None = None,
    knots: int | None = 9,
    play: bool | Play | CoastingPlay = True,
    sensor: Map | None = None,
    driver_step: float | None = None,
    fixed: Mapping[str, Any] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Chain:
    """Voltage u to angle y of a motor-driven joint between two end stops, with physical parameters.

    u [V] -> driver levels at intervals of `driver_step` [V] (None: none) -> driver (a static map, for example
    "dead_zone_saturation"; None: none) -> `Motor` (lag, dry friction with stick, load over position, delay, end stops)
    -> smooth `TravelMap` of `knots` (None: none) -> `Play`, or the given `play` (False: none) -> sensor (a static map,
    for example a `Custom` absolute value for a sensor without sign; None: none) -> y. With a travel map the motor's
    position is in strokes, its stops are fixed at 0 and 1, and `map.low` and `map.high` are the angles of the ends.
    Without a travel map the position is in the unit of y and has no stops unless `motor` has them.

    `fixed` and `bounds` of the chain are by parameter, for example fixed={"play": [0.0]}. Dry friction and the driver's
    dead zone have the same effect unless the motor coasts: leave one of them out.
    """
    own = motor if motor is not None else Motor(load=3, stops=knots is not None)
    blocks: list[Block] = [Quantiser(driver_step, role="levels")] if driver_step is not None else []
    if driver is not None:
        blocks.append(static(driver, "driver"))
    blocks.append(replace(own, role="motor"))
    if knots is not None:
        blocks.append(TravelMap(knots, smooth=True, role="map"))
    if play:
        blocks.append(replace(Play() if play is True else play, role="play"))
    if sensor is not None:
        blocks.append(static(sensor, "sensor"))
    # At the first sample only position counts: a speed is gone within a lag. A constant load is no more than a
    # difference between the frictions up and down, unless the screw takes a share of it.
    held = {"motor.v0": 0.0}
    if own.load and not own.loss:
        held["motor.load0"] = 0.0
    if knots is not None and own.stops:
        held |= {"motor.lower": 0.0, "motor.upper": 1.0}
    held |= fixed or {}
    return Chain(tuple(blocks), structure="actuated_joint", fixed=held, bounds=dict(bounds or {}))


@dataclass(frozen=True)
class ActuatedJoint(Recipe):
    """Settings of a joint that grows from the plain `actuated_joint`; data sheets give both numbers.

    driver_step [V]: interval between the driver's levels. sensor_linearity [unit of the output]: largest deviation of
    the sensor from a straight line.
    """

    name: ClassVar[str] = "actuated_joint"
    searched: ClassVar[bool] = True
    least_starts: ClassVar[int] = 10  # a record in blocks has an initial position for each, and more local optima
    grown: ClassVar[bool] = True
    auto: ClassVar[str] = "lm"  # a joint's cost bends too much for the changes of method that "auto" makes
    zero: ClassVar[str] = "volts and angles"
    input_map: str | None = static_map("driver", "an actuated joint's driver")
    output_map: str | None = static_map("sensor", "an actuated joint's sensor")
    driver_step: float | None = number(
        None, "interval between the driver levels of an actuated joint, if known", unit="V"
    )
    sensor_linearity: float = number(
        0.0, "largest deviation of an actuated joint's sensor from a straight line, if known", unit="Y"
    )

    def __post_init__(self) -> None:
        if not 0.0 <= self.sensor_linearity < math.inf:
            raise InputError(
                f"the sensor's linearity is {self.sensor_linearity}; give its largest deviation from a line, 0 or more"
            )
        super().__post_init__()

    def model(self) -> Chain:
        return actuated_joint(driver=self.input_map, sensor=self.output_map, driver_step=self.driver_step, play=False)

    def in_words(self, fit: Any = None) -> str:
        parts = "motor with friction between two stops, linkage, backlash"
        return ", ".join([f"Actuated joint ({parts})", *self.maps_in_words()])

    def as_subject(self, fit: Any = None) -> str:
        words = self.in_words(fit)
        return f"An {words[0].lower()}{words[1:]}"

    def physics(self) -> dict[str, Any]:
        return {"linearity": self.sensor_linearity}
