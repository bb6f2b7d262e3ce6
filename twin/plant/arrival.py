"""Where a drive comes to rest at its ends: the limit switch trips, the shorted motor brakes, the drive coasts on."""

from functools import lru_cache

import numpy as np

from twin.hardware.drive import drive
from twin.hardware.linkage import linkage, stroke
from twin.parameters import Parameters
from twin.plant import slots
from twin.plant.board import circuit, user_data
from twin.plant.leg import BENCH_LEG, bench
from twin.plant.stepping import Run, attempt

RUN_UP = 0.15  # of the stroke before the switch, from which the drive starts at rest
FASTEST = 0.2  # [s] least time for the way to the switch
PATIENCE = 5.0  # times of the way at no-load speed until the drive must have arrived
ALONE = ("backlash", "noise", "adc", "nonlinearity", "jitter", "dropouts", "delay", "contact")


def switch_angles(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Joint angles [rad] at which the limit switches disconnect the motor, never outside the stroke's ends."""
    low, high = stroke(parameters, joint)
    board = drive(parameters, joint)
    at = max(board.lower, low), min(board.upper, high)
    if joint == "shoulder":
        return at
    triangle = linkage(parameters, joint)
    return triangle.angle(at[0]), triangle.angle(at[1])


def rest_angles(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Joint angles [rad] at which the drive rests after it ran into each end at full supply voltage.

    The backlash is centred. Between switch and hard stop this depends on the speed of arrival: a slower drive rests
    closer to the switch. Where full voltage does not bring the drive to a switch, the angle is the switch's.
    """
    return _rest_angles(joint, tuple(parameters.values.items()))


@lru_cache(maxsize=256)
def _rest_angles(joint: str, rows: tuple[tuple[str, float], ...]) -> tuple[float, float]:
    p = Parameters(dict(rows))
    model, board = bench(joint, p, ALONE), circuit(p, joint, ALONE)
    h, found = model.opt.timestep, []
    for way, switch in zip((-1.0, 1.0), switch_angles(p, joint), strict=True):
        start = switch - way * RUN_UP * float(np.ptp(switch_angles(p, joint)))
        fastest = max(abs(switch - start) / _top_speed(p, joint, switch), FASTEST)
        N = round(PATIENCE * fastest / h)
        qpos = np.zeros(model.nq)
        qpos[model.joint(joint + BENCH_LEG).qposadr[0]] = start
        volts = np.full((N, 1), way * p["supply_voltage"])
        run = Run(model, user_data(model, [board]), qpos, volts, volts[0] * 0.0, 0.0, np.zeros(N))
        shown, _ = attempt([run], h, 0.0)  # nan where MuJoCo gave up: then it has not arrived
        last = float(shown[0, -1, 0, slots.ANGLE])
        found.append(last if way * (last - switch) > 0.0 else switch)
    return found[0], found[1]


def _top_speed(p: Parameters, joint: str, angle: float) -> float:
    """Speed [rad/s] at full supply voltage without any friction."""
    speed = p[f"{joint}.no_load_speed"] * p["supply_voltage"] / p[f"{joint}.rated_voltage"]
    return speed if joint == "shoulder" else speed / abs(linkage(p, joint).arm(angle))
