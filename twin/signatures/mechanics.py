"""Signatures of the mechanics: load, end stops, backlash, weight and the floor."""

import numpy as np

from twin.experiment import SETTLE
from twin.hardware.actuator import motor
from twin.hardware.linkage import end_angles, middle
from twin.hardware.potentiometer import potentiometer
from twin.imperfections import Axis, Line, Mark, Signature, Size, Trial, line_fit
from twin.parameters import Parameters
from twin.plant.leg import robot
from twin.robot.kinematics import body
from twin.signatures.lab import lag, pair
from twin.truth import arm, truth

SLOWEST = 0.002  # [m/s] of a rod that is waited for
TIME, ANGLE = Axis("time", "s"), Axis("angle", "rad")
FEET = (0.05, 0.3, 0.6)  # [kg] masses of the foot that load the thigh


def load_friction(p: Parameters) -> Signature:
    """Break-away voltage of the thigh up and down on a slow ramp, for increasing mass at the foot.

    With friction that grows with the load W, half the difference of the two forces is Coulomb + load_friction |W|.
    Coulomb friction is raised so that it holds the heaviest load with load_friction switched off.
    """
    joint, Ts, rate = "thigh", 0.01, 0.5
    constants = motor(p, joint)
    loads = [p.replace({"foot_mass": mass}) for mass in FEET]
    weights = [abs(truth(joint, parameters=parameters).load) for parameters in loads]
    holding = {f"{joint}.coulomb": max(p[f"{joint}.coulomb"], 1.1 * max(weights))}
    starts: dict[bool, list] = {True: [], False: []}
    u = np.arange(0.0, p["supply_voltage"], rate * Ts)
    for parameters in (loads[k].replace(holding) for k in range(len(FEET))):
        pairs = [pair("load_friction", ("friction", "gravity"), parameters, joint, way * u, Ts) for way in (-1, 1)]
        for is_on, trials in zip((True, False), zip(*pairs, strict=True), strict=True):
            starts[is_on].append([constants.force_per_volt * _starting_voltage(trial) for trial in trials])
    weight = np.array(weights)
    forces = {is_on: np.array(rows) for is_on, rows in starts.items()}
    name = f"{joint}.load_friction"
    slope, base_slope = (line_fit(weight, 0.5 * np.diff(forces[is_on])[:, 0])[0] for is_on in (True, False))
    lines = [
        Line(weight, forces[is_on][:, way], on=is_on, dots=dots)
        for is_on in (False, True)
        for way in (0, 1)
        for dots in (False, True)
    ]
    last = float(weight[-1])
    return Signature(
        "load_friction",
        "Friction that grows with the load",
        joint,
        Axis("weight at the rod", "N"),
        Axis("force that starts it", "N"),
        tuple(lines),
        tuple(
            Mark((last, forces[False][-1, way]), (last, forces[True][-1, way]), p[name], "", "{} × load", "left")
            for way in (0, 1)
        ),
        (Size("friction per load", (slope, base_slope), p[name], "1", (name,)),),
        "The difference of the break-away forces up and down grows with the load. Above 1 the motor must also push "
        "in the direction of the weight: the screw is self-locking.",
    )


def _starting_voltage(trial: Trial) -> float:
    """Voltage [V] of a ramp at which motion starts; the angle then grows as the square of the excess voltage."""
    travel = np.abs(trial.angle - trial.angle[0])
    first = int(np.argmax(travel > np.deg2rad(0.05)))
    last = int(np.argmax(travel > np.deg2rad(0.5)))
    if last == 0:
        return np.nan
    slope, offset = line_fit(trial.u[first:last], np.sqrt(travel[first:last]))
    return -offset / slope


def end_stops(p: Parameters) -> Signature:
    """The shank at full voltage up, down and up: it rests at the ends of the actuator's stroke."""
    joint, Ts = "shank", 0.02
    volts = p["supply_voltage"]
    constants = motor(p, joint)
    dry = p[f"{joint}.coulomb"] + p[f"{joint}.bearing_coulomb"] / arm(joint, p)
    speed = (constants.force_per_volt * volts - dry) / (constants.damping + p[f"{joint}.viscous"])
    n = round(0.68 * p[f"{joint}.stroke"] / max(speed, SLOWEST) / Ts)
    u = np.repeat([volts, -volts, -volts, volts], n)
    run, base = pair("end_stops", ("friction",), p, joint, u, Ts)
    places = [n, 3 * n]  # where the voltage turns round
    low, high = end_angles(p, joint)
    sizes = [
        Size(name, (_rest(run, k), _rest(base, k)), true, "rad", (f"{joint}.retracted_length", *rows))
        for name, k, true, rows in (
            ("upper end", places[0], high, (f"{joint}.stroke",)),
            ("lower end", places[1], low, ()),
        )
    ]
    place = float(run.t[2 * n])
    return Signature(
        "end_stops",
        "End stops",
        joint,
        TIME,
        ANGLE,
        (Line(base.t, base.angle, on=False), Line(run.t, run.angle)),
        (Mark((place, low), (place, high), high - low, "rad", "{}"),),
        tuple(sizes),
        "At an end the limit switch disconnects the motor, and the joint rests until the voltage reverses.",
    )


def _rest(trial: Trial, k: int) -> float:
    """Angle [rad] at sample k, if the joint moved and then rested for 0.1 s; else nan."""
    is_rest = abs(trial.angle[k] - trial.angle[k - 5]) < 1e-5 and abs(trial.angle[k] - trial.angle[0]) > 1e-3
    return float(trial.angle[k]) if is_rest else np.nan


