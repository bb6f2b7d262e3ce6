"""Signatures of the electronics: PWM steps, dead zone, sag and delay of the drive; errors of the measurement."""

import numpy as np

from twin.hardware.actuator import motor
from twin.hardware.linkage import end_angles
from twin.hardware.potentiometer import potentiometer
from twin.imperfections import Axis, Line, Mark, Signature, Size, Trial, holds, line_fit, steady_speeds
from twin.parameters import TABLE, Parameters
from twin.plant.stepping import TIMESTEP
from twin.signatures.lab import lag, pair, tick

COMMAND, MOTOR = Axis("command", "V"), Axis("motor", "V")
JOINT = "shoulder"
TIME = Axis("time", "s")


def pwm(p: Parameters) -> Signature:
    """The motor voltage over a fine ramp of the command, low enough that the joint does not move."""
    step = p["supply_voltage"] / (2 ** round(p["pwm_bits"]) - 1)
    u = np.linspace(0.0, 6.4 * step, 1601)
    run, base = pair("pwm", ("friction",), p, JOINT, u, tick(p))
    sizes = [_height(trial.volts) for trial in (run, base)]
    command = u[:-1]
    middle = 3 * step
    return Signature(
        "pwm",
        "PWM resolution",
        JOINT,
        COMMAND,
        MOTOR,
        (Line(command, base.volts[1:], on=False), Line(command, run.volts[1:], steps=True)),
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
    thresholds, lines = [], []
    for is_on, trial in zip((True, False), pair("dead_band", (), p, JOINT, holds(levels, n), Ts), strict=True):
        speed = steady_speeds(trial, n, 10)
        lines.append(Line(levels, speed, on=is_on))
        starts = []
        for way in (1, -1):
            moving = way * speed > 0.3 * np.abs(speed).max()
            starts.append(way * line_fit(speed[moving], levels[moving])[1])
        thresholds.append(float(np.mean(starts)))
    width = thresholds[0]
    return Signature(
        "dead_band",
        "Dead zone of the bridge",
        JOINT,
        COMMAND,
        Axis("steady speed", "rad/s"),
        (lines[1], Line(levels, lines[0].y, dots=True), lines[0]),
        (Mark((-width, 0.0), (width, 0.0), p["dead_band"], "V", "2 × {}", "above"),),
        (Size("command at which motion starts", thresholds, p["dead_band"], "V", ("dead_band",)),),
        "Small commands do not move the joint, although it has no friction: the dead time shortens every pulse.",
    )


def sag(p: Parameters) -> Signature:
    """The voltage of a blocked motor over the command."""
    n, top = 8, p["supply_voltage"]
    largest = next(row.upper for row in TABLE if row.name == f"{JOINT}.coulomb")
    blocked_motor = p.replace({f"{JOINT}.coulomb": largest})
    levels = top * np.linspace(0.0, 1.0, 41)
    run, base = pair("sag", ("friction",), blocked_motor, JOINT, holds(levels, n), tick(p))
    resistance = motor(p, JOINT).resistance
    resistances = [_supply_resistance(trial.volts[n - 1 :: n], levels / top, top, resistance) for trial in (run, base)]
    drops = [float(top - trial.volts[-1]) for trial in (run, base)]
    true = p["supply_resistance"]
    drop = top * true / (resistance + true)
    return Signature(
        "sag",
        "Sag of the supply",
        JOINT,
        COMMAND,
        Axis("command less motor", "V"),
        (Line(levels, levels - base.volts[n - 1 :: n], on=False), Line(levels, levels - run.volts[n - 1 :: n])),
        (Mark((top, 0.0), (top, drops[0]), drop, "V", "{}", "top left"),),
        (
            Size("resistance of supply and wires", resistances, true, "Ohm", ("supply_resistance",)),
            Size("voltage drop at full command, stalled", drops, drop, "V", ("supply_resistance",)),
        ),
        "The current of a stalled motor grows with its duty ratio and causes a voltage drop in supply and wires.",
    )


def _supply_resistance(volts: np.ndarray, duty: np.ndarray, supply: float, resistance: float) -> float:
    """Resistance [Ohm] that explains motor voltages d V: the bus drops by V0 - V = Rs d i with i = d V / Ra."""
    current = duty[1:] * volts[1:] / resistance
    return float(np.sum(current * (supply - volts[1:] / duty[1:])) / np.sum(current**2))


def delay(p: Parameters) -> Signature:
    """The angle after a step of voltage at time 0. Its final line meets the initial angle one delay and one lag later.

    The board reads commands every millisecond here; its usual period would add to the delay.
    """
    p = p.replace({"switch_period": TIMESTEP})
    joint, Ts, time_constant = JOINT, 0.001, lag(p, JOINT)
    u = np.full(round((20 * time_constant + p["delay"]) / Ts), 0.5 * p["supply_voltage"])
    run, base = pair("delay", (), p, joint, u, Ts)
    delays = [_start_crossing(trial, 8 * time_constant) - time_constant for trial in (run, base)]
    shown = run.t < 4 * time_constant + p["delay"]
    half = 0.5 * float(run.angle[shown][-1] + run.angle[0])
    crossings = [float(np.interp(half, trial.angle, trial.t)) for trial in (base, run)]
    return Signature(
        "delay",
        "Transport delay",
        joint,
        Axis("time after the step", "s"),
        Axis("angle", "rad"),
        (Line(base.t[shown], base.angle[shown], on=False), Line(run.t[shown], run.angle[shown])),
        (Mark((crossings[0], half), (crossings[1], half), p["delay"], "s", "{}", "right"),),
        (Size("delay of the command", delays, p["delay"], "s", ("delay",)),),
        "The same answer, later.",
    )


def _start_crossing(trial: Trial, duration: float) -> float:
    """Time [s] at which the line of the last `duration` [s] of the motion passes the initial angle."""
    is_late = trial.t > trial.t[-1] - duration
    slope, offset = line_fit(trial.t[is_late], trial.angle[is_late] - trial.angle[0])
    return -offset / slope


def nonlinearity(p: Parameters) -> Signature:
    """Reading of the potentiometer minus the angle, over the angle, for the whole travel."""
    low, high = end_angles(p, JOINT)
    speed, Ts = 0.5, 0.01
    n = round(1.3 * (high - low) / speed / Ts)
    volts = _volts(p, speed)
    trials = pair("nonlinearity", ("end_stops",), p, JOINT, np.repeat([-volts, volts], n), Ts)
    run, base = ((trial.angle[n:], (trial.reading - trial.angle)[n:]) for trial in trials)
    sizes = [0.5 * float(np.ptp(error)) for _, error in (run, base)]
    pot = potentiometer(p)
    true = pot.nonlinearity * np.sin(min(0.5 * np.pi, pot.wave * max(-low, high)))
    peak = float(run[0][np.argmax(run[1])])
    return Signature(
        "nonlinearity",
        "Nonlinear potentiometer",
        JOINT,
        Axis("angle", "rad"),
        Axis("reading less angle", "rad"),
        (Line(*base, on=False), Line(*run)),
        (Mark((peak, 0.0), (peak, float(run[1].max())), true, "rad", "{}", "below"),),
        (Size("largest deviation from a line", sizes, true, "rad", ("pot_linearity", "pot_range")),),
        "The resistance of the track is not uniform: the reading error has three periods over its range.",
    )


def noise(p: Parameters) -> Signature:
    """A joint at rest, as logged."""
    trials = pair("noise", ("friction",), p, JOINT, np.zeros(3000), 0.01)
    errors = [trial.logged - trial.reading for trial in trials]
    sizes = [float(np.std(error)) for error in errors]
    window = slice(0, 400)
    t = trials[0].t[window]
    place = 1.04 * float(t[-1])
    return Signature(
        "noise",
        "Measurement noise",
        JOINT,
        TIME,
        Axis("logged less true", "rad"),
        (Line(t, errors[0][window], dots=True), Line(t, errors[1][window], on=False)),
        (Mark((place, -sizes[0]), (place, sizes[0]), p["pot_noise"], "rad", "2 × {}", "outside"),),
        (Size("standard deviation", sizes, p["pot_noise"], "rad", ("pot_noise",)),),
        "The joint is at rest, but the log varies. The arrow spans one standard deviation to either side.",
    )


def adc(p: Parameters) -> Signature:
    """A slow steady motion as logged, over the angle."""
    true = potentiometer(p).step
    speed, Ts = 4 * true, 0.001
    trials = pair("adc", (), p, JOINT, np.full(2400, _volts(p, speed)), Ts)
    sizes = [float(np.median(np.diff(np.unique(np.round(trial.logged, 12))))) for trial in trials]
    window = slice(200, 1700)
    codes = np.unique(trials[0].logged[window])
    middle = len(codes) // 2
    place = float(trials[0].angle[window][np.argmax(trials[0].logged[window] > codes[middle])])
    return Signature(
        "adc",
        "Quantisation by the ADC",
        JOINT,
        Axis("angle", "rad"),
        Axis("logged", "rad"),
        (
            Line(trials[1].angle[window], trials[1].logged[window], on=False),
            Line(trials[0].angle[window], trials[0].logged[window], steps=True),
        ),
        (Mark((place, float(codes[middle])), (place, float(codes[middle + 1])), true, "rad"),),
        (Size("distance between codes", sizes, true, "rad", ("adc_bits", "pot_range")),),
        "A steady motion rises in the log by whole codes.",
    )


def _volts(p: Parameters, speed: float) -> float:
    """Motor voltage [V] at which the frictionless shoulder runs at `speed` [rad/s]."""
    return speed * p[f"{JOINT}.rated_voltage"] / p[f"{JOINT}.no_load_speed"]


def jitter(p: Parameters) -> Signature:
    """A fast steady motion minus the line through its samples: a late sample shows a larger angle."""
    Ts = max(0.01, round(10 * p["sample_jitter"], 2))  # a sample is never off by more than half of it
    trials = pair("jitter", (), p, JOINT, np.full(2500, p["supply_voltage"]), Ts)
    run, base = (_line_residual(trial, round(16 * lag(p, JOINT) / Ts)) for trial in trials)
    true = p["sample_jitter"]
    window = slice(0, 200)
    place = 1.04 * float(run[0][window][-1])
    return Signature(
        "jitter",
        "Sampling jitter",
        JOINT,
        TIME,
        Axis("logged, off the line", "rad"),
        (Line(run[0][window], run[1][window], dots=True), Line(base[0][window], base[1][window], on=False)),
        (Mark((place, -run[2] * run[3]), (place, run[2] * run[3]), true, "s", "2 × speed\n× {}", "outside"),),
        (Size("standard deviation of a sample's time", (run[2], base[2]), true, "s", ("sample_jitter",)),),
        "At a steady speed the samples scatter about the line by the speed times their timing error. The arrow "
        "spans one standard deviation to either side.",
    )


def _line_residual(trial: Trial, first: int) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Time [s] and deviation [rad] from sample `first` on, its standard deviation as time [s], and the speed."""
    t, y = trial.t[first:], trial.logged[first:]
    slope, offset = line_fit(t, y)
    error = y - offset - slope * t
    return t - t[0], error, float(np.std(error)) / abs(slope), abs(slope)


def dropouts(p: Parameters) -> Signature:
    """A steady motion sample by sample: if the logger misses a sample, the log repeats the previous one."""
    Ts = 0.001
    trials = pair("dropouts", (), p, JOINT, np.full(200_000, 0.5 * p["supply_voltage"]), Ts)
    repeats = [np.flatnonzero(np.diff(trial.logged[200:]) == 0) + 201 for trial in trials]
    sizes = [len(indices) / (len(trial.logged) - 201) for trial, indices in zip(trials, repeats, strict=True)]
    k = int(repeats[0][0]) if len(repeats[0]) else 208
    window = slice(k - 7, k + 8)
    samples = np.arange(15.0)
    run, base = ((samples, trial.logged[window] - trial.logged[k - 7]) for trial in trials)
    point = (float(run[0][7]), float(run[1][7]))
    return Signature(
        "dropouts",
        "Lost samples",
        JOINT,
        Axis("sample", ""),
        Axis("logged", "rad"),
        (Line(*base, on=False, steps=True), Line(*run, dots=True), Line(*run, steps=True)),
        (Mark(point, (point[0], float(base[1][7])), 100 * p["dropout_rate"], "%", "{} of all\nsamples", "top left"),),
        (Size("share of repeated samples", sizes, p["dropout_rate"], "1", ("dropout_rate",)),),
        "The log sometimes repeats a sample; the next one is correct again.",
    )
