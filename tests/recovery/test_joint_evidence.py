"""What a record bears out: stops that were met, starts from rest, crossings of the backlash, on joints made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.blocks import CoastingPlay, Motor, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.breakaway import starts_from_rest
from sysid.joint.evidence import CROSSINGS, evidence, stop_tests
from sysid.joint.full import searched_from
from sysid.joint.stops import noise_level, reading_noise, stop_test
from sysid.joint.values import joint_values
from sysid.solver.covariance import Covariance
from sysid.structures import actuated_joint, servo_joint

TS, NOISE = 0.05, 0.003
SPEED, DRY = 0.2, 2.0  # [1/s/V], [V]


def moved(u, low=-np.inf, high=np.inf, spring=0.0, way=1.0, seed=0):
    """Place of a joint without inertia: it moves by the voltage beyond dry friction and spring, between two stops."""
    y, x = np.zeros(len(u)), 0.0
    for t, volts in enumerate(way * u):
        y[t] = x
        net = volts - spring * x
        x = float(np.clip(x + TS * SPEED * np.sign(net) * max(abs(net) - DRY, 0.0), low, high))
    return y + NOISE * np.random.default_rng(seed).standard_normal(len(u))


def levels(values, seconds):
    return np.repeat(np.asarray(values, dtype=float), round(seconds / TS))


SWEEP = levels([10, -9, 8, -10, 9, -8, 10, -10], 3.0)


def test_rests_at_speed_against_a_driving_voltage_are_a_stop():
    y = moved(SWEEP, -1.0, 1.0)
    for end, outward, rests in ((1.0, 1.0, 4), (-1.0, -1.0, 4)):
        found = stop_test(SWEEP, y, TS, end, NOISE, outward)
        assert found.met, found.why
        assert len(found.visits) == found.arrivals == rests
        # Each reading is a mean of at least 20 samples.
        assert max(abs(visit.reading - end) for visit in found.visits) < 4.0 * NOISE / np.sqrt(20)
        assert abs(found.farthest - end) < 4.0 * NOISE


def test_the_test_knows_which_way_a_voltage_drives_and_takes_experiments_together():
    y = moved(SWEEP, -1.0, 0.7, way=-1.0)
    pieces = np.split(np.arange(len(y)), 4)
    found = stop_test([SWEEP[i] for i in pieces], [y[i] for i in pieces], TS, 0.7, NOISE, 1.0)
    assert found.met
    assert found.arrivals == 4


def test_a_rest_by_friction_is_no_stop():
    u = levels([8, 1.5, -8, -1.5, 8, 1.5, -8, -1.5], 1.0)
    y = moved(u)
    for end in (y.max(), float(np.median(y[25:38]))):  # the joint rests there twice
        found = stop_test(u, y, TS, end, NOISE)
        assert not found.met
        assert "never rests there against a voltage" in found.why


def test_a_turn_is_no_stop():
    u = levels([8, -8, 8, -8, 8, -8], 1.0)
    y = moved(u)
    assert not stop_test(u, y, TS, y.max(), NOISE).met


def test_a_spring_holds_the_joint_against_the_voltage_that_moves_it_elsewhere_and_is_no_stop():
    u = levels([10, -10, 10, -10, 10, -10], 6.0)
    y = moved(u, spring=8.0)
    assert not stop_test(u, y, TS, float(y.max()), NOISE).met
    assert stop_test(u, moved(u, -0.6, 0.6, spring=8.0), TS, 0.6, NOISE).met


def lagged(u, lag, stop):
    """Place of a motor with a lag [samples] between two stops, and noise."""
    y, x, v = np.zeros(len(u)), 0.0, 0.0
    for t, volts in enumerate(u):
        y[t] = x
        v += (0.005 * volts - v) / lag
        moved_to = float(np.clip(x + v, -stop, stop))
        v, x = (0.0 if moved_to != x + v else v), moved_to
    return y + NOISE * np.random.default_rng(1).standard_normal(len(u))


@pytest.mark.parametrize("rest", [15, 30])
def test_short_rests_of_a_record_with_a_fast_clock_show_a_stop_and_turns_do_not(rest):
    """They last for some two and three times the lag: in steps of the lag too few readings of them are left."""
    way, lag = 0.8, 9
    u = np.tile(np.repeat([10.0, -10.0], 45 + rest), 4)  # 45 samples from stop to stop
    found = stop_test(u, lagged(u, lag, way), 0.01, way, NOISE, every=lag)
    assert found.met
    assert found.arrivals == 4
    y = lagged(u, lag, np.inf)
    assert not stop_test(u, y, 0.01, float(y.max()), NOISE, every=lag).met


@pytest.mark.parametrize("spring", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("period", [3.0, 6.0, 10.0])
def test_the_turns_of_a_slow_swing_against_a_spring_are_no_stops(spring, period):
    t = TS * np.arange(900)
    u = 10 * np.sin(2 * np.pi * t / period) * np.linspace(0.4, 1.0, len(t))
    y = moved(u, spring=spring)
    assert not stop_test(u, y, TS, float(y.max()), NOISE).met
    assert not stop_test(u, y, TS, float(y.min()), NOISE, -1.0).met


def test_a_place_that_the_joint_passes_is_no_end():
    y = moved(SWEEP, -1.0, 1.0)
    found = stop_test(SWEEP, y, TS, 0.8, NOISE)
    assert not found.met
    assert "beyond" in found.why
    assert not stop_test(SWEEP, y, TS, 1.2, NOISE).met


def test_a_joint_that_no_voltage_moves_elsewhere_shows_no_stop():
    u = levels([1.0, -1.0], 3.0)
    assert "no voltage moves" in stop_test(u, moved(u), TS, 0.0, NOISE).why


@pytest.mark.parametrize("steps", [0.0, 0.3, 0.5, 0.8, 1.0, 1.4, 2.0, 3.0])
def test_the_noise_of_a_moving_joint_is_that_of_its_readings(steps):
    """Also where a converter's step is as large as the noise, which a tenth of the readings lack and were filled."""
    u = np.tile(SWEEP, 4)
    y = moved(u, -1.0, 1.0)
    if step := steps * NOISE:
        y = np.round(y / step) * step
    lost = np.random.default_rng(1).random(len(y)) < 0.1
    filled = np.interp(np.arange(len(y)), np.flatnonzero(~lost), y[~lost])
    data = IOData(u, filled, TS, missing=lost)
    assert reading_noise(data) == pytest.approx(np.hypot(NOISE, step / np.sqrt(12.0)), rel=0.12)


