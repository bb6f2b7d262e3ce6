"""The core of a calibration against systems with closed-form responses."""

import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.calibrate.problem import LEVEL, Free, Record, Simulations, noise_of
from twin.calibrate.search import find_optimum

T = np.arange(0.0, 6.0, 0.02)


def ramp_hold(values):
    """A mass on dry friction, pulled by a spring whose end moves at speed v: it stays until k v t exceeds friction.

    Closed form without inertia: x = max(v t - F / k, 0) with parameters F, v and initial position x0 of the mass.
    """
    F, v, x0 = values.T[:, :, None]
    return x0 + np.maximum(v * T - F / 10.0, 0.0)


def problem(F=0.0, v=1.0, noise=1e-3, truth=(4.0, 1.3, 0.2), seed=5):
    y = ramp_hold(np.array([truth]))[0] + noise * np.random.default_rng(seed).standard_normal(len(T))
    shared = (Free("F", F, 0.0, 50.0, "N", 1.0), Free("v", v, 0.01, 10.0, "m/s", 0.5))
    return Simulations(shared, [Record("a", y, 0.02, ramp_hold, (Free("x0", 0.0, -1.0, 1.0, "m", 0.1),))])


def test_friction_leaves_zero():
    found = find_optimum(problem(), np.random.default_rng(0))
    values = problem().values(found.p)
    assert found.stop.converged
    assert np.all(np.abs(values - [4.0, 1.3, 0.2]) < [0.01, 0.002, 0.001])


def test_jacobian_is_the_closed_form_one_and_steps_change_the_response_by_the_aim():
    # dx/dF = -1/10 and dx/dv = t where the mass slides, dx/dx0 = 1; inner coordinates multiply by their slopes.
    task = problem(F=3.0, v=1.2)
    p = task.start
    task.linearise(p)
    task._linear = None
    _, J = task.linearise(p)
    slides = T > 3.0 / 10.0 / 1.2
    exact = np.column_stack([np.where(slides, -0.1, 0.0), np.where(slides, T, 0.0), np.ones(len(T))]) * task.slopes(p)
    away = np.abs(T - 3.0 / 12.0) > 0.05  # at the kink a finite step is in both branches
    np.testing.assert_allclose(J[away], exact[away], rtol=2e-3, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.mean(J**2, axis=0)) * task.steps, LEVEL * task.noise, rtol=0.05)


@pytest.mark.parametrize("first", [1e-5, 2.0])
def test_a_step_that_is_far_off_is_made_anew(first):
    """Whatever the first step, the column is the derivative: x0 is linear, F acts from where it lets go."""
    task = problem(F=3.0, v=1.2)
    task.steps[:] = first
    _, J = task.linearise(task.start)
    assert J[-1, 0] == pytest.approx(-0.1 * task.slopes(task.start)[0], rel=0.02)
    assert J[0, 2] == pytest.approx(0.1, rel=1e-6)


def test_a_step_at_a_bound_points_inward():
    """At its upper bound a parameter still has a derivative, and the response is never asked beyond the bound."""
    asked = []

    def respond(values):
        asked.append(values[:, 0])
        return values[:, :1] * T

    y = 2.0 * T
    task = Simulations([Free("a", 2.0, 0.0, 2.0, "1", 1.0)], [Record("r", y, 0.02, respond)], noise=0.01)
    _, J = task.linearise(task.start)
    assert np.concatenate(asked).max() <= 2.0
    np.testing.assert_allclose(J[:, 0], 3.0 * T, rtol=0.02)  # d value / d coordinate is scale + value


def test_own_parameters_act_in_their_record_alone():
    y = np.zeros(len(T))
    own = (Free("x0", 0.0, -1.0, 1.0, "m", 0.1),)
    shared = (Free("F", 1.0, 0.0, 50.0, "N", 1.0), Free("v", 1.0, 0.01, 10.0, "m/s", 0.5))
    task = Simulations(shared, [Record(name, y, 0.02, ramp_hold, own) for name in "ab"], noise=1e-3)
    _, J = task.linearise(task.start)
    assert J.shape == (2 * len(T), 4)
    assert not J[: len(T), 3].any()
    assert not J[len(T) :, 2].any()
    assert J[len(T) :, 3].all()


def test_noise_is_found_beside_motion_and_on_rounded_rest():
    rng = np.random.default_rng(1)
    y = np.sin(0.5 * T) + 0.01 * rng.standard_normal(len(T))
    assert noise_of(y) == pytest.approx(0.01, rel=0.2)
    flat = np.zeros(400)
    flat[::40] = 0.1  # ten codes off: second differences 0.1, -0.2, 0.1, so RMS^2 is 10 * 6 * 0.01 / 398
    assert noise_of(flat) == pytest.approx(np.sqrt(10 * 0.01 / 398), rel=0.1)


def test_a_start_outside_its_bounds_is_refused():
    with pytest.raises(InputError, match="give a start from 0 to 1"):
        Free("a", 2.0, 0.0, 1.0, "N", 1.0)
