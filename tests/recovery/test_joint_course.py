"""A designed course keeps to what the joint bears: its range, its friction, its speed."""

import numpy as np
import pytest

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.joint.course import Course
from sysid.joint.design import Design, design
from sysid.model.chain import Chain

TS, NOISE = 0.05, 1e-3
# A joint without linkage, in rad; it may have no stop, or one.
LOOSE = {
    **{"motor.gain": 2e-3, "motor.lag": 3.0, "motor.rise": 1.4, "motor.fall": 1.6, "motor.delay": 0.6},
    **{"motor.load0": 0.0, "motor.lower": -1.0, "motor.upper": 1.0, "motor.x0": 0.3},
}


def theta_of(chain: Chain, values: dict[str, float]) -> np.ndarray:
    return np.array([values.get(name, 0.0) for name in chain.names])


def loose(stops: str, **changes: float) -> tuple[Chain, np.ndarray]:
    chain = Chain((Motor(load=1, stops=stops, at=0.0, role="motor"),), "actuated_joint", {"motor.load0": 0.0})
    return chain, theta_of(chain, LOOSE | {f"motor.{name}": value for name, value in changes.items()})


def sweep(least: float, most: float, up: int = 200) -> np.ndarray:
    """To and fro with random levels, each held long enough for a stop if `up` samples are."""
    levels = np.random.default_rng(5).uniform(least, most, 20)
    return np.concatenate([np.full(up if k % 2 else 200, level if k % 2 else -level) for k, level in enumerate(levels)])


def loose_design(stops: str, to_stops: bool = False, **changes: float) -> tuple[Chain, np.ndarray, IOData, Design]:
    """A joint, its first record and the design on its true parameters."""
    chain, theta = loose(stops, **changes)
    u = sweep(7.0, 10.0, 100 if stops == "lower" else 200)
    noise = NOISE * np.random.default_rng(6).standard_normal(len(u))
    data = IOData(u, chain.simulate(theta, u).ravel() + noise, TS, u_unit="V", y_unit="rad")
    fit = fit_chain(chain, data, start=theta, search="lm")
    return chain, theta, data, design(fit, data, Ts=TS, to_stops=to_stops)


@pytest.mark.parametrize("stops", ["none", "lower"])
@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_joint_stays_where_it_was_seen_on_the_side_without_a_stop(stops: str, factor: float) -> None:
    """The true joint is 5 % slower or faster than the fit, which adds up over the way where no stop sets it back."""
    chain, theta, data, d = loose_design(stops)
    other = np.array(theta)
    other[chain.names.index("motor.gain")] *= factor
    y, whole = chain.simulate(other, d.u).ravel(), float(np.ptp(data.y))
    assert y.max() < data.y.max() + 0.1 * whole
    assert y.min() > data.y.min() - 0.1 * whole
    assert np.ptp(y) > 0.7 * whole
    missing = ("upper",) if stops == "lower" else ("lower", "upper")
    for end in missing:
        assert any(f"shows no {end} end" in note and "--to-stops" in note for note in d.notes)
    assert sum("shows no" in note for note in d.notes) == len(missing)
    assert any("begin the experiment at" in note for note in d.notes) == (stops == "none")


def test_a_joint_that_may_run_into_its_stops_does_so_where_the_record_shows_none() -> None:
    """The record of a joint without stops, and a true joint that has them a little farther out."""
    _, _, data, d = loose_design("none", to_stops=True)
    low, high = float(data.y.min()), float(data.y.max())
    reach = 0.1 * (high - low)
    chain, bounded = loose("both", lower=low - reach, upper=high + reach, x0=float(data.y[0, 0]))
    y = chain.simulate(bounded, d.u).ravel()
    assert np.sum((y[1:] == high + reach) & (y[:-1] < high + reach)) >= 4
    assert np.sum((y[1:] == low - reach) & (y[:-1] > low - reach)) >= 4
    assert not any("shows no" in note for note in d.notes)


@pytest.mark.parametrize("load", [-1.35, 1.55])
def test_pulses_rise_with_the_friction_where_the_load_takes_nearly_all_of_it(load: float) -> None:
    """One way needs 0.05 V, and a rise by shares of that would never reach a friction at rest of 0.4 V more."""
    # A constant load is a difference between the frictions.
    chain, theta = loose("both", rise=1.4 + load, fall=1.6 - load)
    u = sweep(4.0, 10.0)
    data = IOData(u, chain.simulate(theta, u).ravel(), TS)
    course = Course.of(fit_chain(chain, data, start=theta, search="lm"), data, 10.0, None, TS)
    for way, needed in ((1, 1.4 + load), (-1, 1.6 - load)):
        levels = way * course.rising_levels(way, 2.0)
        assert levels.min() < needed + 0.02
        assert levels.max() > needed + 1.3
        assert np.diff(levels) == pytest.approx(0.06 * 1.5, rel=0.02)


