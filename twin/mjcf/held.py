"""Joints that are held while others are logged: where, by a column of the log or by the model's first pose."""

import re
from collections.abc import Mapping

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, number
from sysid.channels.column import numbers, parse_header
from sysid.channels.conversion import convert
from sysid.formats import read_table
from twin.mjcf.robot import Robot

WORDS = {"angle", "position", "pos", "q"}  # beside the joint's name in that of a column
STILL = 0.05  # [rad or m] within which a joint is held


def _words(name: str) -> set[str]:
    return set(re.split(r"[\W_]+", name.lower())) - {""}


def posture(path: str, robot: Robot) -> dict[str, float]:
    """The angles [rad or m] of the robot's held joints that have a column in the log, "knee angle [deg]" or alike.

    Raises InputError where such a joint moves.
    """
    if not robot.held:
        return {}
    table, model, out = read_table(path), robot.model, dict[str, float]()
    for name, (_, unit) in robot.postures.items():
        movers = [model.actuator(k).name for k in np.flatnonzero(model.actuator_trnid[:, 0] == model.joint(name).id)]
        names = WORDS.union(*map(_words, movers))
        for column in table.names:
            head = parse_header(column, table.units.get(column, ""))
            words, conversion = _words(column) - {head.mapped_unit.lower()}, convert(head.mapped_unit)
            if not _words(name) <= words <= names | _words(name) or conversion.unit not in ("", unit):
                continue
            angles = conversion.factor * numbers(table, column, "", True)
            low, middle, high = np.nanquantile(angles, (0.01, 0.5, 0.99))
            if high - low > STILL:
                q = display_quantity("", unit)
                raise InputError(
                    f"{path}: the joint {name!r} moves by {number(q.factor * (high - low), 3)} {q.unit} (column "
                    f"{column!r}), and is held in the simulation; name its actuator with --actuator too"
                )
            out[name] = float(middle)
    return out


def held_sentences(robot: Robot, log: str, posture: Mapping[str, float]) -> list[str]:
    """Which joints were held in the simulation of the log of this name, and at which angle."""
    texts = []
    for name, (place, unit) in robot.postures.items():
        q, known = display_quantity("", unit), name in posture
        value = posture[name] if known else float(robot.model.qpos0[place])
        texts.append(f"{name} at {number(q.factor * value, 3)} {q.unit}{'' if known else ' *'}")
    if not texts:
        return []
    guess = all(name in posture for name in robot.postures)
    why = "" if guess else f' (* as in {robot.path.name}; a column such as "JOINT angle [deg]" says where it was)'
    return [f"{log}: joints of actuators that are not named were held: {', '.join(texts)}{why}."]