def test_slow_stairs_bracket_every_start_and_sudden_voltages_none():
    ramp = 0.05 * np.concatenate([np.arange(100), np.arange(100)[::-1]])
    u = np.concatenate([ramp, -ramp] * 3)
    found = starts_from_rest(IOData(u, moved(u), TS), NOISE)
    for way in (1, -1):
        mine = [start for start in found if start.way == way]
        assert len(mine) == 3
        assert all(start.held * way <= DRY <= start.moved * way for start in mine)
        assert sum(start.slow for start in mine) >= 2  # noise makes one bracket wider than another
    sudden = levels([5, 0, -5, 0, 5, 0, -5, 0], 2.0)
    found = starts_from_rest(IOData(sudden, moved(sudden), TS), NOISE)
    assert {start.way for start in found} == {1, -1}
    assert not any(start.slow for start in found)


@pytest.mark.parametrize(("settles", "found"), [(1.5, 1), (6.0, 0)])
def test_a_joint_that_settles_rests_and_one_that_drifts_does_not(settles, found):
    """A link that settles by less than a reading tells is no motion that goes on until it is taken for a start."""
    u = levels(0.2 * np.arange(16), 3.0)
    y = moved(u) + settles * NOISE * np.minimum(np.arange(len(u)) / 330.0, 1.0)
    starts = [start for start in starts_from_rest(IOData(u, y, TS), NOISE) if start.slow]
    assert len(starts) == found
    assert all(start.held < DRY < start.moved for start in starts)


