"""Exported blocks with a memory and switches against the chain's own run: delays, stops, stick, parts of a sample."""

import re

import numpy as np
import pytest
from cases import BLOCKS, MOVING
from exported import agrees, c_run, excitation, made, python_run, python_space

from sysid import closed_form, export_c, export_python
from sysid.blocks import (
    Delay,
    FrictionLag,
    LimitedIntegrator,
    Motor,
    Play,
    ProfiledMotor,
    TransferFunction,
    TravelMap,
)
from sysid.chain import Chain
from sysid.excitations import Sweep
from sysid.export_motion_c import EMITTERS
from sysid.structures import actuated_joint

# gain, lag, rise, fall, stick, stick_speed, load0-2, loss, delay, lower, upper, x0, v0
FULL = np.array([0.08, 0.6, 0.3, 0.4, 0.3, 0.1, -0.1, 0.2, 0.15, 0.5, 1.37, 0.05, 1.1, 0.4, 0.1])


def motor(delay=None, substeps=1, **options):
    """A motor with these options and what it takes of FULL."""
    block = Motor(substeps=substeps, role="part", **options)
    own = dict(zip([s.name for s in Motor(load=3, loss=True, stribeck=True).slots()], FULL, strict=True))
    if delay is not None:
        own["delay"] = delay
    return block, np.array([own[s.name] for s in block.slots()])


# inertia, drag_up, drag_down, rise (5), fall (5), x0, v0: slow enough to stay about the profile, tight in its middle
PROFILE = np.array([30.0, 20.0, 19.0, 0.3, 0.5, 1.4, 0.5, 0.2, 0.4, 0.1, 1.2, 0.35, 0.3, 0.4, 0.01])
OPTIONS = {
    "delay_none": (Delay(role="part"), np.array([0.0])),
    "delay_part": (Delay(role="part"), np.array([0.25])),
    "delay_whole": (Delay(role="part"), np.array([12.0])),
    "friction_lag_coarse": (FrictionLag(substeps=1, role="part"), np.array([-0.3, 0.1, 0.2, 0.6, -0.15])),
    "limited_integrator_beyond": (LimitedIntegrator(role="part"), np.array([-0.3, -0.6, 0.5, 0.7])),
    "motor_lossy": motor(load=1, loss=True),
    "motor_no_delay": motor(delayed=False, load=2),
    "motor_no_stops": motor(stops=False, load=2, loss=True, at=0.3),
    "motor_part": motor(delay=0.5, load=0, substeps=2),
    "motor_sticky": motor(load=0, stribeck=True, substeps=4),
    "motor_whole": motor(delay=3.0, load=3),
    "motor_zero": motor(delay=0.0, load=0),
    "play_none": (Play(role="part"), np.array([0.0, 0.0])),
    "profiled_motor_fine": (ProfiledMotor(knots=5, low=-1.5, high=2.0, substeps=4, role="part"), PROFILE),
    "profiled_motor_flat": (
        ProfiledMotor(knots=1, role="part"),
        np.array([30.0, 20.0, 19.0, 0.6, 0.8, 0.4, 0.01]),
    ),
    "profiled_motor_line": (
        ProfiledMotor(knots=2, low=-1.0, high=2.0, role="part"),
        np.array([30.0, 20.0, 21.0, 0.3, 0.9, 1.1, 0.2, 0.4, 0.01]),
    ),
    "travel_map_line": (TravelMap(2, role="part"), np.array([0.7, -0.4])),
}
OWN = (*EMITTERS, TravelMap)
CASES = {k: v for k, v in {**BLOCKS, **MOVING, **OPTIONS}.items() if type(v[0]) in OWN}


def run(fit, u):
    """The chain's own run from the fit's first positions, its filters at rest as an exported file has them."""
    theta = fit.theta.copy()
    for part, _ in fit.model.dynamics:
        theta[part] = np.where(fit.model.initial[part], 0.0, theta[part])
    return fit.model.simulate(theta, u)


