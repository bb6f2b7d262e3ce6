"""Signatures of the mechanics: load, end stops, backlash, weight and the floor."""

import numpy as np

from twin.experiment import SETTLE
from twin.hardware.linkage import end_angles, middle
from twin.hardware.motor import motor
from twin.hardware.potentiometer import potentiometer
from twin.parameters import Parameters
from twin.plant.leg import robot
from twin.robot.kinematics import body
from twin.signatures.signature import Axis, Line, Mark, Signature, Size, Trial, lag, line_fit, pair
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
    weights = [abs(truth(joint, parameters=loaded).load) for loaded in loads]
    holding = {f"{joint}.coulomb": max(p[f"{joint}.coulomb"], 1.1 * max(weights))}
    forces: dict[bool, list] = {True: [], False: []}
    u = np.arange(0.0, p["supply_voltage"], rate * Ts)
    for loaded in (loads[k].replace(holding) for k in range(len(FEET))):
        both = [pair("load_friction", ("friction", "gravity"), loaded, joint, way * u, Ts) for way in (-1, 1)]
        for on, seen in zip((True, False), zip(*both, strict=True), strict=True):
            forces[on].append([constants.force_per_volt * _starting_voltage(one) for one in seen])
    weight = np.array(weights)
    started = {on: np.array(found) for on, found in forces.items()}
    slope, slope_off = (line_fit(weight, 0.5 * np.diff(started[on])[:, 0])[0] for on in (True, False))
    lines = [
        Line(weight, started[on][:, way], on=on, dots=dots)
        for on in (False, True)
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
            Mark((last, started[False][-1, way]), (last, started[True][-1, way]), size, "", "{} × load", "left")
            for way, size in ((0, p[f"{joint}.load_friction"]), (1, p[f"{joint}.load_friction"]))
        ),
        (Size("friction per load", (slope, slope_off), p[f"{joint}.load_friction"], "1", (f"{joint}.load_friction",)),),
        "The difference of the break-away forces up and down grows with the load. Above 1 the motor must also push "
        "in the direction of the weight: the screw is self-locking.",
    )


def _starting_voltage(seen: Trial) -> float:
    """Voltage [V] of a ramp at which motion starts; the angle then grows as the square of the excess voltage."""
    moved = np.abs(seen.angle - seen.angle[0])
    first = int(np.argmax(moved > np.deg2rad(0.05)))
    last = int(np.argmax(moved > np.deg2rad(0.5)))
    if last == 0:
        return np.nan
    slope, offset = line_fit(seen.u[first:last], np.sqrt(moved[first:last]))
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
    on, off = pair("end_stops", ("friction",), p, joint, u, Ts)
    places = [n, 3 * n]  # where the voltage turns round
    low, high = end_angles(p, joint)
    sizes = [
        Size(name, (_rest(on, k), _rest(off, k)), true, "rad", (f"{joint}.retracted_length", *rows))
        for name, k, true, rows in (
            ("upper end", places[0], high, (f"{joint}.stroke",)),
            ("lower end", places[1], low, ()),
        )
    ]
    at = float(on.t[2 * n])
    return Signature(
        "end_stops",
        "End stops",
        joint,
        TIME,
        ANGLE,
        (Line(off.t, off.angle, on=False), Line(on.t, on.angle)),
        (Mark((at, low), (at, high), high - low, "rad", "{}"),),
        tuple(sizes),
        "At an end the limit switch disconnects the motor, and the joint rests until the voltage reverses.",
    )


def _rest(seen: Trial, k: int) -> float:
    """Angle [rad] at sample k, if the joint moved and then rested for 0.1 s; else nan."""
    rests = abs(seen.angle[k] - seen.angle[k - 5]) < 1e-5 and abs(seen.angle[k] - seen.angle[0]) > 1e-3
    return float(seen.angle[k]) if rests else np.nan