def test_a_slow_motion_that_turns_is_no_rest_at_an_end():
    # At 2.6 V it moves by two standard deviations a sample: the last five samples before it turns look like a rest.
    u = np.concatenate([levels([-9], 1.3), levels([9], 1.2), levels([2.6], 2.0), levels([-9, 9, -9], 0.5)])
    for seed in range(5):
        y = moved(u, seed=seed)
        assert not stop_test(u, y, TS, float(y.max()), NOISE).met


def test_a_joint_that_begins_at_its_end_has_not_arrived_there():
    u = levels([8, -7, 9, -7], 2.0)
    y = moved(u, high=0.0)
    assert stop_test(u, y, TS, 0.0, NOISE).met
    found = stop_test(u[:80], y[:80], TS, 0.0, NOISE)
    assert not found.met
    half = stop_test(np.append(u[:80], levels([6], 0.5)), np.append(y[:80], y[80:90]), TS, 0.0, NOISE)
    assert len(half.visits) == 1
    assert "at speed" in half.why


def test_starts_correct_a_model_whose_static_friction_is_off_and_refuse_one_that_they_contradict():
    chain = actuated_joint(motor=Motor(load=1), knots=2, play=False)
    ramp = 0.02 * np.concatenate([np.arange(250), np.arange(250)[::-1]])
    u = np.concatenate([ramp, -ramp] * 4)
    fit = as_fit(chain, JOINT)
    y = chain.simulate(fit.theta, u) + 0.2 * NOISE * np.random.default_rng(4).standard_normal(len(u))
    data = IOData(u, y, TS)
    for off, determined in ((1.08, True), (0.92, True), (1.6, False), (0.6, False)):
        wrong = as_fit(chain, JOINT | {"motor.rise": DRY * off, "motor.fall": DRY * off})
        values = {value.name: value for value in joint_values(wrong, data=data)}
        for way, name in ((1, "up"), (-1, "down")):
            if determined:
                found = values[f"breakaway_{name}"]
                # Starts may be late, so the upper half of a bracket counts for less than it tells here.
                assert abs(found.value - way * DRY) < 0.7 * abs(off - 1.0) * DRY
                assert found.holds(way * DRY)
            else:
                assert "contradict" in values[f"moving_friction_{name}"].why


def as_fit(chain, values) -> Fit:
    """A chain at these parameters as if a search had found it."""
    from sysid.base.criteria import criteria
    from sysid.solver.iterate import Stop

    theta = np.array([values.get(name, chain.fixed.get(name, 0.0)) for name in chain.names])
    P = len(theta)
    none = Covariance(np.zeros((P, P)), np.zeros(P, dtype=bool), 1.0)
    return Fit(chain, theta, TS, criteria(NOISE**2, 400, P), none, Stop("", True, 0, 0), (), (), (1.0,), 0.0, "lm", 8)


JOINT = {"map.low": -1.0, "map.high": 1.0, "motor.gain": SPEED * TS / 2, "motor.lag": 0.7, "motor.rise": DRY}
JOINT |= {"motor.fall": DRY, "motor.x0": 0.5, "motor.delay": 0.8, "motor.upper": 1.0, "play.width": 0.05}


def driven(chain, u, seed=0) -> IOData:
    fit = as_fit(chain, JOINT)
    y = chain.simulate(fit.theta, u) + NOISE * np.random.default_rng(seed).standard_normal(len(u))
    return IOData(u, y, TS, y_unit="rad")


@pytest.mark.parametrize(
    ("sizes", "determined"),
    [((6.0, 3.0, 8.0), False), ((6.0,) * 10, False), ((4.5, 3.0, 4.0, 3.5, 4.0) * 2, True)],
)
def test_the_backlash_is_crossed_at_every_reversal(sizes, determined):
    """Reversals at one speed show a time, which may be a delay as well; at several speeds they show an angle."""
    chain = actuated_joint(knots=2)
    u = levels([size * (-1) ** k for k, size in enumerate(sizes)], 1.0)
    found = evidence(as_fit(chain, JOINT), driven(chain, u)).values["backlash"]
    assert found.counts["crossings_up"] + found.counts["crossings_down"] == len(sizes) - 1
    assert found.determined == determined
    if len(sizes) > CROSSINGS:
        assert (found.counts["uncertainty"] < 0.15) == determined


