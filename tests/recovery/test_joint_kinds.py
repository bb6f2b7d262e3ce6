"""Joints of every kind, drawn at random, come back from their noisy records and starts made of data alone."""

import numpy as np
import pytest
from often import FULL

import sysid
from sysid.base.errors import InputError
from sysid.blocks import Compliance, Motor
from sysid.data.record import IOData
from sysid.structures import actuated_joint
from sysid.structures.actuated_joint import ActuatedJoint

N, TS = 1500, 0.05
KINDS = {  # recipe, and what of it is drawn besides the motor: name, least, most
    "pendulum": (
        ActuatedJoint(load="periodic", stops="none"),
        {"sine1": (1.0, 4.0), "cosine1": (-1.0, 1.0), "sine2": (-1.0, 1.0), "cosine2": (-1.0, 1.0)},
    ),
    "spring": (ActuatedJoint(load="spring", stops="none"), {"load1": (2.0, 12.0)}),
    "one_stop": (ActuatedJoint(load="none", stops="lower"), {"lower": (-0.6, -0.2)}),
    "soft": (
        ActuatedJoint(load="none", stops="none", compliance="on"),
        {"omega": (0.3, 1.5), "damping": (0.05, 0.4)},
    ),
    "soft_spring": (
        ActuatedJoint(load="spring", stops="none", compliance="on"),
        {"load1": (2.0, 12.0), "omega": (0.3, 1.5), "damping": (0.05, 0.4)},
    ),
}
MOTOR = {"gain": (0.002, 0.008), "rise": (0.5, 2.5), "fall": (0.5, 2.5), "delay": (0.0, 2.5), "lag": (0.3, 8.0)}


def drawn(kind: str, seed: int) -> tuple[sysid.Chain, np.ndarray, IOData, float]:
    """A joint, its theta, its record with noise of 0.2 % of the output, and that noise."""
    recipe, more = KINDS[kind]
    chain, rng = recipe.model(), np.random.default_rng([seed, len(kind)])
    value = {name: rng.uniform(*limits) for name, limits in (MOTOR | more).items()}
    value["gain"] *= 6.0 if recipe.load == "periodic" else 1.0
    theta = np.array([chain.fixed.get(n, value.get(n.split(".")[1], 0.0)) for n in chain.names])
    u = np.repeat(rng.uniform(-12.0, 12.0, N), rng.integers(3, 40, N))[:N]
    y = chain.simulate(theta, u)
    noise = 0.002 * float(np.std(y))
    return chain, theta, IOData(u, y + noise * rng.normal(size=N), TS), noise


def found(kind: str, seed: int) -> tuple[float, dict[str, float]]:
    """Residual of the fit by the noise, and how far every value is off: in parts of itself, or in standard errors."""
    chain, theta, data, noise = drawn(kind, seed)
    with np.errstate(over="ignore", invalid="ignore"):  # a start may run away
        fit = sysid.fit(chain, data, search="lm", starts=4, seed=0)
    own = {n: k for k, n in enumerate(chain.names) if chain.free[k] and not chain.initial[k]}
    if "motor.lower" in own and not np.any(chain.simulate(theta, data.u[:, 0]) == theta[own["motor.lower"]]):
        del own["motor.lower"]  # never met
    std = {p.name: p.std for p in fit.parameters}
    sizes = {n: max(0.02 * abs(theta[k]), 4.0 * std[n]) for n, k in own.items()}
    return float(np.sqrt(fit.criteria.mse)) / noise, {
        n: abs(fit.theta[k] - theta[k]) / sizes[n] for n, k in own.items()
    }


@pytest.mark.parametrize("kind", KINDS)
def test_a_drawn_joint_comes_back(kind):
    for seed in range(2):
        ratio, off = found(kind, seed)
        assert ratio < 1.1
        assert max(off.values()) < 1.0, off


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_nineteen_of_twenty_drawn_joints_come_back(kind, seeds):
    ratios = [found(kind, 100 + seed)[0] for seed in (seeds if FULL else seeds[::3])]
    assert np.mean(np.array(ratios) < 1.1) >= 0.95, ratios


def test_settings_make_the_blocks_that_they_name():
    chain = ActuatedJoint(load="periodic", stops="upper", compliance="on", period=360.0).model()
    motor, link = chain.blocks
    assert isinstance(motor, Motor)
    assert (motor.load, motor.periodic, motor.period, motor.ends) == (0, 2, 360.0, ("upper",))
    assert isinstance(link, Compliance)
    assert set(chain.fixed) == {"motor.v0", "link.lead0", "link.speed0"}
    spring = ActuatedJoint(load="spring").model()
    low, _ = spring.limits
    assert low[spring.names.index("motor.load1")] == 0.0
    assert spring.fixed["motor.upper"] == 1.0
    assert ActuatedJoint().model() == actuated_joint(play=False)
    half = actuated_joint(motor=Motor(stops="upper"), play=False)
    assert half.fixed["motor.upper"] == 1.0
    assert "motor.lower" not in half.names


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"load": "spline"}, "load of a joint"),
        ({"stops": "left"}, "stops"),
        ({"compliance": "soft"}, "compliance"),
        ({"period": 360.0}, "give load periodic"),
    ],
)
def test_settings_that_make_no_joint_are_refused(settings, words):
    with pytest.raises(InputError, match=words):
        ActuatedJoint(**settings)
