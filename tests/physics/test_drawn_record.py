"""The record drawn for the check of a joint's MJCF stays where the joint is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.blocks import Motor
from sysid.structures import actuated_joint
from twin.studies import write_back

TS = 0.05
WAY = 1.5  # of the joint: its map covers 10.2 to 11.7
VALUES = {"gain": 0.01, "lag": 0.6, "rise": 1.5, "fall": 1.0, "x0": 0.1, "v0": 0.0}
VALUES |= {"lower": 0.0, "upper": 1.0, "low": 10.2, "high": 11.7}


def record(stops):
    chain = actuated_joint(motor=Motor(load=0, delayed=False, stops=stops), knots=2, play=False)
    theta = np.array([VALUES[name.split(".")[1]] for name in chain.names])
    return write_back._drive_record(SimpleNamespace(model=chain, theta=theta, Ts=TS, origin=None))[0]


def test_a_joint_between_two_stops_meets_both_over_the_full_length():
    data = record(True)
    assert data.N == write_back.TURNS * 50
    assert np.ptp(data.y) == pytest.approx(WAY, rel=1e-6)


@pytest.mark.parametrize("stops", [False, "lower", "upper"])
def test_a_joint_that_can_run_away_is_followed_for_its_known_way_only(stops):
    data = record(stops)
    assert 20 < data.N < write_back.TURNS * 50
    assert np.all(np.abs(data.y - data.y[0]) < WAY)