@pytest.mark.parametrize(("pull", "drag"), [(0.0, 0.001), (-0.02, 0.001), (0.0, 5.0)])
def test_a_crossing_at_an_end_or_by_the_weight_alone_shows_no_backlash(pull, drag):
    """An end has some give, and between two passes of one place load and friction differ: both look like a backlash."""
    chain = actuated_joint(knots=2, play=CoastingPlay(role="play"))
    joint = as_fit(chain, JOINT | {"play.pull1": pull, "play.drag": drag})
    y, x = chain.simulate(joint.theta, SWEEP), chain.through(joint.theta, SWEEP, 0, 2)
    assert np.sum(np.diff(np.sign(y - x)) != 0) > CROSSINGS
    found = evidence(joint, IOData(SWEEP, y, TS)).values["backlash"]
    assert found.counts["crossings_up"] + found.counts["crossings_down"] == 0
    assert "where the drive turns between the ends: 0, but" in found.why


def test_lag_and_delay_are_one_value_where_a_sample_is_longer_than_both():
    chain = actuated_joint(knots=2, play=False)
    rng = np.random.default_rng(1)
    u = levels(rng.uniform(-9, 9, 80), 0.5)
    fit = as_fit(chain, JOINT | {"motor.lag": 2.5, "motor.delay": 1.5})
    data = IOData(u, chain.simulate(fit.theta, u) + NOISE * rng.standard_normal(len(u)), TS)
    names = {value.name: value for value in joint_values(fit, data=data)}
    assert {"time_constant", "delay"} <= set(names)
    fit = as_fit(chain, JOINT | {"motor.lag": 0.5, "motor.delay": 0.2})
    data = IOData(u, chain.simulate(fit.theta, u) + NOISE * rng.standard_normal(len(u)), TS)
    names = {value.name: value for value in joint_values(fit, data=data)}
    assert not {"time_constant", "delay"} & set(names)
    assert names["lag_and_delay"].value == pytest.approx(0.7 * TS)
    assert "sample 5 times faster" in names["lag_and_delay"].why  # for three samples of the motion


def test_an_end_that_no_record_shows_has_no_interval_and_says_how_far_the_joint_came():
    chain = actuated_joint(motor=Motor(load=3, delayed=False), knots=2, play=False)
    u = levels([8, 0, -8, 0], 1.0)
    data = driven(chain, u)
    values = {value.name: value for value in joint_values(as_fit(chain, JOINT), data=data)}
    for name in ("end_low", "end_high"):
        assert not values[name].determined
        assert values[name].low is None
        assert values[name].why.startswith("not reached: beyond")
    told = float(values["end_high"].why.split()[3])
    assert told == pytest.approx(np.degrees(data.y.max()), abs=np.degrees(3.0 * NOISE))
    assert not values["end_high"].holds(1.0)


def test_without_starts_from_rest_a_break_away_is_called_moving_friction():
    chain = actuated_joint(motor=Motor(load=1, stribeck=True, substeps=4), knots=2, play=False)
    own = JOINT | {"motor.stick": 0.5, "motor.stick_speed": 0.002}
    fit = as_fit(chain, own)
    fast = levels([8, -5, 6, -9, 5, -8, 9, -6] * 2, 2.0)
    ramp = 0.03 * np.concatenate([np.arange(200), np.arange(200)[::-1]])
    slow = np.concatenate([ramp, -ramp] * 4)
    for u, determined in ((fast, False), (slow, True)):
        data = IOData(u, chain.simulate(fit.theta, u) + NOISE * np.random.default_rng(2).standard_normal(len(u)), TS)
        values = {value.name: value for value in joint_values(fit, data=data)}
        assert ("breakaway_up" in values) == determined
        assert ("moving_friction_up" in values) != determined
        if determined:
            assert values["breakaway_up"].holds(DRY + 0.5)
            assert values["breakaway_up"].value == pytest.approx(DRY + 0.5, rel=0.05)
        else:
            assert values["moving_friction_up"].value == pytest.approx(DRY)
            assert "qpal design --for breakaway" in values["moving_friction_up"].why


