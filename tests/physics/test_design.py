"""Designed experiments keep their promise under noise, on every joint and with every excitation, or say why not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from often import FULL

from sysid.base.errors import InputError
from sysid.excitations import TABLE
from twin import JOINTS, Experiment, Parameters, truth
from twin.design import QUIET, fit_stroke

# Every excitation on the quickest joint, two on one of the others, and all on all by night.
SLOW = ("aprbs", "thigh"), ("sweep", "shank")
CASES = [
    (excitation, joint)
    for excitation in sorted(TABLE)
    for joint in JOINTS
    if FULL or joint == "shoulder" or (excitation, joint) in SLOW
]
# Short records, with times that fit them: the shoulder crosses its stroke in 1.6 s, the others in about 6 s.
DURATION = {"shoulder": 20.0, "thigh": 50.0, "shank": 50.0}


def planned(joint, excitation, **changes):
    settings = {"duration": DURATION[joint], "seed": 3} | changes
    return Experiment(joint=joint, excitation=excitation, **settings)


@cache  # several tests look at the same design
def inside(joint, excitation):
    return fit_stroke(planned(joint, excitation))


def travel(experiment):
    """Least and greatest angle of a run as shares of the stroke, by the angle that a perfect potentiometer reads."""
    low, high = truth(experiment.joint, parameters=experiment.p).end_angles
    y = (experiment.run().y_true - low) / (high - low)
    return y.min(), y.max()


def noisier(experiment):
    """The same drive, with other noise, bend and lateness of what is read."""
    return replace(experiment, parameters=experiment.p.replace({"pot_noise": 0.01, "sample_jitter": 0.004}))


@pytest.mark.parametrize(("excitation", "joint"), CASES)
def test_inside_stays_inside_and_uses_the_stroke(joint, excitation):
    designed = inside(joint, excitation)
    for experiment in (designed, noisier(designed)):
        low, high = travel(experiment)
        # 5 % is promised of the true angle; a potentiometer of 0.1 % linearity and late samples show 1 % more or less.
        assert low > 0.04
        assert high < 0.96
        assert high - low > 0.4
    signal = designed.signal()
    assert signal.amplitude + abs(signal.offset) <= designed.p["supply_voltage"] + 1e-9  # no peak is cut


@pytest.mark.parametrize(("excitation", "joint"), CASES)
def test_ends_meets_both_ends_or_says_why_not(joint, excitation):
    # The random levels of some take more crossings than the short records hold: 150 s at thigh and shank.
    experiment = planned(joint, excitation, duration=20.0 if joint == "shoulder" else 150.0)
    if not experiment.signal().travel_more:  # nothing to stretch: the supply's 12 V do not carry it from end to end
        with pytest.raises(InputError, match=f"{excitation} on the {joint} does not reach both ends within"):
            fit_stroke(experiment, "ends")
        return
    designed = fit_stroke(experiment, "ends")
    weaker = replace(designed, options={**designed.options, "amplitude": 0.95 * designed.signal().amplitude})
    for each in (designed, noisier(designed), weaker):
        low, high = travel(each)
        assert low < 0.04
        assert high > 0.96


@pytest.mark.parametrize("joint", JOINTS)
def test_what_serves_already_is_left_alone(joint):
    small = planned(joint, "sweep", options={"amplitude": 8.0, "half_period": 0.8 if joint == "shoulder" else 2.0})
    if fit_stroke(small) is not small:  # drift alone may need an offset, and then the first half period
        assert set(fit_stroke(small).options) <= {"amplitude", "half_period", "offset", "first"}
    assert not fit_stroke(planned(joint, "sweep"), "ends").options


def test_the_design_is_one_and_the_same_every_time():
    assert fit_stroke(planned("thigh", "aprbs")).options == inside("thigh", "aprbs").options


def test_a_reach_keeps_the_amplitude():
    """Levels are reordered instead of shrunk: what is left of 12 V is what the offset does not take."""
    signal = inside("thigh", "aprbs").signal()
    assert signal.amplitude == pytest.approx(12.0 - abs(signal.offset), rel=1e-3)
    assert signal.reach > 0


def test_offset_carries_the_load():
    """The thigh lifts: its load at mid stroke is what the offset is there for, so it has the sign of that voltage."""
    down, up = truth("thigh").breakaway_voltage
    offset = fit_stroke(planned("thigh", "sweep")).signal().offset
    assert offset == pytest.approx((down + up) / 2, abs=0.5)


def test_a_smaller_margin_never_uses_less():
    used = []
    for margin in (0.0, 0.2):
        low, high = travel(
            fit_stroke(
                planned("shank", "multisine", options={"f_min": 0.02, "f_max": 0.2, "period": 40.0}), margin=margin
            )
        )
        assert low > margin - 0.01
        assert high < 1 - margin + 0.01
        used.append(high - low)
    assert used[0] >= used[1] - 0.1  # the search stops within 15 % of what fits


@pytest.mark.parametrize("joint", ["shoulder", "thigh"])
def test_servo_references_are_designed_too(joint):
    experiment = planned(joint, "staircase", mode="servo", options={"hold": 2.0, "steps": 3}, duration=24.0)
    wide = replace(experiment, options={**experiment.options, "amplitude": 1.4 * experiment.signal().amplitude})
    low, high = travel(fit_stroke(wide))
    assert 0.04 < low < 0.3
    assert 0.7 < high < 0.96
    low, high = travel(fit_stroke(experiment, "ends"))
    assert low < 0.04
    assert high > 0.96


HEAVY = Parameters({"shank_mass": 10.0, "gravity": 20.0})


@pytest.mark.parametrize(
    ("experiment", "where", "says"),
    [
        (
            planned("thigh", "sweep", options={"amplitude": 1.0}),
            "inside",
            r"does not move .* of 1 V, its break-away voltages are -4",
        ),
        (
            planned("thigh", "sweep", parameters=Parameters({"thigh.coulomb": 400.0})),
            "inside",
            "below its break-away voltage",
        ),
        (
            planned("thigh", "chirp", parameters=HEAVY, without=("friction", "load_friction")),
            "inside",
            "leaves the stroke",
        ),
        (planned("thigh", "sweep", options={"half_period": 0.5}), "ends", "does not reach both ends within 50 s"),
        (Experiment(joint="leg", duration=5.0), "inside", "one joint at a time, of shoulder, thigh, shank"),
        (planned("thigh", "sweep"), "middle", "unknown where 'middle'; choose one of inside, ends"),
    ],
)
def test_what_cannot_be_is_said(experiment, where, says):
    with pytest.raises(InputError, match=says):
        fit_stroke(experiment, where)


@pytest.mark.parametrize("margin", [-0.1, 0.5, float("nan"), "wide", True])
def test_bad_margins_are_refused(margin):
    with pytest.raises(InputError, match=r"give a share of the stroke from 0 to 0\.4"):
        fit_stroke(planned("thigh", "sweep"), margin=margin)


def test_quiet_names_are_imperfections():
    Experiment(without=QUIET)
    assert np.all([name in Experiment(without=QUIET).without for name in QUIET])
