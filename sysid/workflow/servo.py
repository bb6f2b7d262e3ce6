"""What the log of a servo says of its settings: the loop and gains of its header, and the length of a turn."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks.servo_motor import LOOPS
from sysid.channels.column import parse_header
from sysid.channels.roles import REFERENCE
from sysid.channels.signals import Signals
from sysid.data.wraps import turn_of
from sysid.model.recipes import Recipe
from sysid.structures import ServoJoint
from sysid.workflow.record import Record


def with_servo(recipe: Recipe, records: Sequence[Record]) -> tuple[Recipe, Record]:
    """A servo joint of which nothing is given with the loop and the gains in the headers of its logs, which `qpal rig`
    reads from the servo, and the first record with a note on them.

    Raises InputError for logs of different loops, and for a header that is damaged.
    """
    first = records[0]
    told = [record.header.get("servo") for record in records]
    if not isinstance(recipe, ServoJoint) or not isinstance(told[0], dict):
        return recipe, first
    if recipe != ServoJoint(turn=recipe.turn, load=recipe.load, supply=recipe.supply, output_map=recipe.output_map):
        return recipe, first
    loops = [{name: (t if isinstance(t, dict) else {}).get(name) for name in ("loop", "kp")} for t in told]
    other = next((record for record, loop in zip(records, loops, strict=True) if loop != loops[0]), None)
    if other is not None:
        raise InputError(
            f"{other.path} was recorded with other gains of the servo than {first.path}; identify them apart"
        )
    loop, kp = loops[0]["loop"], loops[0]["kp"]
    if loop not in LOOPS or not (kp is None or (isinstance(kp, int | float) and 0.0 < kp < np.inf)):
        raise InputError(f"the header has the servo's loop {loops[0]}; correct it, or give --loop and --kp")
    gain = "an unknown kp" if kp is None else f"kp {kp:.4g}"
    note = f"the header names the servo's loop: {loop.upper()}, {gain} (shares of its largest drive per rad)"
    return replace(recipe, loop=loop, kp=kp), replace(first, remarks=(*first.remarks, note))


def is_of_servo(signals: Signals) -> bool:
    """Whether the input is a reference by its name, in the unit of the output: a goal that a servo goes to."""
    if (len(signals.input), len(signals.output)) != (1, 1):
        return False
    (goal,), (place,) = signals.input, signals.output
    return parse_header(goal.column).has(REFERENCE) and goal.unit == place.unit


def with_turn(recipe: Recipe, record: Record) -> Record:
    """The record with a note on the length of a turn, where the load repeats with it and the output names no unit."""
    option = {"servo_joint": "turn", "actuated_joint": "period"}.get(recipe.name, "")
    turns = getattr(recipe, "load", "") in ("pendulum", "periodic")
    if not turns or record.data.y_unit or getattr(recipe, option) is not None:
        return record
    note = f"a turn is taken as {turn_of(record.data):.5g}, since the output names no unit: give it with --{option}"
    return replace(record, remarks=(*record.remarks, note))
