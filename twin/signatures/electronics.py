"""Signatures of the electronics: PWM steps, dead zone, sag and delay of the drive; errors of the measurement."""

import numpy as np

from twin.hardware.linkage import end_angles
from twin.hardware.motor import motor
from twin.hardware.potentiometer import potentiometer
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
JOINT = "shoulder"
TIME = Axis("time", "s")


def pwm(p: Parameters) -> Signature:
    """The motor voltage over a fine ramp of the command, low enough that the joint does not move."""
    step = p["supply_voltage"] / (2 ** round(p["pwm_bits"]) - 1)
    u = np.linspace(0.0, 6.4 * step, 1601)
    on, off = pair("pwm", ("friction",), p, JOINT, u, tick(p))
    sizes = [_height(seen.volts) for seen in (on, off)]
    asked = u[:-1]
    middle = 3 * step
    return Signature(
        "pwm",
        "PWM resolution",
        JOINT,
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
    n = round(12 * lag(p, JOINT) / Ts) + 10
    levels = p["dead_band"] * np.linspace(-4.0, 4.0, 33) if p["dead_band"] > 0 else np.linspace(-1.0, 1.0, 33)
    found, lines = [], []
    for name, seen in zip((True, False), pair("dead_band", (), p, JOINT, holds(levels, n), Ts), strict=True):
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
        JOINT,
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
    most = next(row.upper for row in TABLE if row.name == f"{JOINT}.coulomb")
    stuck = p.replace({f"{JOINT}.coulomb": most})
    levels = top * np.linspace(0.0, 1.0, 41)
    on, off = pair("sag", ("friction",), stuck, JOINT, holds(levels, n), tick(p))
    resistance = motor(p, JOINT).resistance
    found = [_supply_resistance(seen.volts[n - 1 :: n], levels / top, top, resistance) for seen in (on, off)]
    lost = [float(top - seen.volts[-1]) for seen in (on, off)]
    true = p["supply_resistance"]
    drop = top * true / (resistance + true)
    return Signature(
        "sag",
        "Sag of the supply",
        JOINT,
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
    joint, Ts, late = JOINT, 0.001, lag(p, JOINT)
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


def nonlinearity(p: Parameters) -> Signature:
    """Reading of the potentiometer minus the angle, over the angle, for the whole travel."""
    low, high = end_angles(p, JOINT)
    speed, Ts = 0.5, 0.01
    n = round(1.3 * (high - low) / speed / Ts)
    volts = _volts(p, speed)
    both = pair("nonlinearity", ("end_stops",), p, JOINT, np.repeat([-volts, volts], n), Ts)
    on, off = ((seen.angle[n:], (seen.reading - seen.angle)[n:]) for seen in both)
    sizes = [0.5 * float(np.ptp(error)) for _, error in (on, off)]
    pot = potentiometer(p)
    true = pot.nonlinearity * np.sin(min(0.5 * np.pi, pot.wave * max(-low, high)))
    at = float(on[0][np.argmax(on[1])])
    return Signature(
        "nonlinearity",
        "Nonlinear potentiometer",
        JOINT,
        Axis("angle", "rad"),
        Axis("reading less angle", "rad"),
        (Line(*off, on=False), Line(*on)),
        (Mark((at, 0.0), (at, float(on[1].max())), true, "rad", "{}", "below"),),
        (Size("largest deviation from a line", sizes, true, "rad", ("pot_linearity", "pot_range")),),
        "The resistance of the track is not uniform: the reading error has three periods over its range.",
    )


def noise(p: Parameters) -> Signature:
    """A joint at rest, as logged."""
    both = pair("noise", ("friction",), p, JOINT, np.zeros(3000), 0.01)
    errors = [seen.logged - seen.reading for seen in both]
    sizes = [float(np.std(error)) for error in errors]
    shown = slice(0, 400)
    t = both[0].t[shown]
    at = 1.04 * float(t[-1])
    return Signature(
        "noise",
        "Measurement noise",
        JOINT,
        TIME,
        Axis("logged less true", "rad"),
        (Line(t, errors[0][shown], dots=True), Line(t, errors[1][shown], on=False)),
        (Mark((at, -sizes[0]), (at, sizes[0]), p["pot_noise"], "rad", "2 × {}", "outside"),),
        (Size("standard deviation", sizes, p["pot_noise"], "rad", ("pot_noise",)),),
        "The joint is at rest, but the log varies. The arrow spans one standard deviation to either side.",
    )


def adc(p: Parameters) -> Signature:
    """A slow steady motion as logged, over the angle."""
    true = potentiometer(p).step
    speed, Ts = 4 * true, 0.001
    both = pair("adc", (), p, JOINT, np.full(2400, _volts(p, speed)), Ts)
    sizes = [float(np.median(np.diff(np.unique(np.round(seen.logged, 12))))) for seen in both]
    on = off = slice(200, 1700)
    codes = np.unique(both[0].logged[on])
    middle = len(codes) // 2
    at = float(both[0].angle[on][np.argmax(both[0].logged[on] > codes[middle])])
    return Signature(
        "adc",
        "Quantisation by the ADC",
        JOINT,
        Axis("angle", "rad"),
        Axis("logged", "rad"),
        (
            Line(both[1].angle[off], both[1].logged[off], on=False),
            Line(both[0].angle[on], both[0].logged[on], steps=True),
        ),
        (Mark((at, float(codes[middle])), (at, float(codes[middle + 1])), true, "rad"),),
        (Size("distance between codes", sizes, true, "rad", ("adc_bits", "pot_range")),),
        "A steady motion rises in the log by whole codes.",
    )


def _volts(p: Parameters, speed: float) -> float:
    """Motor voltage [V] at which the frictionless shoulder runs at `speed` [rad/s]."""
    return speed * p[f"{JOINT}.rated_voltage"] / p[f"{JOINT}.no_load_speed"]


def jitter(p: Parameters) -> Signature:
    """A fast steady motion minus the line through its samples: a late sample shows a larger angle."""
    Ts = max(0.01, round(10 * p["sample_jitter"], 2))  # a sample is never off by more than half of it
    both = pair("jitter", (), p, JOINT, np.full(2500, p["supply_voltage"]), Ts)
    on, off = (_off_the_line(seen, round(16 * lag(p, JOINT) / Ts)) for seen in both)
    true = p["sample_jitter"]
    shown = slice(0, 200)
    at = 1.04 * float(on[0][shown][-1])
    return Signature(
        "jitter",
        "Sampling jitter",
        JOINT,
        TIME,
        Axis("logged, off the line", "rad"),
        (Line(on[0][shown], on[1][shown], dots=True), Line(off[0][shown], off[1][shown], on=False)),
        (Mark((at, -on[2] * on[3]), (at, on[2] * on[3]), true, "s", "2 × speed\n× {}", "outside"),),
        (Size("standard deviation of a sample's time", (on[2], off[2]), true, "s", ("sample_jitter",)),),
        "At a steady speed the samples scatter about the line by the speed times their timing error. The arrow "
        "spans one standard deviation to either side.",
    )


def _off_the_line(seen: Trial, first: int) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Time [s] and deviation [rad] from sample `first` on, its standard deviation as time [s], and the speed."""
    t, y = seen.t[first:], seen.logged[first:]
    slope, offset = line_fit(t, y)
    error = y - offset - slope * t
    return t - t[0], error, float(np.std(error)) / abs(slope), abs(slope)


def dropouts(p: Parameters) -> Signature:
    """A steady motion sample by sample: if the logger misses a sample, the log repeats the previous one."""
    Ts = 0.001
    both = pair("dropouts", (), p, JOINT, np.full(200_000, 0.5 * p["supply_voltage"]), Ts)
    repeats = [np.flatnonzero(np.diff(seen.logged[200:]) == 0) + 201 for seen in both]
    sizes = [len(found) / (len(seen.logged) - 201) for seen, found in zip(both, repeats, strict=True)]
    k = int(repeats[0][0]) if len(repeats[0]) else 208
    window = slice(k - 7, k + 8)
    samples = np.arange(15.0)
    on, off = ((samples, seen.logged[window] - seen.logged[k - 7]) for seen in both)
    missed = (float(on[0][7]), float(on[1][7]))
    return Signature(
        "dropouts",
        "Lost samples",
        JOINT,
        Axis("sample", ""),
        Axis("logged", "rad"),
        (Line(*off, on=False, steps=True), Line(*on, dots=True), Line(*on, steps=True)),
        (Mark(missed, (missed[0], float(off[1][7])), 100 * p["dropout_rate"], "%", "{} of all\nsamples", "top left"),),
        (Size("share of repeated samples", sizes, p["dropout_rate"], "1", ("dropout_rate",)),),
        "The log sometimes repeats a sample; the next one is correct again.",
    )