def test_a_joint_that_rests_firmly_is_moved_by_every_level() -> None:
    """Friction at rest of half as much again; a level between the two would never start it."""
    motor = Motor(load=1, stribeck=True, stops="both", at=0.0, role="motor")
    chain = Chain((motor,), "actuated_joint", {"motor.load0": 0.0})
    theta = theta_of(chain, LOOSE | {"motor.stick": 0.75, "motor.stick_speed": 2e-3, "motor.x0": -1.0})
    u = sweep(4.0, 10.0)
    data = IOData(u, chain.simulate(theta, u).ravel() + NOISE, TS)
    course = Course.of(fit_chain(chain, data, start=theta, search="lm"), data, 3.5, None, TS)
    for way in (1, -1):
        start = np.array(theta)
        start[chain.names.index("motor.x0")] = -way * 1.0
        y = chain.simulate(start, np.full(4000, way * course.level(way, 0.2))).ravel()
        assert y[-1] == pytest.approx(way * 1.0)
        assert course.level(way, 0.2) < 2.7


def rests(chain: Chain, theta: np.ndarray, d: Design, end: float) -> np.ndarray:
    """Lengths of the rests at an end, in samples."""
    there = np.abs(chain.simulate(theta, d.u).ravel() - end) < 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.astype(int), [0]])))
    return edges[1::2] - edges[::2]


def test_a_fast_joint_rests_at_its_ends_until_the_rest_is_seen() -> None:
    """Eight times lag and delay, though it crosses its way in a quarter of that."""
    chain, theta, _, d = loose_design("both", gain=0.05)
    for end in (-1.0, 1.0):
        assert np.sum(rests(chain, theta, d, end) >= 8 * (3.0 + 0.6)) >= 3


def test_some_runs_turn_just_after_they_arrive_where_a_jam_shows() -> None:
    """Within an eighth of the way's time, 100 to 250 samples at these inputs."""
    chain, theta, _, d = loose_design("both")
    for end in (-1.0, 1.0):
        assert np.sum(rests(chain, theta, d, end) < 30) >= 2


def test_a_strike_limit_counts_the_speed_that_the_input_makes_not_that_of_a_load() -> None:
    """A load that moves the joint by itself at one end; the input that is allowed still crosses the way."""
    chain, theta = loose("both", load2=2.2)
    u = sweep(6.0, 12.0)
    data = IOData(u, chain.simulate(theta, u).ravel(), TS)
    fit = fit_chain(chain, data, start=theta, search="lm")
    d = design(fit, data, ("ends",), strike=0.25, Ts=TS)
    fastest = np.abs(np.diff(chain.simulate(theta, d.u).ravel())).max() / TS
    assert 0.15 < fastest <= 0.25


def test_weak_inputs_and_a_way_without_an_end_are_told() -> None:
    """2.2 V is 2.1 V from the middle of frictions of 1.4 V and 1.6 V; a fit without stops is sent to them."""
    chain, theta, data, d = loose_design("both")
    assert not any("friction in motion" in note for note in d.notes)
    fit = fit_chain(chain, data, start=theta, search="lm")
    weak = [note for note in design(fit, data, ("ends",), volts=2.2, Ts=TS).notes if "friction in motion" in note]
    assert len(weak) == 1
    assert "-2.20 and 2.20 V, are only 1.40 times" in weak[0].replace("−", "-")
    free = loose_design("none", to_stops=True)[3]
    assert any("leave --to-stops out if the joint has none" in note for note in free.notes)


def test_a_prediction_that_runs_away_where_the_fit_has_no_stop_ends_far_out() -> None:
    """Below the middle the load pulls down ever harder, and the joint's lower stop was not in its first record."""
    chain = Chain((Motor(load=3, stops="upper", at=0.0, role="motor"),), "actuated_joint", {"motor.load0": 0.0})
    theta = theta_of(chain, LOOSE | {"motor.load2": 7.0, "motor.lag": 0.1})
    u = np.tile(np.repeat([12.0, -3.0, 0.0], [300, 120, 20]), 10)
    y = chain.simulate(theta, u).ravel()
    data = IOData(u, y + NOISE * np.random.default_rng(6).standard_normal(len(u)), TS, u_unit="V", y_unit="rad")
    d = design(fit_chain(chain, data, start=theta, search="lm"), data, Ts=TS, to_stops=True)
    assert not np.isfinite(chain.simulate(theta, d.u)).all()  # what nothing stops
    assert np.isfinite(d.y).all()
