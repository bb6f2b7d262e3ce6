"""Exported blocks with a memory and switches against the chain's own run: delays, stops, stick, jam, free flight."""

import re

import numpy as np
import pytest
from cases import BLOCKS, MOVING
from exported import JOINTS, agrees, c_run, excitation, made, python_run, python_space, structure_fit, sweep
from often import often

from sysid.block.compiler.recursion import Written
from sysid.block.writing import Writer
from sysid.blocks import (
    STATIC,
    CoastingPlay,
    Delay,
    FrictionLag,
    LimitedIntegrator,
    Motor,
    Play,
    Process,
    ProfiledMotor,
    TransferFunction,
    TravelMap,
)
from sysid.blocks.motor import MOST_LOSS
from sysid.export import c as export_c
from sysid.export import closed_form
from sysid.export import python as export_python
from sysid.model.chain import Chain

FULL = {
    **{"gain": 0.08, "lag": 0.6, "rise": 0.3, "fall": 0.4, "stick": 0.3, "stick_speed": 0.1, "stick_down": 0.15},
    **{"load0": -0.1, "load1": 0.2, "load2": 0.15, "loss": 0.5, "jam": 60.0, "delay": 1.37},
    **{"lower": 0.05, "upper": 1.1, "x0": 0.4, "v0": 0.1},
}


def motor(substeps=1, delay=FULL["delay"], **options):
    """A motor with these options and what it takes of FULL."""
    block = Motor(substeps=substeps, role="part", **options)
    return block, np.array([{**FULL, "delay": delay}[s.name] for s in block.slots()])


def coasting(*values):
    """A link of this width, rest, drag and pull (2)."""
    return CoastingPlay(role="part"), np.array(values)


# inertia, drag_up, drag_down, rise (5), fall (5), x0, v0: slow enough to stay about the profile, tight in its middle
PROFILE = np.array([30.0, 20.0, 19.0, 0.3, 0.5, 1.4, 0.5, 0.2, 0.4, 0.1, 1.2, 0.35, 0.3, 0.4, 0.01])
OPTIONS = {
    "coasting_play_even": coasting(0.8, 0.2, 0.15, 0.0, 0.0),
    "coasting_play_free": coasting(0.8, -0.5, 0.0, 0.0, 0.0),
    "coasting_play_hangs": coasting(0.8, -0.3, 0.1, 0.3, 0.0),
    "coasting_play_none": coasting(0.0, 0.0, 0.1, 0.1, 0.1),
    "coasting_play_tips": coasting(0.8, 0.2, 0.1, 0.05, -0.1),
    "coasting_play_wide": coasting(2.0, 0.4, 0.05, 0.06, 0.02),
    "delay_none": (Delay(role="part"), np.array([0.0])),
    "delay_part": (Delay(role="part"), np.array([0.25])),
    "delay_whole": (Delay(role="part"), np.array([12.0])),
    "friction_lag_coarse": (FrictionLag(substeps=1, role="part"), np.array([-0.3, 0.1, 0.2, 0.6, -0.15])),
    "limited_integrator_beyond": (LimitedIntegrator(role="part"), np.array([-0.3, -0.6, 0.5, 0.7])),
    "motor_jams_all": motor(jams=True, load=3, loss=True, stribeck=True, substeps=3),
    "motor_jams_now": motor(jams=True, load=0, delayed=False),
    "motor_lossy": motor(load=1, loss=True),
    "motor_no_delay": motor(delayed=False, load=2),
    "motor_no_stops": motor(stops=False, load=2, loss=True, at=0.3),
    "motor_part": motor(delay=0.5, load=0, substeps=2),
    "motor_sided": motor(load=0, stribeck=True, sided=True, substeps=4),
    "motor_sticky": motor(load=0, stribeck=True, substeps=4),
    "motor_swings": (
        Motor(load=1, stops="upper", periodic=2, period=3.0, role="part"),
        np.array([0.08, 0.6, 0.3, 0.4, -0.1, 0.5, 0.2, -0.1, 0.3, 0.37, 1.1, 0.4, 0.1]),
    ),
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
    "travel_map_smooth_line": (TravelMap(2, smooth=True, role="part"), np.array([0.7, -0.4])),
}
CASES = {
    name: case
    for name, case in {**BLOCKS, **MOVING, **OPTIONS}.items()
    if isinstance(case[0], Written) and type(case[0]) not in STATIC.values()
}
# Those whose equations are one formula of the past.
FORMULAS = [
    name
    for name, (block, theta) in CASES.items()
    if len(lines := block.equations(theta, Writer("w", "x", None))) == 1 and lines[0].startswith("x(t) = ")
]


