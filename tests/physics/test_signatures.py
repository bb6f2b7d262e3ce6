"""Every imperfection shows itself in an experiment of its own: its size out of the data against the parameter."""

import math
from functools import cache

import numpy as np
import pytest

from twin import IMPERFECTIONS, Parameters
from twin.parameters import TABLE as ROWS
from twin.signatures import TABLE, Signature, signatures

# How far a measured size may be from the true one, as part of it, and why not less.
STEADY = (2e-3, "a steady state, and a line through several of them")
TOLERANCE = {
    "friction": STEADY,
    "asymmetry": STEADY,
    "stribeck": (0.02, "speed is taken over 0.02 s, in which a joint that breaks loose loses a part of its friction"),
    "hunting": (0.02, "the integral winds on between two looks of the board, and motion shows a sample later"),
    "load_friction": (3e-3, "the start of a ramp's motion, extrapolated over a slightly turning moment arm"),
    "end_stops": (2e-3, "the stop is stiff, not rigid: 0.02 of 52 degrees"),
    "backlash": (2e-3, "the play's stop gives by as much"),
    "pwm": (1e-6, "a difference of two voltages"),
    "dead_band": STEADY,
    "sag": (1e-4, "Ohm's law, on a motor that creeps by nothing else than the friction's own give"),
    "delay": (1e-3, "a settled line's extrapolation; delays are whole milliseconds"),
    "nonlinearity": (1e-3, "the largest of samples 0.3 degrees apart"),
    "noise": (4 / math.sqrt(2 * 3000), "four standard errors of a deviation from 3000 samples"),
    "adc": (1e-6, "a difference of two codes"),
    "jitter": (4 / math.sqrt(2 * 2400), "four standard errors of a deviation from some 2400 samples"),
    "dropouts": (4 / math.sqrt(0.002 * 200_000), "four standard errors of a count that is Poisson's"),
    "gravity": (2e-3, "speed lags behind the weight, which changes along the way"),
    "contact": (2e-3, "the rubber foot gives by a fraction of a millimetre"),
}
# Every size changed, some by much, so that no signature can be right by chance.
OTHER = Parameters(
    {
        **{"shoulder.coulomb": 1.3, "shoulder.bearing_coulomb": 0.2, "shoulder.viscous": 0.4},
        **{"shoulder.asymmetry": -0.25, "shoulder.stribeck": 0.5, "shoulder.stribeck_speed": math.radians(3.0)},
        **{"thigh.load_friction": 0.6, "shank.stroke": 0.06, "shank.retracted_length": 0.16},
        **{"shoulder.backlash": math.radians(0.6), "pwm_bits": 7, "dead_band": 0.5, "supply_resistance": 2.5},
        **{"delay": 0.047, "pot_linearity": 0.003, "pot_noise": math.radians(0.1), "adc_bits": 9},
        **{"sample_jitter": 0.002, "dropout_rate": 0.01, "thigh_mass": 0.6, "gravity": 9.0, "supply_voltage": 14.0},
    }
)
SETS = {"nominal": Parameters(), "other": OTHER}
IDEAL = Parameters({row.name: 0.0 for row in ROWS if row.lower == 0})
STUCK = Parameters({"shoulder.coulomb": 20.0, "thigh.coulomb": 500.0, "shank.coulomb": 500.0})


@cache
def signature(key: str, parameters: str) -> Signature:
    return TABLE[key](SETS[parameters])


def test_every_imperfection_has_a_signature() -> None:
    assert set(TABLE) - set(IMPERFECTIONS) == {"hunting"}
    assert [key for key in TABLE if key in IMPERFECTIONS] == list(IMPERFECTIONS)
    assert set(TOLERANCE) == set(TABLE)


@pytest.mark.parametrize("parameters", SETS)
@pytest.mark.parametrize("key", TABLE)
def test_measured_size_is_the_parameters(key: str, parameters: str) -> None:
    for size in signature(key, parameters).sizes:
        assert size.true != 0
        assert size.measured == pytest.approx(size.true, rel=TOLERANCE[key][0]), size.name


@pytest.mark.parametrize("parameters", SETS)
@pytest.mark.parametrize("key", TABLE)
def test_without_the_imperfection_the_size_vanishes(key: str, parameters: str) -> None:
    for size in signature(key, parameters).sizes:
        # 0.5 %: the distance of two codes or PWM levels is then that of two samples on the way.
        assert math.isnan(size.off) or abs(size.off) < 0.005 * abs(size.true), size.name


@pytest.mark.parametrize("key", TABLE)
def test_a_signature_says_what_it_is(key: str) -> None:
    found = signature(key, "nominal")
    assert (found.name, found.key) == ("stribeck" if key == "hunting" else key, key)
    assert {line.on for line in found.lines} == {True, False}
    assert all(len(line.x) == len(line.y) and np.isfinite(line.x).all() for line in found.lines)
    assert found.marks
    assert found.sentence.endswith(".")
    names = {row.name for row in ROWS}
    assert all(row in names for size in found.sizes for row in size.rows)


def test_sizes_of_the_two_sets_differ_by_more_than_any_tolerance() -> None:
    for key in set(TABLE) - {"contact"}:  # its floor is put where the foot is to touch
        for a, b in zip(signature(key, "nominal").sizes, signature(key, "other").sizes, strict=True):
            assert abs(a.true / b.true - 1) > 2 * TOLERANCE[key][0], a.name


@pytest.mark.parametrize("parameters", [IDEAL, STUCK], ids=["ideal", "stuck"])
def test_a_joint_without_imperfections_or_without_motion_is_no_error(parameters: Parameters) -> None:
    found = signatures(parameters)
    assert len(found) == len(TABLE)
    if parameters is IDEAL:
        shown = {s.name: s.sizes[0].measured for s in found}
        for name in ("friction", "asymmetry", "stribeck", "dead_band", "sag", "delay", "noise", "gravity"):
            assert math.isnan(shown[name]) or abs(shown[name]) < 1e-5
