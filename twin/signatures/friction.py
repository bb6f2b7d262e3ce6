"""Dry and viscous friction: the map of friction over speed, its parts, and the stick-slip limit cycle."""

import math

import numpy as np

from twin.hardware.actuator import Motor, motor
from twin.hardware.potentiometer import potentiometer
from twin.imperfections import Axis, Line, Mark, Signature, Size, Trial, holds, line_fit, steady_speeds
from twin.parameters import Parameters
from twin.plant.stepping import TIMESTEP
from twin.signatures.lab import lag, pair
from twin.truth import truth

SPEED, TORQUE = Axis("speed", "rad/s"), Axis("friction", "N m")


def friction(p: Parameters) -> Signature:
    """Torque of steady motion over its speed, from the motor: K (V - K w) / R at the joint."""
    Ts = 0.01
    n = _settling_samples(p, Ts)
    levels = np.array([3.0, 5.0, 7.0, 9.0, 11.0]) * p["supply_voltage"] / 12.0
    u = holds(np.concatenate([levels, -levels]), n)
    run, base = pair("friction", (), p, "shoulder", u, Ts)
    maps = [_torque_map(trial, n, motor(p, "shoulder")) for trial in (run, base)]
    (level, slope), (base_level, base_slope) = (_level_and_slope(*m) for m in maps)
    speed, torque = maps[0]
    lines = [Line(*maps[1], on=False, dots=True), Line(*maps[1], on=False), Line(speed, torque, dots=True)]
    for way in (1, -1):
        side = speed * way > 0
        x = np.append(0.0, speed[side])
        lines.append(Line(x, way * level + slope * x))
    dry = p["shoulder.coulomb"] + p["shoulder.bearing_coulomb"]
    viscous = p["shoulder.viscous"] + p["shoulder.bearing_viscous"]
    rows = ("shoulder.coulomb", "shoulder.bearing_coulomb")
    return Signature(
        "friction",
        "Coulomb and viscous friction",
        "shoulder",
        SPEED,
        TORQUE,
        tuple(lines),
        (Mark((0.0, 0.0), (0.0, level), dry, "N m", "dry {}", "left"),),
        (
            Size("dry friction of gear and bearing", (level, base_level), dry, "N m", rows),
            Size(
                "viscous friction of gear and bearing",
                (slope, base_slope),
                viscous,
                "N m s/rad",
                tuple(row.replace("coulomb", "viscous") for row in rows),
            ),
        ),
        "The torque of steady motion jumps with the direction and grows slightly with the speed.",
    )


def asymmetry(p: Parameters) -> Signature:
    """Drift under a symmetric square wave, and the difference of friction from the two steady speeds."""
    Ts, periods = 0.01, 4
    n = _settling_samples(p, Ts)
    volts = 0.5 * p["supply_voltage"]
    u = holds(np.tile([volts, -volts], periods), n)
    run, base = pair("asymmetry", ("friction",), p, "shoulder", u, Ts)
    constants = motor(p, "shoulder")
    damping = constants.damping + p["shoulder.viscous"] + p["shoulder.bearing_viscous"]
    differences = []
    for trial in (run, base):
        speeds = steady_speeds(trial, n, 20)
        differences.append(-damping * float(np.mean(speeds[2::2] + speeds[3::2])))  # torque = K V / R - damping w
    true = 2 * p["shoulder.asymmetry"] * p["shoulder.coulomb"]
    top = [n, (2 * periods - 1) * n]  # where the first and the last rise end
    end = run.t[top[1]]
    return Signature(
        "asymmetry",
        "Direction-dependent friction",
        "shoulder",
        Axis("time", "s"),
        Axis("angle", "rad"),
        (Line(base.t, base.angle, on=False), Line(run.t, run.angle)),
        (Mark((end, run.angle[top[1]]), (end, run.angle[top[0]]), true, "N m", "drift for\n{} more up", "above"),),
        (
            Size(
                "friction up minus friction down",
                differences,
                true,
                "N m",
                ("shoulder.asymmetry", "shoulder.coulomb"),
            ),
        ),
        "The voltage is symmetric, but the joint drifts in the direction of lower friction.",
    )


