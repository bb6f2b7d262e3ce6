"""What is known of a joint beside its record: its friction, its screw and its link have usual sizes.

Each prior is normal, with a centre and a standard deviation in quantities of the joint: volts by its dry friction,
speeds by its fastest, angles by its way from end to end, times in seconds or by its response. A parameter that cannot
be negative keeps its bound at 0.
"""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Linkage, Motor, Play, ServoMotor, Travel, TravelMap
from sysid.blocks.linkage import SHAPE
from sysid.data.record import IOData
from sysid.data.wraps import DEGREES, turn_of
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.objective import Objective
from sysid.estimation.prior import Prior
from sysid.joint.physics import travel_of
from sysid.model.chain import Chain
from sysid.motor_parts import TABLE, Known

T = TypeVar("T")


# Break-away takes 1 to 1.6 times the friction in motion, and the Stribeck curve falls within a few percent of the speed
# (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30, sections 2 and 5). Screws without balls lose 0.25
# to 4 times what they pass on (efficiencies of 20 to 80 %). A uniform link of length L falls with 1.5 g / L: 74 rad/s^2
# at 0.2 m, a way a radian long; a bearing holds it against a share of that. A record shows the lag and the delay of a
# joint together far better than either: the plain joint gives their sum, 0.1 s at the least, for geared motors of this
# size have time constants of some 10 ms, buses and filters delays of as much. Backlash is within 1 % of the way on most
# gears. A supply's resistance is a fifth of the motor's and less. What a joint's bearing holds is a part of the drive's
# friction, and a linkage is off its triangle by a few thousandths of the way, in long waves more than in short ones.
KNOWN: dict[type, dict[str, Known]] = {
    Motor: {
        "lag": Known(0.5, 0.5, "response"),
        "delay": Known(0.5, 0.5, "response"),
        "stick": Known(0.2, 0.2, "friction"),
        "stick_down": Known(0.2, 0.2, "friction"),
        "stick_speed": Known(0.05, 0.025, "speed"),
        "load0": Known(0.0, 0.5, "friction"),
        "bearing": Known(0.0, 0.3, "friction"),
        "loss": Known(0.2, 0.3, "one"),
        "jam": Known(0.0, 0.3, "time by speed"),
        **{f"{wave}{k}": Known(0.0, 2.0, "friction") for wave in ("sine", "cosine") for k in (1, 2)},
    },
    ServoMotor: {"sag": Known(0.0, 0.2, "one"), "dead": Known(0.0, 0.01, "angle")},
    Linkage: {"stroke": Known(0.0, 0.5, "one"), **{f"d{k}": Known(0.0, 1.0 / k**2, "bend") for k in range(1, 8)}},
    Play: {"width": Known(0.0, 0.015, "angle")},
    CoastingPlay: {
        "width": Known(0.0, 0.015, "angle"),
        "drag": Known(0.0, 50.0, "angle by time squared"),
        "pull0": Known(0.0, 70.0, "angle by time squared"),
        "pull1": Known(0.0, 70.0, "one by time squared"),
    },
}
# Differences: friction by direction, and how far a point of the linkage is from the middle of its neighbours.
# Drawn linkages of the twin are off by 0.003 to 0.006 of the way, by 0.016 beside the end that is near a dead centre.
_SIDED_STICK, _SIDED, _BENT, _BENT_AT_ENDS = 0.1, 0.3, 0.005, 0.015
# Enclosed angles of a triangle [rad]: their middle, and how far they swing. Levers work about the perpendicular.
_MIDDLE, _SWING = (0.5 * np.pi, 0.4), (1.4, 0.7)
BENDS, LOOSE = 4, 7  # waves of what a linkage is off the triangle by, and of one that is none: a cam, four bars
_OFF_TRIANGLE, _OFF_LOOSE = 0.003, 0.1  # of the way, the size of the longest wave of either
_OFF_SLOPE = 0.1  # rad by which the enclosed angle swings more or less: a potentiometer of 5 % over 2 rad
_TIED = 1e-3  # by which the shape of a lever may differ from that of its linkage
_LEAST_RESPONSE = 0.1  # s
_LEAST_FRICTION = 0.02  # of the largest input: a motor without friction leaves no scale for its parts