def test_a_stop_that_a_fit_has_out_of_reach_was_not_met_and_a_motor_without_stops_has_no_ends():
    u = levels([8, -8] * 3, 2.0)
    above = {"motor.upper": 1.0, "motor.lower": -1000.0}
    chain = actuated_joint(motor=Motor(load=3, delayed=False), knots=2, play=False, fixed=above)
    fit = as_fit(chain, JOINT | above)
    y = chain.simulate(fit.theta, u) + NOISE * np.random.default_rng(5).standard_normal(len(u))
    values = {value.name: value for value in joint_values(fit, data=IOData(u, y, TS))}
    assert values["end_high"].holds(1.0)
    assert not values["end_low"].determined
    assert values["end_low"].why.startswith("not reached: beyond")
    free = actuated_joint(motor=Motor(load=0, delayed=False, stops=False), knots=None, play=False)
    fit = as_fit(free, JOINT | {"motor.gain": SPEED * TS})
    y = free.simulate(fit.theta, u) + NOISE * np.random.default_rng(6).standard_normal(len(u))
    names = {value.name for value in joint_values(fit, data=IOData(u, y, TS))}
    assert "coulomb_up" in names
    assert not {"end_low", "end_high"} & names


def test_what_drives_a_servo_against_its_stop_is_its_error():
    motor = ServoMotor(load=0, delayed=False, stops=True)
    chain = servo_joint(motor, play=False, limit=6.0)
    own = {"motor.kp": 20.0, "motor.limit": 6.0, "motor.gain": 0.01, "motor.lag": 0.7, "motor.rise": 0.5}
    own |= {"motor.fall": 0.5, "motor.lower": -1.0, "motor.upper": 1.0}
    fit = as_fit(chain, own)
    # A goal beyond the stop leaves an error that moves it elsewhere; a servo at its goal has none.
    for top, met in ((1.6, True), (0.9, False)):
        goal = levels([top, -1.6, 0.3, -1.6, top, 0.3, -1.6, top], 4.0)
        y = chain.simulate(fit.theta, goal) + NOISE * np.random.default_rng(7).standard_normal(len(goal))
        tests = stop_tests(fit, IOData(goal, y, TS))
        assert tests["end_low"].met
        assert tests["end_high"].met == met


def test_records_in_which_no_rest_can_be_seen_have_no_starts():
    data = IOData(SWEEP, moved(SWEEP, -1.0, 1.0), Ts=TS)
    assert starts_from_rest(data, noise_level(data.y[:, 0]))
    assert starts_from_rest(data, float("nan")) == []  # no speed is below such a noise: the joint never rests
    for every in (data.N // 2, data.N - 1, data.N, data.N + 1, 9 * data.N):
        assert starts_from_rest(data, NOISE, every) == []
    # Always on the move: a line.
    assert starts_from_rest(IOData(np.ones(200), np.arange(200.0), Ts=TS), NOISE) == []
    for N in range(1, 12):
        assert not stop_test(SWEEP[:N], data.y[:N, 0], TS, 1.0, NOISE).met


def test_a_search_that_got_stuck_goes_on_from_where_another_record_of_the_joint_has_led():
    """With too much friction the model never moves, and no small change of it does."""
    chain = actuated_joint(knots=2)
    data = driven(chain, levels([4.5, -3.0, 4.0, -3.5, 4.0, -4.5], 1.0))
    there = as_fit(chain, JOINT)
    stuck = as_fit(chain, JOINT | {"motor.rise": 9.0, "motor.fall": 9.0})
    stuck = replace(stuck, criteria=replace(stuck.criteria, mse=float(np.var(data.y))))
    found = searched_from(stuck, [there], data)
    assert found.criteria.mse < 1.2 * NOISE**2
    assert found.theta[chain.names.index("play.width")] == pytest.approx(JOINT["play.width"], rel=0.1)
    for others in ([], [stuck]):
        assert searched_from(found, others, data) is found
