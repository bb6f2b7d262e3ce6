"""Joints whose sensor counts the other way: the same record with the sign of its output changed is the same joint."""

import numpy as np
import pytest
from motion import Reference

import sysid
from sysid.data.record import IOData
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from sysid.structures.actuated_joint import joint_motor

TS, NOISE = 0.05, 0.1


def levels(N, largest, seed):
    rng, u = np.random.default_rng([seed, 51]), np.zeros(N)
    k = 0
    while k < N:
        n = int(rng.uniform(4, 30))
        u[k : k + n] = rng.uniform(-largest, largest) * (rng.random() > 0.15)
        k += n
    return u


def sweep(N, largest):
    t = np.arange(N) * TS
    return largest * np.sin(2 * np.pi * t * (0.05 + 0.2 * t / t[-1]))


def record(reference, u, sign, seed):
    y = sign * reference.run(u) + NOISE * np.random.default_rng([seed, 52]).standard_normal(len(u))
    return IOData(u, y, TS, u_unit="V", y_unit="deg")


def points_lost(fit, data):
    """Points of the free run's fit below what the noise allows."""
    e = data.y[:, 0] - np.ravel(fit.simulate(data))
    return 100.0 * (np.sqrt(np.mean(e**2)) - NOISE) / np.std(data.y)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("stops", ["none", "both"])
def test_a_pendulum_over_several_turns_fits_another_input_with_either_sign(sign, stops):
    pendulum = Reference(lambda x: 2.0 * np.sin(np.deg2rad(x)), gain=1.9, lag=1.2, rise=1.0, fall=1.2, delay=0.4, x0=0.0)
    joint = actuated_joint(motor=joint_motor("periodic", stops, 360.0), knots=None, play=False)
    found = sysid.fit_joint(record(pendulum, levels(1200, 8.0, 1), sign, 1), joint)
    assert points_lost(found.fit, record(pendulum, sweep(800, 7.0), sign, 2)) < 1.0


def test_a_joint_between_stops_has_the_mirror_image_of_its_values():
    """Up is where the output rises: what moved the joint up moves it down where its sensor counts the other way."""
    leg = Reference(gain=1.0, lag=1.0, rise=1.0, fall=1.6, delay=0.3, x0=10.0, lower=-10.0, upper=45.0)
    found = []
    for sign in (1.0, -1.0):
        data = record(leg, levels(1500, 8.0, 3), sign, 4)
        fit = sysid.fit_joint(data).fit
        found.append({value.name: value for value in joint_values(fit, data=data)})
    up, down = found
    for name, mirrored, factor in (
        *(("end_low", "end_high", -1.0), ("end_high", "end_low", -1.0), ("speed_per_volt", "speed_per_volt", -1.0)),
        *(("coulomb_up", "coulomb_down", 1.0), ("coulomb_down", "coulomb_up", 1.0)),
    ):
        assert up[name].value == pytest.approx(factor * down[mirrored].value, rel=0.03, abs=0.3)
    for value, truth in (("end_low", -45.0), ("end_high", 10.0), ("coulomb_up", -1.6), ("coulomb_down", 1.0)):
        assert down[value].value == pytest.approx(truth, rel=0.05, abs=0.2)