def backlash(p: Parameters) -> Signature:
    """Link over drive while a position loop on the drive side moves the joint slowly to and fro."""
    joint, Ts, period, repeats = "shoulder", 0.01, 8.0, 2
    dry, pot = p[f"{joint}.coulomb"] + p[f"{joint}.bearing_coulomb"], potentiometer(p)
    loop_error = dry / (motor(p, joint).force_per_volt * max(p[f"{joint}.servo_kp"], 1.0) * pot.scale)
    swing = 3 * p[f"{joint}.backlash"] + loop_error
    t = np.arange(round(repeats * period / Ts)) * Ts
    triangle = swing * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t / period))
    u = triangle * pot.scale
    run, base = pair("backlash", ("friction",), p, joint, u, Ts, mode="servo", pot_side="drive")
    turn = round(period / Ts / 4)  # the first quarter of a period leads into the loop
    widths = [_loop_width(trial.reading[turn:], trial.angle[turn:]) for trial in (run, base)]
    true = p[f"{joint}.backlash"]
    drive_center, link_center = (0.5 * float(v[turn:].max() + v[turn:].min()) for v in (run.reading, run.angle))
    return Signature(
        "backlash",
        "Backlash",
        joint,
        Axis("drive side", "rad"),
        Axis("link", "rad"),
        (Line(base.reading[turn:], base.angle[turn:], on=False), Line(run.reading[turn:], run.angle[turn:])),
        (
            Mark(
                (drive_center - widths[0] / 2, link_center),
                (drive_center + widths[0] / 2, link_center),
                true,
                "rad",
                "{}",
                "below",
            ),
        ),
        (Size("width of the loop", widths, true, "rad", (f"{joint}.backlash",)),),
        "After each reversal the drive crosses the backlash while the link rests: the curve is a parallelogram.",
    )


def _loop_width(drive: np.ndarray, link: np.ndarray) -> float:
    """Distance [rad] along the drive axis between the rising and the falling branch at half the height of the loop."""
    half = 0.5 * (link.max() + link.min())
    above = link > half
    crossings = np.flatnonzero(above[1:] != above[:-1])
    share = (half - link[crossings]) / (link[crossings + 1] - link[crossings])
    crossing = drive[crossings] + share * (drive[crossings + 1] - drive[crossings])
    rising = above[crossings + 1]
    if rising.all() or not rising.any():
        return np.nan
    return float(crossing[rising].mean() - crossing[~rising].mean())


def gravity(p: Parameters) -> Signature:
    """The thigh with power off, shorted bridge and no friction: its weight turns the motor against back-EMF."""
    joint, Ts = "thigh", 0.02
    linear_truth, constants = truth(joint, parameters=p), motor(p, joint)
    mid, r = middle(p, joint), arm(joint, p)
    speed = -linear_truth.load / constants.damping / r
    seconds = float(np.clip(np.deg2rad(6.0) / max(abs(speed), 1e-6), 12 * lag(p, joint), 5.0))
    u = np.zeros(round(seconds / Ts))
    # Mid stroke, where the truth is told, lies in the middle of the record, which settles before it begins.
    run, base = pair("gravity", (), p, joint, u, Ts, start=mid - speed * (SETTLE + seconds / 2))
    weights = []
    for trial in (run, base):
        k = int(np.argmin(np.abs(trial.angle - mid)))
        k = min(max(k, 5), len(u) - 6)
        weights.append(abs(constants.damping * r * (trial.angle[k + 5] - trial.angle[k - 5]) / (10 * Ts)))
    end, direction = float(run.t[-1]), float(np.sign(speed))
    descent = direction * float(run.angle[-1] - run.angle[0])
    return Signature(
        "gravity",
        "Weight",
        joint,
        TIME,
        Axis("sunk", "rad"),
        (
            Line(base.t, direction * (base.angle - base.angle[0]), on=False),
            Line(run.t, direction * (run.angle - run.angle[0])),
        ),
        (Mark((end, 0.0), (end, descent), abs(linear_truth.load), "N", "by {}\nat the rod", "left"),),
        (
            Size(
                "weight at the rod, mid stroke",
                weights,
                abs(linear_truth.load),
                "N",
                ("gravity", "thigh_mass", "shank_mass", "foot_mass", "actuator_mass"),
            ),
        ),
        "With power off and without friction the leg sinks slowly, braked by its motor; the thigh angle grows "
        "downwards. With friction the screw holds it.",
    )


def contact(p: Parameters) -> Signature:
    """The thigh moves down until the foot stands on the floor; the bench is lowered for this."""
    joint, Ts, seconds = "thigh", 0.02, 8.0
    robot_body = body(p, robot(p))
    touching = middle(p, joint) + np.deg2rad(6.0)
    height = robot_body.foot_radius - robot_body.leg.foot(np.array([0.0, touching, middle(p, "shank")]))[2]
    low_bench = p.replace({"bench_height": float(np.clip(height, 0.2, 1.0))})
    u = np.full(round(seconds / Ts), 0.35 * p["supply_voltage"])
    run, base = pair("contact", ("friction", "end_stops"), low_bench, joint, u, Ts)
    end, start = float(run.t[-1]), float(run.angle[0])
    floor = end_angles(p, joint)[1] - np.deg2rad(1.0)  # a rest beyond is at the end of the stroke
    stands = [_rest(trial, -1) if trial.angle[-1] < floor else np.nan for trial in (run, base)]
    return Signature(
        "contact",
        "Foot on the floor",
        joint,
        TIME,
        ANGLE,
        (Line(base.t, base.angle, on=False), Line(run.t, run.angle)),
        (Mark((end, start), (end, float(run.angle[-1])), touching - start, "rad", "{} to\nthe floor", "left"),),
        (Size("angle at which the foot stands", stands, touching, "rad", ("bench_height",)),),
        "The foot meets the floor and the joint stops, long before its end stop.",
    )
