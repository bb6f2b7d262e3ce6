"""Short names and groups of the values and parts of an actuated joint, for figures with little room."""

from collections.abc import Sequence

from sysid.base.units import shown
from sysid.joint.growth import Growth
from sysid.joint.values import JointValue
from sysid.plots.earned import Bar
from sysid.report.sections import told_once

PARTS = {
    "stribeck": "Stribeck",
    "sticks": "Stribeck by direction",
    "sided": "stick by direction",
    "loss": "screw's loss",
    "jams": "jam at stops",
    "screw": "loss and jam",
    "plays": "play",
    "coasts": "coasting play",
    "turns": "load by turns",
    "sags": "sagging supply",
}
SHORT = {
    "speed_per_volt": "speed",
    "speed_full_drive": "speed",
    "breakaway_up": "break-away up",
    "breakaway_down": "break-away down",
    "coulomb_up": "moving up",
    "coulomb_down": "moving down",
    "moving_friction_up": "moving up",
    "moving_friction_down": "moving down",
    "end_low": "lower end",
    "end_high": "upper end",
    "time_constant": "time constant",
    "lag_and_delay": "lag + delay",
}


def short(value: JointValue) -> str:
    """A name that fits beside a bar."""
    return SHORT.get(value.name, value.name.replace("_", " "))


def bars(growth: Growth) -> list[list[Bar]]:
    """Every part that was tried, round by round."""
    found: list[list[Bar]] = [[] for _ in range(1 + max(s.round for s in growth.steps))]
    for s in growth.steps:
        found[s.round].append((PARTS[s.part], s.earned, s.kept, growth.stayed(s)))
    return found


def hatched(growth: Growth) -> str:
    """What the figure of `bars` says of parts that were kept and dropped; empty if none was."""
    return " A hatched bar is a part that the final joint does without." if growth.dropped else ""


def groups(values: Sequence[JointValue]) -> dict[tuple[str, bool], list[JointValue]]:
    """The values that share an axis, by unit; a backlash, a hundredth of the way between the ends, has its own."""
    found: dict[tuple[str, bool], list[JointValue]] = {}
    for v in told_once(values):
        found.setdefault((shown(v.name, v.unit).unit, v.name == "backlash"), []).append(v)
    return found
