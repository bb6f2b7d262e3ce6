"""A linkage and a lever against triangles solved for their angle by bisection, and the twin's own legs."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from sysid.base.errors import InputError
from sysid.blocks import Linkage, Motor
from sysid.joint.physics import volts_to_move
from sysid.structures import actuated_joint
from twin.ensemble import Draws
from twin.hardware import linkage as legs
from twin.parameters import Parameters

PLACES = np.linspace(0.0, 1.0, 41)


class Triangle:
    """Pins at `base` and `rod` from the axis, an actuator of `shortest` + x `stroke` between them, by coordinates."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 41])
        self.base, self.rod = rng.uniform(0.05, 0.3, 2)
        self.ends = np.sort(rng.uniform(0.05, np.pi - 0.05, 2))
        self.shortest, longest = (self._distance(a) for a in self.ends)
        self.stroke = longest - self.shortest

    def _distance(self, angle: float) -> float:
        return float(np.hypot(self.base - self.rod * np.cos(angle), self.rod * np.sin(angle)))

    def angle(self, x: float) -> float:
        length = self.shortest + x * self.stroke
        return float(brentq(lambda a: self._distance(a) - length, 0.0, np.pi, xtol=1e-14))

    def theta(self, low: float, high: float) -> np.ndarray:
        return np.array([low, high, *self.ends, self.stroke / (self.shortest + 0.5 * self.stroke)])


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("retracts", [False, True])
def test_a_linkage_is_the_triangle_also_near_a_dead_centre(seed: int, retracts: bool) -> None:
    triangle = Triangle(seed)
    theta = triangle.theta(-0.3, 0.9)
    angles = np.array([triangle.angle(1.0 - x if retracts else x) for x in PLACES])
    if retracts:  # the supplement of the enclosed angle opens
        angles = np.pi - angles
        theta[2:] = np.pi - theta[3], np.pi - theta[2], -theta[4]
    expected = -0.3 + 1.2 * (angles - theta[2]) / (theta[3] - theta[2])
    np.testing.assert_allclose(Linkage().output(theta, PLACES), expected, rtol=0, atol=1e-11)


def test_a_linkage_that_hardly_swings_is_straight_and_goes_on_straight_beyond_its_ends() -> None:
    x = np.linspace(-0.5, 1.5, 201)
    y = Linkage().output(np.array([0.2, 1.4, 1.55, 1.6, 0.0]), x)
    np.testing.assert_allclose(y, 0.2 + 1.2 * x, rtol=0, atol=3e-4)
    theta, h = np.array([0.2, 1.4, 0.4, 2.9, 0.5]), 1e-6
    ends, slopes = np.array([0.0, 1.0]), np.array([-1.0, 1.0])
    inner = (Linkage().output(theta, ends) - Linkage().output(theta, ends - slopes * h)) / (slopes * h)
    beyond = Linkage().output(theta, ends + 0.3 * slopes)
    np.testing.assert_allclose(beyond, Linkage().output(theta, ends) + 0.3 * slopes * inner, rtol=1e-4)


@pytest.mark.parametrize("joint", ["thigh", "shank"])
@pytest.mark.parametrize("seed", range(20))
def test_the_legs_of_the_twin_are_linkages(joint: str, seed: int) -> None:
    spread = {f"{joint}.{n}": 0.1 for n in ("base_radius", "rod_radius", "retracted_length", "base_angle")}
    p = Draws(spread, seed=43).draw(Parameters(), seed).parameters
    triangle, (shortest, longest) = legs.linkage(p, joint), legs.stroke(p, joint)
    angles = np.array([triangle.angle(shortest + x * (longest - shortest)) for x in PLACES])
    theta = np.array([angles[0], angles[-1], *(triangle.offset + angles[[0, -1]]), 0.0])
    theta[4] = 2.0 * (longest - shortest) / (longest + shortest)
    np.testing.assert_allclose(Linkage().output(theta, PLACES), angles, rtol=0, atol=1e-11)


