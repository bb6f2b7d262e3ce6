"""Signatures of the measurement: potentiometer nonlinearity, noise, ADC codes, sampling jitter, lost samples."""

import numpy as np

from twin.hardware.linkage import end_angles
from twin.hardware.potentiometer import potentiometer
from twin.parameters import Parameters
from twin.signatures.signature import Axis, Line, Mark, Signature, Size, Trial, lag, line_fit, pair

JOINT = "shoulder"
TIME = Axis("time", "s")


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
