"""The next experiment shows what it is designed for, on joints that are not quite the fit it was designed on."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Motor
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.result import Fit
from sysid.joint.course import ALONG, Course
from sysid.joint.design import Design, design
from sysid.joint.sampling import rate_needed, theta_at_rate
from sysid.joint.values import joint_values
from sysid.model.chain import Chain
from sysid.structures import actuated_joint, output_error
from twin.rig.auto import shortened

TS, NOISE = 0.05, 1e-3
STICKY = actuated_joint(motor=Motor(load=2, stribeck=True, substeps=4), knots=3, play=False)
# Strokes a sample and volt, samples, volts; the ends are -0.5 and 1.1 rad, break-away is 1.8 up and 2.4 down at middle.
TRUE = {
    **{"motor.gain": 6e-4, "motor.lag": 1.5, "motor.rise": 1.4, "motor.fall": 2.0, "motor.stick": 0.4},
    **{"motor.stick_speed": 2e-4, "motor.load1": 0.5, "motor.delay": 0.6, "motor.lower": 0.0, "motor.upper": 1.0},
    **{"motor.x0": 0.4, "map.low": -0.5, "map.high": 1.1, "map.s1": 0.55},
}


def theta_of(chain: Chain, values: dict[str, float]) -> np.ndarray:
    return np.array([values.get(name, 0.0) for name in chain.names])


def run(values: dict[str, float], u: np.ndarray, chain: Chain = STICKY) -> np.ndarray:
    return chain.simulate(theta_of(chain, values), u).ravel()


def at(Ts: float, values: dict[str, float]) -> dict[str, float]:
    """The same joint in samples of Ts."""
    share = Ts / TS
    change = {"gain": share, "stick_speed": share, "lag": 1.0 / share, "delay": 1.0 / share}
    return {name: value * change.get(name.split(".")[1], 1.0) for name, value in values.items()}


def positions(values: dict[str, float], d: Design) -> np.ndarray:
    """The true motor under a design, in strokes."""
    return STICKY.signals(theta_of(STICKY, at(d.Ts, values)), d.u)[1].ravel()


@cache
def first() -> tuple[Fit, IOData]:
    """A fast sweep, and the plain joint that is fitted to it: it has never seen a slow start."""
    rng = np.random.default_rng(4)
    levels = rng.uniform(7.0, 12.0, 24) * np.where(np.arange(24) % 2, -1.0, 1.0)
    u = np.repeat(levels, 180)
    data = IOData(u, run(TRUE, u) + NOISE * rng.standard_normal(len(u)), TS, u_unit="V", y_unit="rad")
    plain = actuated_joint(motor=Motor(load=2), knots=3, play=False)
    known = {name: value for name, value in TRUE.items() if name in plain.names}
    return fit_chain(plain, data, start=theta_of(plain, known), search="lm"), data


@cache
def proposed(*targets: str, strike: float | None = None) -> Design:
    fit, data = first()
    return design(fit, data, targets, strike=strike, complete=True)


def changed(**factors: float) -> dict[str, float]:
    return {name: value * factors.get(name.split(".")[1], 1.0) for name, value in TRUE.items()}


def starts(values: dict[str, float], d: Design) -> list[tuple[int, float, float, float]]:
    """Way, the last level that left the true joint at rest, the first that moved it, and its position, by series of
    rising pulses from rest."""
    place, found = positions(values, d), []
    for phase in d.phases:
        if phase.name != "breakaway":
            continue
        edges = [phase.start, *(np.flatnonzero(np.diff(d.u[phase.start : phase.stop])) + phase.start + 1), phase.stop]
        before = 0.0  # the level of the last pulse that moved nothing; nan after one that moved
        for a, b in itertools.pairwise(edges):
            level, after = d.u[a], min(b + 4, phase.stop)  # the motor follows two samples late
            if level == 0.0:
                continue
            moved = np.ptp(place[a:after]) > 0.0
            if abs(level) > 5.0:  # a run to an end
                before = 0.0
            elif moved and not np.isnan(before):
                found.append((int(np.sign(level)), before, float(level), float(place[a])))
                before = np.nan
            elif not moved:
                before = float(level)
    return found


@pytest.mark.parametrize("factors", [{}, {"gain": 1.1, "rise": 0.9}, {"gain": 0.9, "fall": 1.15, "stick": 1.3}])
def test_pulses_bracket_the_voltage_that_starts_the_joint(factors: dict[str, float]) -> None:
    """The fit of the fast sweep knows neither stick nor, here, the right speed and friction."""
    d, values = proposed("ends", "breakaway"), changed(**factors)
    found = starts(values, d)
    for way in (-1, 1):
        own = [(held, moved, place) for w, held, moved, place in found if w == way]
        assert len(own) >= 4  # of three series in each of two rounds; the lowest may end too early
        dry = values["motor.rise" if way > 0 else "motor.fall"] + values["motor.stick"]
        for held, moved, place in own:
            needed = dry + way * values["motor.load1"] * (place - 0.5)
            assert abs(held) < needed <= abs(moved)
            assert abs(moved) - abs(held) < 0.08 * needed
            assert 0.2 < place < 0.8


def test_a_fifth_of_the_time_for_break_away_still_starts_the_joint_both_ways() -> None:
    """A rig with little time left plays the parts that fit."""
    d = proposed("breakaway")
    given = shortened(d, 0.2 * d.duration, 12.0)
    assert 0.0 < len(given.u) * given.Ts <= 0.2 * d.duration
    played = replace(d, u=given.u, phases=(replace(d.phases[0], start=0, stop=len(given.u)),))
    assert {way for way, *_ in starts(TRUE, played)} == {-1, 1}


def test_parts_that_take_a_few_seconds_are_repeated_in_the_time_that_is_left() -> None:
    d = proposed("backlash")
    n = round(10.0 / d.Ts)
    short = replace(d, u=d.u[:n], phases=(replace(d.phases[0], start=0, stop=n),))
    for seconds, times in ((15.0, 1), (35.0, 3), (600.0, 4)):
        np.testing.assert_array_equal(shortened(short, seconds, 12.0).u, np.tile(short.u, times))


@pytest.mark.parametrize(
    ("factors", "least"), [({}, 4), ({"gain": 0.85}, 2), ({"gain": 1.15, "rise": 1.2, "fall": 1.2}, 4)]
)
def test_both_ends_are_met_at_different_speeds_by_a_joint_that_differs_from_the_fit(
    factors: dict[str, float], least: int
) -> None:
    d = proposed("ends")
    place = positions(changed(**factors), d)
    for end in (0.0, 1.0):
        there = np.abs(place - end) < 1e-9
        arrivals = np.flatnonzero(there[1:] & ~there[:-1])
        speeds = np.abs(place[arrivals] - place[arrivals - 1])
        assert len(arrivals) >= least
        assert speeds.max() > 1.3 * speeds.min()


def test_no_speed_above_the_one_allowed() -> None:
    free, careful = proposed("ends", "breakaway", "backlash"), proposed("ends", "breakaway", "backlash", strike=0.12)
    fastest = [np.abs(np.diff(run(at(d.Ts, TRUE), d.u))).max() / d.Ts for d in (free, careful)]
    assert fastest[0] > 0.15
    assert 0.08 < fastest[1] <= 0.12  # as fast as it may be, not slower
    assert careful.fastest <= 0.12


def test_expected_intervals_are_as_wide_as_estimates_from_such_records_scatter() -> None:
    d, (fit, _) = proposed("ends", "breakaway"), first()
    begin = theta_at_rate(fit.model, fit.theta, TS / d.Ts)
    own = fit.model.simulate(begin, d.u).ravel()
    estimates: dict[str, list[float]] = {}
    for seed in range(90):
        noise = np.sqrt(fit.criteria.mse) * np.random.default_rng([seed, 1]).standard_normal(len(own))
        again = fit_chain(fit.model, IOData(d.u, own + noise, d.Ts), start=begin, search="lm")
        for value in joint_values(again):
            estimates.setdefault(value.name, []).append(value.value)
    expected = {v.name: v for v in d.then}
    for name in ("speed_per_volt", "coulomb_up", "coulomb_down"):
        v = expected[name]
        assert v.low is not None
        assert v.high is not None
        # Of 90 estimates the standard deviation is known to 7.5 %.
        assert (v.high - v.low) / 3.92 == pytest.approx(np.std(estimates[name], ddof=1), rel=0.3), name


@pytest.mark.parametrize("play", [False, CoastingPlay()])
def test_a_chain_at_a_shorter_sampling_time_is_the_same_joint(play) -> None:
    """Samples of the slow chain against every fifth of the fast one, under the same held input."""
    chain = actuated_joint(motor=Motor(load=1, stops=True, jams=True), knots=3, play=play)
    coasts = {"play.width": 0.02, "play.drag": 2e-3, "play.pull0": 1e-3} if play else {}
    theta = theta_of(chain, TRUE | {"motor.load0": 0.3, "motor.jam": 400.0} | coasts)
    levels = np.random.default_rng(3).uniform(-12.0, 12.0, 40)
    u = np.repeat(levels, 120)
    slow = chain.simulate(theta, u).ravel()
    fast = chain.simulate(theta_at_rate(chain, theta, 5.0), np.repeat(u, 5)).ravel()[::5]
    assert np.ptp(slow) > 1.5  # from end to end
    far = np.abs(slow - fast)
    # The motor is solved in continuous time; a coasting link meets its sides at samples, up to one of them late.
    assert far.max() < (np.abs(np.diff(slow)).max() if play else 1e-9)
    assert np.median(far) < (1e-4 if play else 1e-12)


def test_a_level_moves_the_joint_everywhere_on_its_way() -> None:
    """By hand: friction and the load at the worst place, the far end in the direction of motion; mid way needs less."""
    fit, data = first()
    course, p = Course.of(fit, data, 12.0, None, TS), dict(zip(fit.model.names, fit.theta, strict=True))
    load = p["motor.load0"] + p["motor.load1"] * (ALONG[-1] - 0.5)
    assert course.starting_input(1, ALONG) == pytest.approx(p["motor.rise"] + load, rel=1e-3)
    assert course.starting_input(1) < course.starting_input(1, ALONG) - 0.1
    assert course.level(1, 0.0) == course.starting_input(1, ALONG)


def test_the_next_record_is_sampled_so_that_lag_and_delay_last_three_samples() -> None:
    fit, data = first()
    motor = dict(zip(fit.model.names, fit.theta, strict=True))
    lasts = motor["motor.lag"] + motor["motor.delay"]
    assert lasts == pytest.approx(2.1, abs=0.1)
    assert rate_needed(fit) == 2
    assert proposed("ends").Ts == TS / 2
    assert design(fit, data, ("backlash",), Ts=TS).Ts == TS
    with pytest.raises(InputError, match=r"sampling time of the next record is 0.1 s; give 0.0025 to 0.05 s"):
        design(fit, data, Ts=0.1)


def test_what_cannot_be_designed_is_told_in_a_sentence() -> None:
    fit, data = first()
    with pytest.raises(InputError, match="unknown value to design for 'rust'"):
        design(fit, data, ("rust",))
    with pytest.raises(InputError, match=r"no value to design for; give some of ends, breakaway, backlash"):
        design(fit, data, ())
    with pytest.raises(InputError, match=r"strike is -1; give a positive number"):
        design(fit, data, strike=-1)
    with pytest.raises(InputError, match=r"may not exceed 1; allow larger inputs or speeds"):
        design(fit, data, volts=1)
    linear = fit_chain(output_error(1, 1, 1), data, start=np.array([0.1, -0.9, 0.0]), search="lm")
    with pytest.raises(InputError, match="has no motor; design the next experiment on an actuated_joint"):
        design(linear, data)