@pytest.mark.parametrize("seed", range(10))
def test_a_lever_carries_torques_by_virtual_work(seed: int) -> None:
    """The voltage that starts it: a torque of the joint, and of its bearing, by the way of the joint per stroke."""
    triangle, rng = Triangle(seed), np.random.default_rng([seed, 47])
    torque, bearing, loss, rise, fall = rng.standard_normal(4), *rng.uniform(0.1, 1.0, 4)
    motor = Motor(load=4, lever=True, loss=True)
    chain = actuated_joint(motor=motor, play=False)
    low, high, *shape = triangle.theta(-0.3, 0.9)
    values = {"motor.gain": 0.01, "motor.lag": 1.0, "motor.rise": rise, "motor.fall": fall, "motor.loss": loss}
    values |= {f"motor.load{k}": c for k, c in enumerate(torque)} | {"motor.bearing": bearing, "motor.upper": 1.0}
    values |= {
        f"{r}.{n}": v for r in ("motor", "map") for n, v in zip(("angle0", "angle1", "stroke"), shape, strict=True)
    }
    values |= {"map.low": low, "map.high": high}
    theta = np.array([values.get(name, 0.0) for name in chain.names])
    swing = triangle.ends[1] - triangle.ends[0]
    for x in (0.02, 0.3, 0.5, 0.8, 0.98):
        s = (triangle.angle(x) - triangle.ends[0]) / swing
        arm = (triangle.angle(x + 1e-5) - triangle.angle(x - 1e-5)) / 2e-5 / swing
        load, hold = arm * np.polynomial.Polynomial(torque)(s - 0.5), arm * bearing
        up, down = load + hold + rise + loss * abs(load + hold), load - hold - fall - loss * abs(load - hold)
        found = [volts_to_move(chain, theta, way, True, x) for way in (1, -1)]
        np.testing.assert_allclose(found, [up, down], rtol=1e-6)
        # So does the motor's own step: 2 % less leaves it where it stands, 2 % more of what it takes starts it.
        theta[chain.names.index("motor.x0")] = x
        for way, volts in ((1, up), (-1, down)):
            for off, moves in ((-0.02, False), (0.02, True)):
                u = np.full(3, volts + way * off * (up - down))
                y = chain.simulate(theta, u)
                assert bool(way * (y[-1] - y[0]) > 0.0) is moves


def test_a_lever_without_stops_or_load_is_refused() -> None:
    for motor in ({"load": 0}, {"load": 2, "stops": "upper"}):
        with pytest.raises(InputError, match="both end stops"):
            Motor(lever=True, **motor)


def test_an_angle_or_a_bend_that_is_no_linkage_is_repaired() -> None:
    block = Linkage(bends=2)
    theta = np.array([0.0, 1.0, 1.2, 1.1, 0.3, 0.5, -0.4])
    assert not block.admissible(theta)
    repaired = block.repair(theta)
    assert block.admissible(repaired)
    assert np.all(np.diff(block.output(repaired, PLACES)) > 0.0)
    assert repaired[2:4].mean() == pytest.approx(1.15)


def test_a_lever_moves_as_its_equation_of_motion_says() -> None:
    """Against SciPy's integration, from 0.15 to 0.98 of a stroke that ends near a dead centre, to second order."""
    angle0, angle1, stroke = 1.2, 3.0, 0.4
    values = {"gain": 0.004, "lag": 3.0, "rise": 1.0, "fall": 1.0, "load0": -0.3, "load1": 0.8, "load2": 0.5}
    values |= {"load3": -0.6, "bearing": 0.3, "angle0": angle0, "angle1": angle1, "stroke": stroke, "loss": 0.5}
    values |= {"lower": 0.0, "upper": 1.0, "x0": 0.15, "v0": 0.0}

    def share(x: float) -> float:
        length = 1.0 / stroke - 0.5 + min(x, 1.0)  # by strokes; an integration looks beyond the end
        first, last = 1.0 / stroke - 0.5, 1.0 / stroke + 0.5
        part = (length**2 - first**2) / (last**2 - first**2)
        return float((np.arccos((1.0 - part) * np.cos(angle0) + part * np.cos(angle1)) - angle0) / (angle1 - angle0))

    def motion(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        slope = (share(x + 1e-6) - share(x - 1e-6)) / 2e-6
        away = share(x) - 0.5
        load = slope * (-0.3 + 0.8 * away + 0.5 * away**2 - 0.6 * away**3)
        drag = 1.0 + 0.3 * slope + 0.5 * abs(load + 0.3 * slope)
        return [v, (0.004 * (9.0 - load - drag) - v) / 3.0]

    N = 30
    known = solve_ivp(motion, (0.0, N), [0.15, 0.0], t_eval=np.arange(float(N)), rtol=1e-10, atol=1e-12).y[0]
    assert 0.95 < known[-1] < 1.0
    errors = []
    for substeps in (1, 2, 4):
        motor = Motor(load=4, lever=True, loss=True, delayed=False, substeps=substeps)
        theta = np.array([values[slot.name] for slot in motor.slots()])
        y = motor.propagate(theta, np.full(N, 9.0), np.zeros((N, 0)), 0)
        errors.append(np.abs(y - known).max())
    assert errors[0] < 2e-4
    assert min(errors[0] / errors[1], errors[1] / errors[2]) > 3.3
