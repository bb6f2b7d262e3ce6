"""Signatures between the command and the motor: PWM steps, dead zone, supply voltage drop, delay."""

import numpy as np

from twin.hardware.motor import motor
from twin.parameters import TABLE, Parameters
from twin.plant.stepping import TIMESTEP
from twin.signatures.signature import (
    Axis,
    Line,
    Mark,
    Signature,
    Size,
    Trial,
    holds,
    lag,
    line_fit,
    pair,
    steady_speeds,
    tick,
)

COMMAND, MOTOR = Axis("command", "V"), Axis("motor", "V")


def pwm(p: Parameters) -> Signature:
    """The motor voltage over a fine ramp of the command, low enough that the joint does not move."""
    step = p["supply_voltage"] / (2 ** round(p["pwm_bits"]) - 1)
    u = np.linspace(0.0, 6.4 * step, 1601)
    on, off = pair("pwm", ("friction",), p, "shoulder", u, tick(p))
    sizes = [_height(seen.volts) for seen in (on, off)]
    asked = u[:-1]
    middle = 3 * step
    return Signature(
        "pwm",
        "PWM resolution",
        "shoulder",
        COMMAND,
        MOTOR,
        (Line(asked, off.volts[1:], on=False), Line(asked, on.volts[1:], steps=True)),
        (Mark((3.5 * step, middle), (3.5 * step, middle + sizes[0]), step, "V"),),
        (Size("height of a step", sizes, step, "V", ("pwm_bits", "supply_voltage")),),
        "The bridge has a finite number of duty levels: the motor voltage rises in steps.",
    )


def _height(volts: np.ndarray) -> float:
    """Median distance [V] between the voltages that occur."""
    return float(np.median(np.diff(np.unique(np.round(volts, 12)))))


def dead_band(p: Parameters) -> Signature:
    """Steady speed over the command without other resistance."""
    Ts = 0.01
    n = round(12 * lag(p, "shoulder") / Ts) + 10
    levels = p["dead_band"] * np.linspace(-4.0, 4.0, 33) if p["dead_band"] > 0 else np.linspace(-1.0, 1.0, 33)
    found, lines = [], []
    for name, seen in zip((True, False), pair("dead_band", (), p, "shoulder", holds(levels, n), Ts), strict=True):
        speed = steady_speeds(seen, n, 10)
        lines.append(Line(levels, speed, on=name))
        starts = []
        for way in (1, -1):
            moving = way * speed > 0.3 * np.abs(speed).max()
            starts.append(way * line_fit(speed[moving], levels[moving])[1])
        found.append(float(np.mean(starts)))
    width = found[0]
    return Signature(
        "dead_band",
        "Dead zone of the bridge",
        "shoulder",
        COMMAND,
        Axis("steady speed", "rad/s"),
        (lines[1], Line(levels, lines[0].y, dots=True), lines[0]),
        (Mark((-width, 0.0), (width, 0.0), p["dead_band"], "V", "2 × {}", "above"),),
        (Size("command at which motion starts", found, p["dead_band"], "V", ("dead_band",)),),
        "Small commands do not move the joint, although it has no friction: the dead time shortens every pulse.",
    )


def sag(p: Parameters) -> Signature:
    """The voltage of a blocked motor over the command."""
    n, top = 8, p["supply_voltage"]
    most = next(row.upper for row in TABLE if row.name == "shoulder.coulomb")
    stuck = p.replace({"shoulder.coulomb": most})
    levels = top * np.linspace(0.0, 1.0, 41)
    on, off = pair("sag", ("friction",), stuck, "shoulder", holds(levels, n), tick(p))
    resistance = motor(p, "shoulder").resistance
    found = [_supply_resistance(seen.volts[n - 1 :: n], levels / top, top, resistance) for seen in (on, off)]
    lost = [float(top - seen.volts[-1]) for seen in (on, off)]
    true = p["supply_resistance"]
    drop = top * true / (resistance + true)
    return Signature(
        "sag",
        "Sag of the supply",
        "shoulder",
        COMMAND,
        Axis("command less motor", "V"),
        (Line(levels, levels - off.volts[n - 1 :: n], on=False), Line(levels, levels - on.volts[n - 1 :: n])),
        (Mark((top, 0.0), (top, lost[0]), drop, "V", "{}", "top left"),),
        (
            Size("resistance of supply and wires", found, true, "Ohm", ("supply_resistance",)),
            Size("voltage drop at full command, stalled", lost, drop, "V", ("supply_resistance",)),
        ),
        "The current of a stalled motor grows with its duty ratio and causes a voltage drop in supply and wires.",
    )


def _supply_resistance(volts: np.ndarray, duty: np.ndarray, supply: float, resistance: float) -> float:
    """Resistance [Ohm] that explains motor voltages d V: the bus drops by V0 - V = Rs d i with i = d V / Ra."""
    drawn = duty[1:] * volts[1:] / resistance
    return float(np.sum(drawn * (supply - volts[1:] / duty[1:])) / np.sum(drawn**2))


def delay(p: Parameters) -> Signature:
    """The angle after a step of voltage at time 0. Its final line meets the initial angle one delay and one lag later.

    The board reads commands every millisecond here; its usual period would add to the delay.
    """
    p = p.replace({"switch_period": TIMESTEP})
    joint, Ts, late = "shoulder", 0.001, lag(p, "shoulder")
    u = np.full(round((20 * late + p["delay"]) / Ts), 0.5 * p["supply_voltage"])
    on, off = pair("delay", (), p, joint, u, Ts)
    found = [_meets_start(seen, 8 * late) - late for seen in (on, off)]
    shown = on.t < 4 * late + p["delay"]
    half = 0.5 * float(on.angle[shown][-1] + on.angle[0])
    at = [float(np.interp(half, seen.angle, seen.t)) for seen in (off, on)]
    return Signature(
        "delay",
        "Transport delay",
        joint,
        Axis("time after the step", "s"),
        Axis("angle", "rad"),
        (Line(off.t[shown], off.angle[shown], on=False), Line(on.t[shown], on.angle[shown])),
        (Mark((at[0], half), (at[1], half), p["delay"], "s", "{}", "right"),),
        (Size("delay of the command", found, p["delay"], "s", ("delay",)),),
        "The same answer, later.",
    )


def _meets_start(seen: Trial, last: float) -> float:
    """Time [s] at which the line of the last `last` [s] of the motion passes the initial angle."""
    late = seen.t > seen.t[-1] - last
    slope, offset = line_fit(seen.t[late], seen.angle[late] - seen.angle[0])
    return -offset / slope
