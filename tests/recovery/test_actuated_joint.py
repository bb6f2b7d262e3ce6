"""An actuated joint with known parameters, found again from noisy records and starts made of data alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import sysid
from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Motor
from sysid.data.record import IOData
from sysid.excitations import Sweep
from sysid.joint.values import joint_values
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

TS, N, NOISE = 0.1, 1250, np.deg2rad(0.2)
TRUE = {
    **{"motor.gain": 0.0019, "motor.lag": 0.55, "motor.rise": 1.9, "motor.fall": 2.6, "motor.delay": 0.3},
    **{"motor.load1": 0.7, "motor.load2": -0.4, "motor.upper": 1.0, "motor.x0": 0.45},
    **{"map.low": -0.9, "map.high": 0.4, "play.width": 0.012, "play.rest": 0.2},
    **{f"map.s{k}": (k / 8) ** 1.15 for k in range(1, 8)},
}


def theta_of(chain: Chain) -> np.ndarray:
    return np.array([TRUE.get(name, 0.0) for name in chain.names])


def record(chain: Chain, seed: int, noise: float = NOISE) -> tuple[IOData, np.ndarray]:
    """A record of two halves and its output without noise (2 N,)."""
    rng = np.random.default_rng([seed, 11])
    u = Sweep(12.0, 10.0, jitter=0.5, shrink=0.6).generate(2 * N, TS, rng)
    y = chain.simulate(theta_of(chain), u)
    return IOData(u, y + noise * rng.normal(size=2 * N), TS), y


def expected(chain: Chain) -> dict[str, float]:
    """The physical values of TRUE, worked out by hand."""
    share = CubicSpline(KNOTS, SHARES)
    slope = (TRUE["map.high"] - TRUE["map.low"]) * float(share(0.6) - share(0.4)) / 0.2
    return {
        "speed_per_volt": TRUE["motor.gain"] * slope / TS,
        "time_constant": 0.055,
        "breakaway_up": 1.9,
        "breakaway_down": -2.6,
        "coulomb_up": 1.9,
        "coulomb_down": -2.6,
        "end_low": -0.9,
        "end_high": 0.4,
        "backlash": 0.012,
        "delay": 0.03,
    }


KNOTS = np.linspace(0, 1, 9)
SHARES = np.array([0.0, *(TRUE[f"map.s{k}"] for k in range(1, 8)), 1.0])


def test_noise_free_parameters_come_back_from_starts_made_of_data():
    chain = actuated_joint(knots=9)
    data, _ = record(chain, 0, noise=0.0)
    fit = sysid.fit(chain, data, search="lm", starts=6, seed=0)
    own = ~chain.initial & chain.free
    # 1e-4: a switch that falls between two samples is seen exactly, one that moves a sample's branch is not.
    np.testing.assert_allclose(fit.theta[own], theta_of(chain)[own], rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_recovery_and_intervals_over_many_records(seeds):
    chain = actuated_joint(knots=9)
    truth, gaps, held = expected(chain), [], {name: [] for name in expected(chain)}
    for seed in seeds:
        data, clean = record(chain, seed)
        fit = sysid.fit(chain, data.split(0.5)[0], search="lm", starts=4, seed=0)
        e = data.y[N:, 0] - chain.simulate(fit.theta, data.u)[N:]
        oracle = data.y[N:, 0] - clean[N:]
        gaps.append(100 * (np.linalg.norm(e) - np.linalg.norm(oracle)) / np.linalg.norm(data.y[N:] - data.y[N:].mean()))
        for value in joint_values(fit):
            held[value.name].append(value.holds(truth[value.name]))
    assert np.mean(np.array(gaps) < 0.5) >= 0.95
    # Of 100 records 90 to 98 should hold a 95 % interval; of a few, all names together must not be far off.
    count = len(gaps)
    shares = {name: np.mean(hits) for name, hits in held.items()}
    if count >= 100:
        assert all(0.88 <= share <= 0.99 for share in shares.values()), shares
    assert 0.85 <= np.mean(list(shares.values())) <= 0.995, shares


def test_physical_values_are_what_the_parameters_say():
    chain = actuated_joint(knots=9)
    data, _ = record(chain, 0)
    fit = sysid.fit(chain, data, search="lm", start=theta_of(chain))
    at_truth = {v.name: v for v in joint_values(replace(fit, theta=theta_of(chain)))}
    for name, value in expected(chain).items():
        assert at_truth[name].value == pytest.approx(value, rel=1e-9), name
        assert at_truth[name].low < value < at_truth[name].high


@pytest.mark.parametrize(("play", "side"), [(True, -1.0), (CoastingPlay(), 1.0)])
def test_end_stops_are_those_of_the_drive_and_the_output_rests_half_the_backlash_from_them(play, side):
    """Inside, where the drive pushes it there; beyond, where it coasts on without drag."""
    chain = actuated_joint(knots=9, play=play)
    y = chain.simulate(theta_of(chain), np.repeat([12.0, -12.0], 1000))
    half = 0.5 * TRUE["play.width"]
    assert y[999] == pytest.approx(TRUE["map.high"] + side * half, abs=1e-9)
    assert y[-1] == pytest.approx(TRUE["map.low"] - side * half, abs=1e-9)


def test_a_driver_moves_the_break_away_voltage_by_its_dead_zone():
    chain = actuated_joint(knots=9, driver="dead_zone", fixed={"driver": [-0.4, 0.7]})
    data, _ = record(actuated_joint(knots=9), 0)
    theta = theta_of(chain)
    theta[:2] = -0.4, 0.7
    fit = sysid.fit(chain, data, search="lm", start=theta, options=sysid.Options(max_iterations=1))
    moved = replace(fit, theta=theta)
    values = {v.name: v.value for v in joint_values(moved)}
    assert values["breakaway_up"] == pytest.approx(1.9 + 0.7)
    assert values["breakaway_down"] == pytest.approx(-2.6 - 0.4)


def test_several_experiments_share_one_motor():
    chain = actuated_joint(knots=9)
    parts = []
    for seed in (1, 2):
        data, _ = record(chain, seed)
        parts.append(data.split(0.5)[1])  # each begins in the middle of a movement
    fit = sysid.fit(chain, IOData.merge(*parts), search="lm", starts=4, seed=0)
    values = {v.name: v.value for v in joint_values(fit)}
    assert values["end_low"] == pytest.approx(-0.9, abs=np.deg2rad(0.3))
    assert values["speed_per_volt"] == pytest.approx(expected(chain)["speed_per_volt"], rel=0.02)
    assert fit.criteria.loss == pytest.approx(NOISE**2, rel=0.1)


def test_parts_can_be_dropped_and_frozen():
    plain = actuated_joint(motor=Motor(load=0, delayed=False, stops=False), knots=None, play=False)
    assert plain.names == ("motor.gain", "motor.lag", "motor.rise", "motor.fall", "motor.x0", "motor.v0")
    held = actuated_joint(knots=9, fixed={"play": [0.0], "motor.lag": 0.5})
    assert held.fixed["play.width"] == 0.0
    assert "motor.lag" not in [n for n, free in zip(held.names, held.free, strict=True) if free]
    with pytest.raises(InputError, match="needs a load"):
        Motor(load=0, loss=True)
    data, _ = record(plain, 0)
    linear = sysid.fit(sysid.structures.output_error(1, 1, 1), data, starts=1)
    with pytest.raises(InputError, match="no motor"):
        joint_values(linear)


@pytest.fixture(scope="module")
def fitted() -> tuple[sysid.Fit, IOData]:
    """A fit near the truth, and its record."""
    chain = actuated_joint(knots=9)
    data, _ = record(chain, 0)
    return sysid.fit(chain, data, search="lm", start=theta_of(chain)), data


def halves(fit: sysid.Fit, **options) -> dict[str, float]:
    """Half width of every interval, as far as no limit cuts it off."""
    return {v.name: v.high - v.value for v in joint_values(fit, **options) if v.high is not None}


def ends_off_line(fit: sysid.Fit, linearity: float, draws: int = 200_000) -> dict[str, float]:
    """Standard deviations that a sensor leaves in ends and speed whose error is a sine of place, its phase unknown."""
    value = dict(zip(fit.model.names, fit.theta, strict=True))
    shares = [0.0, *(value[f"map.s{k}"] for k in range(1, 8)), 1.0]
    place = CubicSpline(KNOTS, shares, bc_type="natural")
    rng = np.random.default_rng(1)
    wrong = linearity * np.sin(rng.uniform(0.0, 2.0 * np.pi, (2, draws)))
    angle = [value["map.low"] + (value["map.high"] - value["map.low"]) * place(x) for x in (0.4, 0.6)]
    speeds = value["motor.gain"] / TS * (angle[1] + wrong[1] - angle[0] - wrong[0]) / 0.2
    return {"end_low": wrong[0].std(), "end_high": wrong[1].std(), "speed_per_volt": speeds.std()}


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize(("level", "quantile"), [(0.95, 1.959964), (0.6826895, 1.0)])
def test_a_sensor_off_a_straight_line_widens_what_is_said_of_ends_and_speed(
    fitted: tuple[sysid.Fit, IOData], level: float, quantile: float, coloured: bool
) -> None:
    fit, data = fitted
    options = {"level": level, "data": data if coloured else None}
    linearity = 0.02 if coloured else 0.004  # with a record, intervals allow for what models lack, and are wider
    before, after = halves(fit, **options), halves(fit, linearity=linearity, **options)
    off_line = ends_off_line(fit, linearity)
    for name, half in before.items():
        share = quantile * off_line.get(name, 0.0)
        # 0.3 %: of 200 000 draws.
        assert after[name] == pytest.approx(np.sqrt(half**2 + share**2), rel=0.003 if share else 1e-12), name
    assert all(after[name] > 1.2 * before[name] for name in off_line)
    assert {"backlash", "coulomb_up", "end_low"} <= set(before)
    values = [{v.name: v.value for v in joint_values(fit, linearity=x)} for x in (0.0, 0.004)]
    assert values[0] == values[1]


def test_a_straight_sensor_changes_nothing_and_an_impossible_one_is_refused(fitted: tuple[sysid.Fit, IOData]) -> None:
    fit, _ = fitted
    assert joint_values(fit, linearity=0.0) == joint_values(fit)
    for wrong in (-0.001, np.nan, np.inf):
        with pytest.raises(InputError, match="the largest deviation of the sensor from a straight line"):
            joint_values(fit, linearity=wrong)


def test_the_width_of_a_coasting_play_is_its_backlash() -> None:
    chain = actuated_joint(knots=9, play=CoastingPlay())
    data, _ = record(actuated_joint(knots=9), 0)
    theta = theta_of(chain)
    theta[chain.names.index("play.drag")] = 0.002
    fit = sysid.fit(chain, data, search="lm", start=theta, options=sysid.Options(max_iterations=1))
    found = {v.name: v for v in joint_values(fit)}
    assert found["backlash"].value == fit.theta[chain.names.index("play.width")]
    assert found["backlash"].low < found["backlash"].value < found["backlash"].high
    assert "backlash" not in {
        v.name for v in joint_values(sysid.fit(actuated_joint(knots=9, play=False), data, starts=1))
    }


@pytest.mark.parametrize(("way", "starts"), [(1.0, 1.0 + 0.6), (-1.0, 1.5 + 0.2)])
def test_friction_at_rest_by_direction_holds_the_motor_until_its_own_voltage(way: float, starts: float) -> None:
    """rise + stick upward, fall + stick_down downward; voltages by hand, a little below and above."""
    motor = Motor(load=0, stribeck=True, sided=True, stops=False, delayed=False, role="motor")
    values = {"gain": 0.1, "lag": 1.0, "rise": 1.0, "fall": 1.5, "stick": 0.6, "stick_down": 0.2, "stick_speed": 0.01}
    theta = np.array([values.get(slot.name, 0.0) for slot in motor.slots()])
    for volts, moves in ((starts - 0.01, False), (starts + 0.01, True)):
        gone = way * Chain((motor,)).simulate(theta, np.full(50, way * volts)).ravel()[-1]
        assert (gone > 0.0) == moves