def run(fit, u):
    """The chain's own run from the fit's first positions, filters and speeds at rest, as in `Fit.simulate(u)`.

    A delay holds zeros from before: a sample of 0, from which on nothing moves, is the input before of a process.
    """
    moves = [slot.initial and not slot.holds for slot in fit.model.slots]
    before = [0.0] if isinstance(fit.model.blocks[0], Process) else []
    return fit.model.simulate(np.where(moves, 0.0, fit.theta), np.concatenate([before, u]))[len(before) :]


def record(block, N=900):
    """Holds of both signs with standstills between them; a profile is passed in a slow swing.

    A motor that jams is turned about before a stop lets it go, a link is driven at these speeds between two stops.
    """
    rng, n = np.random.default_rng(7), 3 if isinstance(block, Motor) and block.jams else 6
    levels = rng.choice([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0], N // n) * rng.choice([0.0, 1.0, 1.0], N // n)
    u = np.repeat(levels, n) * rng.uniform(0.9, 1.1, N)
    if isinstance(block, CoastingPlay):
        return Chain((LimitedIntegrator(),)).simulate(np.array([0.1, -3.0, 3.0, 0.0]), u)
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
        assert not np.isfinite(low) or np.sum(stands == low) >= 3
        assert not np.isfinite(high) or np.sum(stands == high) >= 3


@pytest.mark.parametrize("name", sorted(k for k, (b, _) in CASES.items() if isinstance(b, Motor) and b.jams))
def test_the_record_asks_for_a_jam(name):
    """Both stops keep the motor while the voltage that arrives would have it leave; not so without the jam."""
    block, theta = CASES[name]
    u = record(block)

    def kept(theta, stop, towards):
        """Samples over which it stays at `stop`, though each voltage of the last two draws it away."""
        x = Chain((block,)).simulate(theta, u)
        away = towards * u > 1.2
        return np.sum((x[2:-1] == stop) & (x[3:] == stop) & away[:-3] & away[1:-2] & away[2:-1])

    names = [s.name for s in block.slots()]
    free = np.where(np.array(names) == "jam", 0.0, theta)
    for stop, towards in ((block.value(theta, "lower"), 1.0), (block.value(theta, "upper"), -1.0)):
        assert kept(theta, stop, towards) >= 3
        assert kept(free, stop, towards) == 0


# Samples at the lower and upper side and in flight; how often the link comes to rest and turns about between the sides.
FLIGHTS = {
    "coasting_play": (50, 50, 50, 5, 0),
    "coasting_play_even": (50, 50, 50, 5, 0),
    "coasting_play_free": (50, 50, 50, 0, 0),
    "coasting_play_hangs": (50, 0, 50, 0, 0),
    "coasting_play_tips": (50, 50, 50, 5, 0),
    "coasting_play_wide": (50, 10, 50, 5, 5),
}


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_record_asks_for_what_a_coasting_link_has(name):
    block, theta = CASES[name]
    x = record(block)
    y, half = Chain((block,)).simulate(theta, x), 0.5 * theta[0]
    low, high, step = np.isclose(y, x - half), np.isclose(y, x + half), np.diff(y)
    between = ~low & ~high
    inside = between[:-2] & between[1:-1] & between[2:]
    rests = inside & (step[:-1] != 0.0) & (step[1:] == 0.0)
    turns = inside & (step[:-1] * step[1:] < 0.0)
    counts = [np.sum(each) for each in (low, high, between[1:] & (step != 0.0), rests, turns)]
    assert all(count >= least for count, least in zip(counts, FLIGHTS[name], strict=True)), counts


@pytest.mark.parametrize("name", ["profiled_motor_fine", "profiled_motor_flat", "profiled_motor_line"])
def test_the_record_asks_for_what_a_profile_has(name):
    """The motor leaves the profile at both ends, and it sticks."""
    block, theta = CASES[name]
    x = Chain((block,)).simulate(theta, record(block))
    assert x.min() < (block.low if block.knots > 1 else x[0])
    assert x.max() > block.high
    assert len(still(x)) >= 5


@pytest.mark.parametrize("name", JOINTS)
def test_a_whole_joint_on_a_sweep(name, tmp_path):
    fit, _ = structure_fit(f"joint_{name}")
    chain = fit.model
    u = sweep(2500)
    expected = run(fit, u)
    if chain.block("map") is not None:
        ahead = chain.blocks[: chain.blocks.index(chain.block("motor")) + 1]
        stands = still(Chain(ahead).simulate(fit.theta[: chain.index(ahead[-1]).stop], u))
        assert min(np.sum(stands == 0.0), np.sum(stands == 1.0)) >= 2
        assert np.sum((stands > 0.0) & (stands < 1.0)) >= 1
    agrees(python_run(fit, u), expected)
    agrees(c_run(fit, u, tmp_path), expected)


def test_positions_begin_where_the_fit_has_them_and_what_moves_at_rest(tmp_path):
    """x0 is where the joint stands, not a rest of every record; speeds and a filter's past are its record's."""
    block, theta = BLOCKS["motor"]
    chain = Chain((block, TransferFunction(1, 1, 1, role="sensor")))
    fit, u = made(chain, np.concatenate([theta, [0.3, -0.7, 0.7]])), excitation()
    agrees(python_run(fit, u), run(fit, u))
    agrees(c_run(fit, u, tmp_path), run(fit, u))
    assert fit.theta[chain.names.index("map.v0")] != 0.0
    assert python_space(fit)["Model"]().block1_map[:2] == [0.4, 0.0]
    np.testing.assert_array_equal(run(fit, u), fit.simulate(u))
    assert {"map.position", "map.speed"} < {state.name for state in export_c.written_source(fit, "knee").states}
    assert "# position, speed, ..." in export_python.source(fit)


def test_a_second_model_knows_nothing_of_the_first():
    space = python_space(made(Chain((BLOCKS["motor"][0],)), BLOCKS["motor"][1]))
    u = excitation().tolist()
    assert space["simulate"](u) == space["simulate"](u)


@pytest.mark.parametrize("seed", often(40, 10))
def test_any_motor_with_everything(seed):
    """Numbers from far apart: lags from a thousandth of a sample to twenty, delays up to four samples."""
    rng = np.random.default_rng(seed)
    block = Motor(load=3, loss=True, stribeck=True, jams=True, substeps=int(rng.integers(1, 4)), role="part")
    own = {name: abs(value) * np.exp(rng.normal()) for name, value in FULL.items()}
    own |= {"lag": np.exp(rng.uniform(np.log(1e-3), np.log(20.0))), "delay": rng.uniform(0.0, 4.0)}
    own |= {"loss": rng.uniform(0.0, MOST_LOSS), "jam": np.exp(rng.uniform(np.log(0.1), np.log(100.0)))}
    own["lower"], own["upper"] = sorted((own["lower"], own["upper"]))
    theta = np.array([own[s.name] for s in block.slots()])
    assert block.admissible(theta)
    fit, u = made(Chain((block,)), theta), excitation()
    agrees(python_run(fit, u), run(fit, u))


@pytest.mark.parametrize("name", FORMULAS)
def test_formula_of_a_recursion_evaluates_to_it(name):
    block, theta = CASES[name]
    (line,) = block.equations(theta, Writer("w", "x", None))
    left, _, right = line.partition(" = ")
    assert left == "x(t)"
    u = excitation(N=60)
    expected = Chain((block,)).simulate(theta, u)
    past = {"w": u, "x": expected}
    for t in range(20, 60):  # after the longest delay
        space = {k: v.__getitem__ for k, v in past.items()}
        assert eval(right, {**space, "t": t}) == pytest.approx(expected[t], abs=1e-12)


def test_motion_in_words():
    """Every number of a motor stands in its text, and what it does not have does not."""
    block, theta = motor(load=3, loss=True, stribeck=True, jams=True, substeps=3)
    text = closed_form.text(made(Chain((block,)), theta))
    for name, value in zip([s.name for s in block.slots() if not s.initial], theta, strict=False):
        assert re.search(rf"\b{abs(value):g}\b", text), name
    assert "0.6*v' + v = 0.08*(u - L - F), y' = v" in text
    assert "R = 0.3*exp(-(v/0.1)^2) + 0.5*|L|" in text
    assert "L is that in the middle of the way over each of 3 equal parts of a held input" in text
    assert "v in R is that at the start of each of 3 equal parts" in text
    assert "becomes 0 and stays 0 for a time 60*|v| after an impact at speed v" in text
    block, theta = motor(load=0, delayed=False, stops=False)
    plain = closed_form.text(made(Chain((block,)), theta))
    assert "middle" not in plain
    assert not re.search(r"\bL\b|\bR\b|ends|late|blow", plain)


def test_a_coasting_link_in_words():
    text = closed_form.text(made(Chain((coasting(0.8, 0.2, 0.15, 0.05, 0.1)[0],)), [0.8, 0.2, 0.15, 0.05, 0.1]))
    assert "v' = -P - 0.15*sign(v), y' = v, time in samples, while u(t) - 0.4 <= y(t) <= u(t) + 0.4" in text
    assert "P = 0.05 + 0.1*y" in text
    assert "v stays 0 where |P| <= 0.15" in text
    assert "there v = u(t) - u(t-1)" in text
