"""Angles of a file before a fit: wraps at a turn undone, and settings brought to the record's unit."""

from dataclasses import replace
from typing import Any

import numpy as np

from sysid.channels.units import convert
from sysid.data.record import IOData
from sysid.data.wraps import DEGREES, turn_of, unwrapped
from sysid.model.recipes import Recipe
from sysid.workflow.record import Record


def without_wraps(record: Record) -> Record:
    """The record with its output's wraps at a turn undone, and those of a goal in the same unit; one note says so.

    The turn is that of the output's unit; an output without a unit may show any of `sysid.data.wraps.TURNS`. A goal
    goes the shorter way at each of its jumps and begins within half a turn of the angle.
    """
    data = record.data
    found = unwrapped(data, turn_of(data) if data.y_unit in ("rad", *DEGREES) else None)
    if not found.count:
        return record
    out, note = found.data, f"column {record.output!r}: {found.sentence}"
    if data.u_unit == data.y_unit and data.u_unit in ("rad", *DEGREES):
        out = replace(out, u=_followed(data, found.turn))
    return replace(record, data=out, remarks=(*record.remarks, note))


def _followed(data: IOData, turn: float) -> np.ndarray:
    """The goal (N, nu) beside an angle that counts on over turns."""
    goal = data.u if np.ptp(data.u) > turn else np.unwrap(data.u, period=turn, axis=0)
    return goal + turn * np.round((data.y[0, 0] - goal[0]) / turn)


def in_unit_of(record: Record, recipe: Recipe) -> tuple[Recipe, Record]:
    """The recipe with its settings in the record's unit, and the record with a note on which they are.

    A person gives them in the unit that the file's column names, for example degrees, which are read as radians.
    """
    unit = record.signals.mapping.output[0].unit
    factor = convert(unit).factor
    scaled = recipe.scaled(factor) if factor != 1.0 else recipe
    changed = [name for name, value in _numbers(recipe).items() if _numbers(scaled)[name] != value]
    if not changed:
        return recipe, record
    names = " and ".join(f"--{name.replace('_', '-')}" for name in changed)
    verb = "counts" if len(changed) == 1 else "count"
    note = f"{names} {verb} in the unit of column {record.output!r}, {unit}"
    return scaled, replace(record, remarks=(*record.remarks, note))


def _numbers(recipe: Recipe) -> dict[str, Any]:
    return {name: getattr(recipe, name) for name in recipe.of_kind("number")}
