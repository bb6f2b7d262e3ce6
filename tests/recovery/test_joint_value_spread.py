"""Values of joints that change, start through backlash or against a load: intervals hold what is known of them."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.base.criteria import criteria
from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.breakaway import starts_from_rest
from sysid.joint.evidence import evidence
from sysid.joint.spread import spread_of
from sysid.joint.stops import noise_level
from sysid.joint.values import joint_values
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Stop
from sysid.structures import actuated_joint

TS, NOISE = 0.05, 0.001
SPEED, DRY = 0.2, 2.0  # [y/s/V], [V]
OWN = {"map.low": -1.0, "map.high": 1.0, "motor.gain": SPEED * TS / 2, "motor.lag": 0.7, "motor.rise": DRY}
OWN |= {"motor.fall": DRY, "motor.x0": 0.5, "motor.delay": 0.8, "motor.upper": 1.0}
STAIRS = np.repeat(np.arange(0.5, 4.5, 0.1), 5)


def as_fit(chain, values) -> Fit:
    """A chain at these parameters as if a search had found it."""
    theta = np.array([values.get(name, chain.fixed.get(name, 0.0)) for name in chain.names])
    P = len(theta)
    none = Covariance(np.zeros((P, P)), np.zeros(P, dtype=bool), 1.0)
    return Fit(chain, theta, TS, criteria(NOISE**2, 400, P), none, Stop("", True, 0, 0), (), (), (1.0,), 0.0, "lm", 8)


def record(*runs) -> IOData:
    """Inputs and outputs with noise, one experiment each."""
    rng = np.random.default_rng(3)
    parts = [IOData(u, y + NOISE * rng.standard_normal(len(u)), TS) for u, y in runs]
    return IOData.merge(*parts) if len(parts) > 1 else parts[0]


@pytest.mark.parametrize("change", [0.0, 0.5])
def test_a_friction_that_changes_within_the_record_is_not_determined(change):
    chain = actuated_joint(motor=Motor(load=1), knots=2, play=False)
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(3.0, 8.0, 30) * (-1.0) ** np.arange(30), rng.integers(8, 25, 30))
    halves = [as_fit(chain, OWN | {"motor.rise": DRY + way * change}) for way in (-1.0, 1.0)]
    data = record(*((u, chain.simulate(half.theta, u)) for half in halves))
    fit, rise = as_fit(chain, OWN), chain.names.index("motor.rise")
    apart = spread_of(fit, data, 0.95).apart(lambda theta: float(theta[rise]))
    value = next(v for v in joint_values(fit, data=data) if v.name == "coulomb_up")
    if change == 0.0:
        assert apart < 0.01 * DRY
        assert value.holds(DRY)
    else:
        assert apart > 0.5 * change
        assert value.why.startswith("uncertain by ±")
        assert value.low is None


def test_a_value_is_no_more_certain_than_halves_of_the_record_agree_on_it():
    chain = actuated_joint(motor=Motor(load=1), knots=2, play=False)
    u = np.repeat(np.random.default_rng(1).uniform(-9.0, 9.0, 40), 10)
    fit, rise = as_fit(chain, OWN), chain.names.index("motor.rise")
    whole = spread_of(fit, record((u, chain.simulate(fit.theta, u))), 0.95, halves=False)
    shift = np.eye(len(fit.theta))[rise]
    apart = replace(whole, refits=(fit.theta - 0.3 * shift, fit.theta + 0.4 * shift))
    assert whole.std(lambda theta: float(theta[rise])) < 0.01
    assert apart.std(lambda theta: float(theta[rise])) == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2))
    fall = chain.names.index("motor.fall")  # on which the halves agree
    assert apart.std(lambda theta: float(theta[fall])) == whole.std(lambda theta: float(theta[fall]))


def test_a_start_through_the_open_backlash_is_late_and_still_brackets_the_break_away():
    chain = actuated_joint(motor=Motor(load=1), knots=2)
    fit = as_fit(chain, OWN | {"play.width": 0.1})
    way = [np.r_[-side * np.full(60, 3.5), np.zeros(20), side * STAIRS] for side in (1.0, -1.0)]
    u = np.concatenate(way * 3)
    data = record((u, chain.simulate(fit.theta, u)))
    starts = [s for s in starts_from_rest(data, noise_level(data.y[:, 0])) if s.slow]
    late = [s for s in starts if abs(s.held) > 1.1 * DRY]
    assert len(late) >= 4
    values = {value.name: value for value in joint_values(fit, data=data)}
    for name, true in (("breakaway_up", DRY), ("breakaway_down", -DRY)):
        assert values[name].holds(true), values.get(name)
        assert abs(values[name].value - true) < 0.1 * DRY


def test_a_break_away_that_the_load_takes_to_no_voltage_is_found_by_its_starts():
    """A load of -2 V carries the joint up against its friction: it starts up at 0 V, and down at -4 V."""
    chain = actuated_joint(motor=Motor(load=1, loss=True), knots=2, play=False)
    fit = as_fit(chain, OWN | {"motor.load0": -DRY})
    way = [np.r_[-DRY - side * np.full(60, 3.5), np.full(20, -DRY), -DRY + side * STAIRS] for side in (1.0, -1.0)]
    u = np.concatenate(way * 3)
    data = record((u, chain.simulate(fit.theta, u)))
    values = {value.name: value for value in joint_values(fit, data=data)}
    for name, true in (("breakaway_up", 0.0), ("breakaway_down", -2.0 * DRY)):
        assert values[name].holds(true)
        assert abs(values[name].value - true) < 0.1 * DRY


def test_the_reason_why_lag_and_delay_are_one_value_is_the_one_that_holds():
    chain = actuated_joint(motor=Motor(load=1), knots=2, play=False)
    u = np.repeat(np.random.default_rng(1).uniform(-9.0, 9.0, 80), 10)
    for lag, delay, why in (
        (0.5, 0.2, "the sampling time of 0.05 s is longer than"),
        (3.5, 0.0, "the delay of the fit is at the limit of its range"),
    ):
        fit = as_fit(chain, OWN | {"motor.lag": lag, "motor.delay": delay})
        shown = evidence(fit, record((u, chain.simulate(fit.theta, u)))).values["delay"]
        assert not shown.determined
        assert shown.why.startswith(why)
        assert ("sample" in shown.why.split(";")[1]) == (lag + delay < 3.0)
