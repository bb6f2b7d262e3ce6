"""Actuated joint: driver, motor with friction between two stops, linkage, play, sensor."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, Play, Quantiser, TravelMap, static
from sysid.model.chain import Chain
from sysid.model.recipes import Map


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
    """Voltage u to angle y of a joint that a motor drives between two end stops; the parameters are physical.

    u [V] -> the driver's levels, `driver_step` [V] apart (None: none) -> driver (a static map, for example
    "dead_zone_saturation"; None: none) -> `Motor` (lag, dry friction with stick, load over position, delay, end stops)
    -> smooth `TravelMap` of `knots` (None: none) -> `Play`, or the `play` that is given (False: none) -> sensor (a
    static map, a `Custom` absolute value for one that is blind to sign; None: none) -> y. With a travel map the motor's
    position counts in strokes, its stops are held at 0 and 1, and `map.low` and `map.high` are the angles of the ends.
    Without one it counts in the unit of y and has no stops unless `motor` says so.

    `fixed` and `bounds` are the chain's, by parameter: a frozen part is fixed={"play": [0.0]}. Dry friction and a
    driver's dead zone both take volts, and only a motor that coasts can tell them apart: leave one of them out.
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
