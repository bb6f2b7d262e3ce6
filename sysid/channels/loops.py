"""The log of a controller: set point, what the controller gives out, and what the plant answers with."""

from collections.abc import Mapping

import numpy as np

from sysid.channels.column import Column, words
from sysid.channels.conversion import convert
from sysid.channels.roles import SWITCH, Columns, Roles, is_direction, role_by_name

SET_POINT = words("setpoint sp reference ref goal target desired des sollwert")
_GIVEN_OUT = words("output out co op")  # of a controller: these name no answer of the plant
_LEVEL = 0.01  # of the tests
_FEWEST = 4  # changes of the set point
_LATER = 2  # samples in which a controller has answered


def is_set_point(column: Column) -> bool:
    """Whether the name says what a controller is to hold."""
    return column.header.has(SET_POINT) or column.header.words >= {"set", "point"}


def roles_in_loop(columns: Columns, why: list[str]) -> Roles | None:
    """Input and output of the plant beside a set point; None where names and numbers do not show all three.

    The plant's output is the column that comes closest to the set point before this changes. The input is the only
    other one that may be a controller's output by its name, or jumps with the set point.
    """
    moving = [c for c in columns.values() if not c.constant and not c.header.has(SWITCH) and not is_direction(c)]
    set_points = [c for c in moving if is_set_point(c)]
    if len(set_points) != 1:
        return None
    (goal,) = set_points
    others = [c for c in moving if c is not goal and not c.dated]
    y = _answer(others, goal)
    given_out = [c for c in others if c is not y and _is_given_out(c, goal)]
    if y is None or len(given_out) != 1:
        return None
    (u,) = given_out
    why.append(
        f"column {goal.name!r} is the set point of a controller by its name, and {y.name!r} follows it: {u.name!r} is "
        f"taken for what the controller gives the plant, its input, and {y.name!r} for the plant's output (for the "
        f"loop as a whole: --input {goal.name!r} --output {y.name!r})"
    )
    return {"input": u, "output": y}


def _answer(others: list[Column], goal: Column) -> Column | None:
    """The column in the unit of the set point that comes closer to it than to its own mean before each change, and
    closer than any other such column does by more than chance (F test); None if none does.
    """
    changes = np.flatnonzero(np.diff(goal.values))
    errors = list[tuple[float, int]]()
    for k, column in enumerate(others):
        ends = changes[np.isfinite(column.values[changes]) & np.isfinite(goal.values[changes])]
        if len(ends) < _FEWEST or (column.header.unit and goal.header.unit not in ("", column.header.unit)):
            continue
        error, own = column.values[ends] - goal.values[ends], column.values[ends]
        if np.mean(error**2) < np.var(own):
            errors.append((float(np.mean(error**2)), k))
    errors.sort()
    if not errors:
        return None
    from scipy.special import fdtri

    by_chance = fdtri(len(changes), len(changes), 1.0 - _LEVEL)
    return others[errors[0][1]] if all(e > by_chance * errors[0][0] for e, _ in errors[1:]) else None


def _is_given_out(column: Column, goal: Column) -> bool:
    """Whether a column may be what a controller gives out: by its name, or where that says nothing, by its jumps.

    Beside the goal of a servo, an angle, the name has to say so: it reports its load and its current, which jump too.
    """
    role = role_by_name(column)
    if column.nearly_constant or role == "none":
        return False
    if role in ("input", "both") or column.header.has(_GIVEN_OUT):
        return True
    return role == "" and convert(goal.header.unit).unit != "rad" and _jumps_with(column, goal)


def _jumps_with(column: Column, goal: Column) -> bool:
    """Whether a column answers at once where the set point changes: their jumps are correlated."""
    from scipy.special import stdtr

    at = np.flatnonzero(np.diff(goal.values))
    at = at[at + _LATER < len(column.values)]
    jumps = np.column_stack([column.values[at + _LATER] - column.values[at], goal.values[at + 1] - goal.values[at]])
    jumps = jumps[np.isfinite(jumps).all(axis=1)]
    if len(jumps) < _FEWEST or np.any(np.ptp(jumps, axis=0) == 0.0):
        return False
    n, r = len(jumps), abs(float(np.corrcoef(jumps.T)[0, 1]))
    t = r * np.sqrt((n - 2) / max(1.0 - r**2, 1e-12))
    return bool(2.0 * stdtr(n - 2, -t) < _LEVEL)


def note_on_controller(roles: Mapping[str, Column | None], signals: Columns) -> list[str]:
    """What is asked where a set point stands beside columns that may be those of its controller."""
    chosen = [column for column in roles.values() if column is not None]
    set_points = [column for column in signals.values() if is_set_point(column)]
    left = [c for c in signals.values() if not any(c is each for each in (*chosen, *set_points)) and not c.constant]
    as_loop = [column.name.lower() for column in chosen] == ["input", "output"]
    as_plant = len(chosen) == 2 and is_set_point(chosen[0]) and chosen[1].header.words <= _GIVEN_OUT
    if not set_points or not (as_loop or (as_plant and left)):
        return []
    shown = dict.fromkeys(repr(c.name) for c in (set_points[0], *chosen, *left[: not as_loop]))
    *first, last = shown
    return [
        f"columns {', '.join(first)} and {last} may be a controller's, whose input is the output "
        "of the plant; name the input of the plant with --input and its output with --output"
    ]