def units_of(chain: Chain, theta: np.ndarray, data: IOData) -> dict[str, float]:
    """Size of each unit of `KNOWN` in the chain's own: samples, volts, and the places of motor and link."""
    motor, travel = motor_of(chain), travel_of(chain)
    part = chain.part(theta, motor)
    # A servo's input is a goal.
    largest = motor.value(part, "limit") if isinstance(motor, ServoMotor) else float(np.abs(data.u).max())
    friction = 0.5 * (motor.value(part, "rise") + motor.value(part, "fall"))
    friction = max(friction, _LEAST_FRICTION * largest)
    way = float(np.ptp(data.y[data.observed[:, 0], 0]))
    least = 1e-9 * (way if travel is None else 1.0)  # a sample, of a motor that does not move
    speed = max(motor.value(part, "gain") * max(largest - friction, 0.1 * largest), least)
    second = 1.0 / data.Ts
    return {
        "one": 1.0,
        "one by voltage squared": 1.0 / largest**2,
        "time": second,
        "response": max(_LEAST_RESPONSE * second, motor.value(part, "lag") + motor.value(part, "delay")),
        "friction": friction,
        "friction by speed squared": friction / speed**2,
        "speed": speed,
        "time by speed": second / speed,
        "angle": way,
        "angle by time squared": way / second**2,
        "one by time squared": 1.0 / second**2,
        **_radian(travel, chain, theta, data),
    }


def _radian(travel: Travel | None, chain: Chain, theta: np.ndarray, data: IOData) -> dict[str, float]:
    """Of an output that is an angle, the size of a radian; negative where the output falls as the angle opens."""
    if travel is None or data.y_unit not in ("rad", *DEGREES):
        return {}
    low, high = chain.part(theta, travel)[:2]
    return {"radian": float(np.copysign(turn_of(data) / (2.0 * np.pi), high - low))}


def joint_prior(chain: Chain, units: dict[str, float], level: float) -> Prior:
    """The prior of a joint's parameters, in the units that a joint gives it, for noise of deviation `level` [y]."""
    role = motor_of(chain).role
    rows: list[dict[str, float]] = []
    target, spread = list[float](), list[float]()

    def know(row: dict[str, float], centre: float, deviation: float) -> None:
        if all(name in chain.names for name in row):
            rows.append(row)
            target.append(centre)
            spread.append(deviation)

    for name, (centre, deviation) in usual_values(chain, units).items():
        know({name: 1.0}, centre, deviation)
    know({f"{role}.stick": 1.0, f"{role}.stick_down": -1.0}, 0.0, _SIDED_STICK * units["friction"])
    know({f"{role}.rise": 1.0, f"{role}.fall": -1.0}, 0.0, _SIDED * units["friction"])
    travel = travel_of(chain)
    if isinstance(travel, Linkage):
        ends = [f"{travel.role}.{name}" for name in ("angle0", "angle1")]
        know(dict.fromkeys(ends, 0.5), *_MIDDLE)
        swing = dict(zip(ends, (-1.0, 1.0), strict=True))
        if "radian" in units:
            turned = {f"{travel.role}.{name}": way / units["radian"] for name, way in (("low", 1.0), ("high", -1.0))}
            know({**swing, **turned}, 0.0, _OFF_SLOPE)
        else:
            know(swing, *_SWING)
        for name in SHAPE:  # a lever is the linkage of its joint
            know({f"{role}.{name}": 1.0, f"{travel.role}.{name}": -1.0}, 0.0, _TIED)
    if isinstance(travel, TravelMap):
        for i in range(1, travel.knots - 1):
            neighbours = {f"{travel.role}.s{k}": -0.5 for k in (i - 1, i + 1) if 0 < k < travel.knots - 1}
            spread_here = _BENT_AT_ENDS if i in (1, travel.knots - 2) else _BENT
            know({f"{travel.role}.s{i}": 1.0, **neighbours}, 0.5 * (i + 2 == travel.knots), spread_here)
    matrix = np.array([[row.get(name, 0.0) for name in chain.names] for row in rows]).reshape(-1, len(chain.names))
    return Prior(matrix, np.array(target), level / np.array(spread), chosen=True)


def joint_objective(chain: Chain, units: dict[str, float], level: float) -> Objective:
    """Least squares under that prior."""
    return Objective(curvature_weight=0.0, prior=joint_prior(chain, units, level))


def known_of(block: Block, name: str, table: Mapping[type, Mapping[str, T]]) -> T | None:
    """The entry of a block's parameter in a table by class and name; of a class that it derives from, too."""
    return next((rows[name] for kind, rows in table.items() if isinstance(block, kind) and name in rows), None)


def usual_values(chain: Chain, units: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Centre and deviation of each free parameter by its name, in the chain's units."""
    values, travel = {}, travel_of(chain)
    loose = isinstance(travel, Linkage) and travel.bends > BENDS
    units = {**units, "bend": _OFF_LOOSE if loose else _OFF_TRIANGLE}
    for block in chain.blocks:
        for slot in block.slots():
            name = f"{block.role}.{slot.name}"
            known = known_of(block, slot.name, KNOWN)
            if isinstance(block, Motor):
                known = next((TABLE[p].known[slot.name] for p in block.further if slot.name in TABLE[p].known), known)
            if known is not None and name not in chain.fixed:
                values[name] = (known.centre * units[known.of], known.spread * units[known.of])
    return values