def record(block, N=900):
    """Holds of both signs with standstills between them; a profile is passed in a slow swing."""
    rng = np.random.default_rng(7)
    levels = rng.choice([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0], N // 6) * rng.choice([0.0, 1.0, 1.0], N // 6)
    u = np.repeat(levels, 6) * rng.uniform(0.9, 1.1, N)
    return 0.3 * u + 3.0 * np.cos(np.arange(N) / 20.0) if isinstance(block, ProfiledMotor) else u


@pytest.mark.parametrize("name", sorted(CASES))
def test_files_agree_with_the_chain(name, tmp_path):
    block, theta = CASES[name]
    fit, u = made(Chain((block,)), theta), record(block)
    expected = run(fit, u)
    agrees(python_run(fit, u), expected)
    agrees(c_run(fit, u, tmp_path), expected)


def still(x, length=3):
    """How often x (N,) begins to stand still for at least so many samples, and where it stands then."""
    held = np.convolve(np.diff(x) == 0.0, np.ones(length), "valid") == length
    begins = held & ~np.concatenate([[False], held[:-1]])
    return x[:-length][begins]


@pytest.mark.parametrize("name", sorted(k for k, (b, _) in CASES.items() if isinstance(b, Motor)))
def test_the_record_asks_for_what_a_motor_has(name):
    """It meets both stops and leaves them, it sticks between them, and it turns without sticking."""
    block, theta = CASES[name]
    chain = Chain((block,))
    x = chain.simulate(theta, record(block))
    low, high = (block.value(theta, "lower"), block.value(theta, "upper")) if block.stops else (-np.inf, np.inf)
    stands = still(x)
    assert np.sum((stands > low) & (stands < high)) >= 3
    assert np.sum(np.diff(x[:-1]) * np.diff(x[1:]) < 0.0) >= 5
    if block.stops:
        assert np.sum(stands == low) >= 3
        assert np.sum(stands == high) >= 3


@pytest.mark.parametrize("name", ["profiled_motor_fine", "profiled_motor_flat", "profiled_motor_line"])
def test_the_record_asks_for_what_a_profile_has(name):
    """The motor leaves the profile at both ends, and it sticks."""
    block, theta = CASES[name]
    x = Chain((block,)).simulate(theta, record(block))
    assert x.min() < (block.low if block.knots > 1 else x[0])
    assert x.max() > block.high
    assert len(still(x)) >= 5


# A joint as the real ones are: slow, with a load over position, a crooked linkage and a little play.
JOINT = {
    **{"motor.gain": 0.0019, "motor.lag": 0.55, "motor.rise": 1.9, "motor.fall": 2.6, "motor.delay": 0.3},
    **{"motor.load1": 0.7, "motor.load2": -0.4, "motor.upper": 1.0, "motor.x0": 0.45, "motor.loss": 0.3},
    **{"motor.stick": 0.8, "motor.stick_speed": 0.002, "motor.load0": -0.4},
    **{"map.low": -0.9, "map.high": 0.4, "play.width": 0.012, "play.rest": 0.2},
    **{f"map.s{k}": (k / 8) ** 1.15 for k in range(1, 8)},
    **{"driver.lower": -0.4, "driver.upper": 0.7},
}
JOINTS = {
    "plain": actuated_joint(),
    "with_everything": actuated_joint(driver="dead_zone", motor=Motor(load=3, loss=True, stribeck=True, substeps=3)),
    "without_stops": actuated_joint(motor=Motor(load=0, delayed=False, stops=False), knots=None, play=False),
}


@pytest.mark.parametrize("name", JOINTS)
def test_a_whole_joint_on_a_sweep(name, tmp_path):
    chain = JOINTS[name]
    fit = made(chain, [JOINT.get(n, 0.0) for n in chain.names])
    u = Sweep(12.0, 10.0, jitter=0.5, shrink=0.6).generate(2500, 0.1, np.random.default_rng([0, 11]))
    u[700:760] = 1.0  # less than friction: it sticks midway
    expected = run(fit, u)
    stands = still(expected)
    if chain.block("map") is not None:
        low, high = expected.min(), expected.max()  # the stops, each with half of the play
        assert high - low == pytest.approx(1.3 - 0.012)
        assert min(np.sum(stands == low), np.sum(stands == high)) >= 2
        assert np.sum((stands > low) & (stands < high)) >= 1
    agrees(python_run(fit, u), expected)
    agrees(c_run(fit, u, tmp_path), expected)


def test_positions_begin_where_the_fit_has_them_and_filters_at_rest(tmp_path):
    """x0 is where the joint stands, not a rest that every record shares; a filter's past belongs to its record."""
    block, theta = BLOCKS["motor"]
    chain = Chain((block, TransferFunction(1, 1, 1, role="sensor")))
    fit, u = made(chain, np.concatenate([theta, [0.3, -0.7, 0.7]])), excitation()
    agrees(python_run(fit, u), run(fit, u))
    agrees(c_run(fit, u, tmp_path), run(fit, u))
    assert python_space(fit)["Model"]().block1_map[:2] == [0.4, 0.1]
    assert "double block1_map[4]; /* position, speed, ... */" in export_c.source(fit)
    assert "# position, speed, ..." in export_python.source(fit)


def test_a_second_model_knows_nothing_of_the_first():
    space = python_space(made(Chain((BLOCKS["motor"][0],)), BLOCKS["motor"][1]))
    u = excitation().tolist()
    assert space["simulate"](u) == space["simulate"](u)


@pytest.mark.parametrize("seed", range(40))
def test_any_motor_with_everything(seed):
    """Numbers from far apart: lags from a thousandth of a sample to twenty, delays up to four samples."""
    rng = np.random.default_rng(seed)
    block = Motor(load=3, loss=True, stribeck=True, substeps=int(rng.integers(1, 4)), role="part")
    size = np.exp(rng.normal(size=15))
    theta = FULL * np.where(FULL < 0, -size, size)
    theta[1], theta[10] = np.exp(rng.uniform(np.log(1e-3), np.log(20.0))), rng.uniform(0.0, 4.0)
    theta[11:13] = np.sort(theta[11:13])
    assert block.admissible(theta)
    fit, u = made(Chain((block,)), theta), excitation()
    agrees(python_run(fit, u), run(fit, u))


@pytest.mark.parametrize("name", ["delay", "delay_none", "limited_integrator", "play"])
def test_formula_of_a_recursion_evaluates_to_it(name):
    block, theta = CASES[name]
    (line,) = closed_form.FORMULAS[type(block)](block, theta, closed_form.Writer("w", "x", None))
    left, _, right = line.partition(" = ")
    assert left == "x(t)"
    u = excitation(N=60)
    expected = Chain((block,)).simulate(theta, u)
    past = {"w": u, "x": expected}
    for t in range(5, 60):
        space = {k: v.__getitem__ for k, v in past.items()}
        assert eval(right, {**space, "t": t}) == pytest.approx(expected[t], abs=1e-12)


def test_motion_in_words():
    """Every number of a motor stands in its text, and what it does not have does not."""
    block, theta = motor(load=3, loss=True, stribeck=True, substeps=3)
    text = closed_form.text(made(Chain((block,)), theta))
    for name, value in zip([s.name for s in block.slots() if not s.initial], theta, strict=False):
        assert re.search(rf"\b{abs(value):g}\b", text), name
    assert "0.6*v' + v = 0.08*(u - L - F), y' = v" in text
    assert "R = 0.3*exp(-(v/0.1)^2) + 0.5*|L|" in text
    assert "L and R from the start of each of 3 equal parts" in text
    plain = closed_form.text(made(Chain((motor(load=0, delayed=False, stops=False)[0],)), FULL[[0, 1, 2, 3, 13, 14]]))
    assert not re.search(r"\bL\b|\bR\b|ends|late", plain)