def backlash(p: Parameters) -> Signature:
    """Link over drive while a position loop on the drive side moves the joint slowly to and fro."""
    joint, Ts, period, repeats = "shoulder", 0.01, 8.0, 2
    dry, pot = p[f"{joint}.coulomb"] + p[f"{joint}.bearing_coulomb"], potentiometer(p)
    stays = dry / (motor(p, joint).force_per_volt * max(p[f"{joint}.servo_kp"], 1.0) * pot.scale)  # the loop's error
    swing = 3 * p[f"{joint}.backlash"] + stays
    t = np.arange(round(repeats * period / Ts)) * Ts
    triangle = swing * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * t / period))
    u = triangle * pot.scale
    on, off = pair("backlash", ("friction",), p, joint, u, Ts, mode="servo", pot_side="drive")
    turn = round(period / Ts / 4)  # the first quarter of a period leads into the loop
    widths = [_loop_width(seen.reading[turn:], seen.angle[turn:]) for seen in (on, off)]
    true = p[f"{joint}.backlash"]
    across, up = (0.5 * float(v[turn:].max() + v[turn:].min()) for v in (on.reading, on.angle))
    return Signature(
        "backlash",
        "Backlash",
        joint,
        Axis("drive side", "rad"),
        Axis("link", "rad"),
        (Line(off.reading[turn:], off.angle[turn:], on=False), Line(on.reading[turn:], on.angle[turn:])),
        (Mark((across - widths[0] / 2, up), (across + widths[0] / 2, up), true, "rad", "{}", "below"),),
        (Size("width of the loop", widths, true, "rad", (f"{joint}.backlash",)),),
        "After each reversal the drive crosses the backlash while the link rests: the curve is a parallelogram.",
    )


def _loop_width(drive: np.ndarray, link: np.ndarray) -> float:
    """Distance [rad] along the drive axis between the rising and the falling branch at half the height of the loop."""
    half = 0.5 * (link.max() + link.min())
    above = link > half
    crossings = np.flatnonzero(above[1:] != above[:-1])
    share = (half - link[crossings]) / (link[crossings + 1] - link[crossings])
    at = drive[crossings] + share * (drive[crossings + 1] - drive[crossings])
    rising = above[crossings + 1]
    if rising.all() or not rising.any():
        return np.nan
    return float(at[rising].mean() - at[~rising].mean())


def gravity(p: Parameters) -> Signature:
    """The thigh with power off, shorted bridge and no friction: its weight turns the motor against back-EMF."""
    joint, Ts = "thigh", 0.02
    known, constants = truth(joint, parameters=p), motor(p, joint)
    around, r = middle(p, joint), arm(joint, p)
    speed = -known.load / constants.damping / r
    seconds = float(np.clip(np.deg2rad(6.0) / max(abs(speed), 1e-6), 12 * lag(p, joint), 5.0))
    u = np.zeros(round(seconds / Ts))
    # Mid stroke, where the truth is told, lies in the middle of the record, which settles before it begins.
    on, off = pair("gravity", (), p, joint, u, Ts, start=around - speed * (SETTLE + seconds / 2))
    found = []
    for seen in (on, off):
        k = int(np.argmin(np.abs(seen.angle - around)))
        k = min(max(k, 5), len(u) - 6)
        found.append(abs(constants.damping * r * (seen.angle[k + 5] - seen.angle[k - 5]) / (10 * Ts)))
    end, way = float(on.t[-1]), float(np.sign(speed))
    sunk = way * float(on.angle[-1] - on.angle[0])
    return Signature(
        "gravity",
        "Weight",
        joint,
        TIME,
        Axis("sunk", "rad"),
        (Line(off.t, way * (off.angle - off.angle[0]), on=False), Line(on.t, way * (on.angle - on.angle[0]))),
        (Mark((end, 0.0), (end, sunk), abs(known.load), "N", "by {}\nat the rod", "left"),),
        (
            Size(
                "weight at the rod, mid stroke",
                found,
                abs(known.load),
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
    leg, radius = _leg(p)
    touching = middle(p, joint) + np.deg2rad(6.0)
    height = radius - leg.foot(np.array([0.0, touching, middle(p, "shank")]))[2]
    low = p.replace({"bench_height": float(np.clip(height, 0.2, 1.0))})
    u = np.full(round(seconds / Ts), 0.35 * p["supply_voltage"])
    on, off = pair("contact", ("friction", "end_stops"), low, joint, u, Ts)
    end, start = float(on.t[-1]), float(on.angle[0])
    floor = end_angles(p, joint)[1] - np.deg2rad(1.0)  # a rest beyond is at the end of the stroke
    stands = [_rest(seen, -1) if seen.angle[-1] < floor else np.nan for seen in (on, off)]
    return Signature(
        "contact",
        "Foot on the floor",
        joint,
        TIME,
        ANGLE,
        (Line(off.t, off.angle, on=False), Line(on.t, on.angle)),
        (Mark((end, start), (end, float(on.angle[-1])), touching - start, "rad", "{} to\nthe floor", "left"),),
        (Size("angle at which the foot stands", stands, touching, "rad", ("bench_height",)),),
        "The foot meets the floor and the joint stops, long before its end stop.",
    )


def _leg(p: Parameters):
    found = body(p, robot(p))
    return found.leg, found.foot_radius