def stribeck(p: Parameters) -> Signature:
    """Friction at low speed on a slow voltage ramp: motor torque minus the torque that accelerates the rotor.

    The board reads commands every millisecond here, so that the ramp is smooth.
    """
    p = p.replace({"switch_period": TIMESTEP})
    Ts, seconds, span = 0.002, 40.0, 5  # speed is that over `span` samples
    constants = motor(p, "shoulder")
    dry = p["shoulder.coulomb"] + p["shoulder.bearing_coulomb"]
    extra, fade = p["shoulder.stribeck"] * p["shoulder.coulomb"], p["shoulder.stribeck_speed"]
    top = (dry + extra + 6 * fade * constants.damping) / constants.force_per_volt
    u = np.linspace(0.5 * dry / constants.force_per_volt, top, round(seconds / Ts))
    losses = constants.damping + p["shoulder.viscous"] + p["shoulder.bearing_viscous"]
    inertia = -losses / truth("shoulder", parameters=p).continuous_pole
    curves, sizes = [], []
    for trial in pair("stribeck", ("friction",), p, "shoulder", u, Ts):
        speed = (trial.angle[2 * span :] - trial.angle[: -2 * span]) / (2 * span * Ts)
        volts = trial.volts[span + 1 : 1 - span]
        torque = constants.force_per_volt * volts - constants.damping * speed - inertia * np.gradient(speed, Ts)
        moving = speed > 0.02 * fade
        slope, level = line_fit(*(v[speed > 3 * fade] for v in (speed, torque)))
        speed, torque = speed[moving], torque[moving]
        excess = torque - level - slope * speed
        curves.append((speed, torque))
        sizes.append((float(excess[0]) if len(excess) else np.nan, _speed_at(extra / math.e, speed, excess), level))
    (at_rest, speed_e, level), (base, _, _) = sizes
    return Signature(
        "stribeck",
        "Stribeck: more friction at low speed",
        "shoulder",
        SPEED,
        TORQUE,
        (Line(*curves[1], on=False), Line(*curves[0])),
        (Mark((0.0, level), (0.0, level + at_rest), extra, "N m", "{} more at rest", "corner"),),
        (
            Size("static friction above Coulomb friction", (at_rest, base), extra, "N m", _rows("stribeck", "coulomb")),
            Size("speed at which 1/e of it remains", (speed_e, np.nan), fade, "rad/s", _rows("stribeck_speed")),
        ),
        "Friction is highest at rest, falls at low speed, and then grows with the speed.",
    )


def _speed_at(value: float, speed: np.ndarray, excess: np.ndarray) -> float:
    """Speed at which the falling curve passes `value`; nan if it does not."""
    if len(excess) == 0 or not 0.0 < value < excess[0]:
        return np.nan
    k = int(np.argmax(excess < value))
    return float(np.interp(-value, -excess[k - 1 : k + 1], speed[k - 1 : k + 1]))


HUNTING = {"shoulder.servo_kp": 30.0, "shoulder.servo_ki": 150.0, "shoulder.stribeck": 1.0}


def hunting(p: Parameters) -> Signature:
    """Stick-slip: the integrator of a position loop winds up until the joint breaks away and overshoots.

    Armstrong-Helouvry, Dupont and Canudas de Wit, A survey of models, analysis tools and compensation methods for the
    control of machines with friction, Automatica 30, 1994, section 4.
    """
    Ts, seconds, reference = 0.01, 40.0, np.deg2rad(5.0)
    p = p.replace(HUNTING)
    u = np.full(round(seconds / Ts), reference * potentiometer(p).scale)
    run, base = pair("stribeck", ("friction",), p, "shoulder", u, Ts, mode="servo")
    force_per_volt = motor(p, "shoulder").force_per_volt
    forces = [force_per_volt * _breaking_voltage(trial) for trial in (run, base)]
    static = p["shoulder.coulomb"] * (1 + p["shoulder.stribeck"]) + p["shoulder.bearing_coulomb"]
    second_half = run.angle[len(u) // 2 :]
    lowest, highest = float(second_half.min()), float(second_half.max())
    place = 1.03 * float(run.t[-1])
    return Signature(
        "stribeck",
        "Stick-slip under integral action",
        "shoulder",
        Axis("time", "s"),
        Axis("angle", "rad"),
        (Line(base.t, base.angle, on=False), Line(run.t, run.angle)),
        (Mark((place, lowest), (place, highest), static, "N m", "sticks up\nto {}", "outside"),),
        (Size("break-away friction at each slip", forces, static, "N m", _rows("coulomb", "stribeck")),),
        "With an integral gain and static friction twice the Coulomb friction the joint never comes to rest at its "
        "reference: it sticks, the integrator winds up, and it slips past. Without the Stribeck part it settles.",
        variant="hunting",
    )


def _breaking_voltage(trial: Trial) -> float:
    """Mean absolute motor voltage [V] at break-away in the second half; nan if the joint stays at rest."""
    rest, slip = 20, 10  # samples that it stands before, and looks ahead after
    is_still = np.abs(np.diff(trial.angle)) < 1e-6
    starts = [
        k
        for k in range(max(len(is_still) // 2, rest), len(is_still) - slip)
        if not is_still[k] and is_still[k - rest : k].all() and abs(trial.angle[k + slip] - trial.angle[k]) > 1e-3
    ]
    return float(np.mean(np.abs(trial.volts[starts]))) if starts else np.nan


def _settling_samples(p: Parameters, Ts: float) -> int:
    """Samples until the new speed is reached, and 20 more to measure it."""
    return round(16 * lag(p, "shoulder") / Ts) + 20


def _rows(*names: str) -> tuple[str, ...]:
    return tuple(f"shoulder.{name}" for name in names)


def _torque_map(trial: Trial, n: int, constants: Motor) -> tuple[np.ndarray, np.ndarray]:
    """Steady speed [rad/s] and its torque [N m] for every hold except the first, in the order of speed."""
    speed = steady_speeds(trial, n, 20)
    torque = constants.force_per_volt * trial.u[n - 1 :: n] - constants.damping * speed
    order = np.argsort(speed)
    return speed[order], torque[order]


def _level_and_slope(speed: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """Half the jump at speed 0, and the mean slope of the two lines."""
    fits = [line_fit(speed[speed * way > 0], torque[speed * way > 0]) for way in (1, -1)]
    return 0.5 * (fits[0][1] - fits[1][1]), 0.5 * (fits[0][0] + fits[1][0])
