"""Further parts of a motor: each against scipy's solution of its equation, and found in a record of a joint with it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sysid.base.errors import InputError
from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.excitations import Aprbs, Sweep
from sysid.export.mjcf import fragment
from sysid.joint.posterior import fit_joint
from sysid.motor_parts import TABLE
from sysid.structures import actuated_joint

PLAIN = {"motor.gain": 0.004, "motor.lag": 1.5, "motor.rise": 1.2, "motor.fall": 1.5}
# Air that takes 4 V at full speed; a winding that warms by 60 % at 6 V.
VALUES = {
    "windage": {"motor.windage": 4.0 / 0.03**2},
    "warming": {"motor.warmth": 0.6 / 36.0, "motor.warm_time": 80.0},
}
TS = 0.1


def chain_with(part: str | None, substeps: int = 4) -> tuple:
    further = () if part is None else (part,)
    motor = Motor(load=0, stops=False, delayed=False, substeps=substeps, further=further)
    chain = actuated_joint(motor=motor, knots=None, play=False)
    values = PLAIN | (VALUES[part] if part else {})
    return chain, np.array([values.get(name, 0.0) for name in chain.names])


def motion(part: str, u: np.ndarray) -> np.ndarray:
    """Positions of a motor that never rests, written down as a differential equation and solved sample by sample."""
    p = {name.split(".")[1]: value for name, value in (PLAIN | VALUES[part]).items()}

    def slope(time, state, w):
        _, v, heat = state
        emf = v / p["gain"]
        current = (w - emf) / (1.0 + heat)
        warms = (p.get("warmth", 0.0) * current**2 - heat) / p.get("warm_time", 1.0)
        drag = np.sign(w) * (p["rise"] if w > 0.0 else p["fall"]) + p.get("windage", 0.0) * v * abs(v)
        return [v, (p["gain"] * (emf + (w - emf) / (1.0 + heat) - drag) - v) / p["lag"], warms]

    state, places = np.zeros(3), []
    for w in u:
        places.append(state[0])
        state = solve_ivp(slope, (0.0, 1.0), state, args=(w,), rtol=1e-9, atol=1e-12).y[:, -1]
    return np.array(places)


@pytest.mark.parametrize("part", TABLE)
def test_a_part_moves_as_its_equation_says_to_first_order_in_the_parts_of_a_sample(part):
    u = np.repeat([9.0, 5.0, 12.0], 40)
    true = motion(part, u)
    plain, theta = chain_with(None)
    away = np.abs(plain.simulate(theta, u) - true).max()
    errors = []
    for substeps in (8, 16, 32):
        chain, theta = chain_with(part, substeps)
        errors.append(np.abs(chain.simulate(theta, u) - true).max())
    assert errors[0] < 0.05 * away
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.3)


@pytest.mark.parametrize("part", TABLE)
def test_a_part_that_a_joint_has_is_shown_and_one_that_it_has_not_is_not(part):
    rng = np.random.default_rng(7)
    u = np.concatenate([Sweep(12.0, 4.0, jitter=0.5).generate(600, TS, rng), Aprbs(12.0).generate(600, TS, rng)])
    (shown,) = (slot.name for slot in TABLE[part].slots if slot.name == TABLE[part].shown)
    for present in (True, False):
        chain, theta = chain_with(part if present else None)
        y = chain.simulate(theta, u)
        data = IOData(u, y + 0.001 * np.std(y) * rng.standard_normal(len(u)), TS, u_unit="V", y_unit="rad")
        plain = actuated_joint(motor=Motor(load=0, stops=False, delayed=False), knots=None, play=False)
        joint = fit_joint(data, plain, parts=("stribeck", part))
        assert (f"motor.{shown}" in joint.shown) is present, joint.parts
        if present:
            values = dict(zip(joint.fit.model.names, joint.fit.theta, strict=True))
            assert values[f"motor.{shown}"] == pytest.approx(VALUES[part][f"motor.{shown}"], rel=0.15)
            assert TABLE[part].words in " ".join(fragment(joint.fit, "joint", 1.0).left_out)


def test_a_part_that_is_not_there_is_refused_by_name():
    with pytest.raises(InputError, match="unknown part of a motor 'rust'; choose one of windage, warming"):
        Motor(further=("rust",))
