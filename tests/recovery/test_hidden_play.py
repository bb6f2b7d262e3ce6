"""Ends of a joint whose model has no backlash: as sure as the record leaves no room for one."""

from functools import cache

import numpy as np
import pytest

import sysid
from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.joint.hidden_play import hidden_play
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint

ENDS, NOISE, TS = (-70.0, 80.0), 0.05, 0.02


def record(volts, seed=0, parts=20):
    """Angle [deg] of a motor with dry friction between two stops, by plain steps of time, held for 25 samples each."""
    u, x, v, h = np.repeat(volts, 25), ENDS[0], 0.0, TS / parts
    y = np.zeros(len(u))
    for t, volt in enumerate(u):
        y[t] = x
        for _ in range(parts):
            if v == 0.0 and abs(volt) <= 0.4:
                continue
            new = v + h * (40.0 * (volt - 0.4 * np.sign(v or volt)) - v) / 0.08
            v = 0.0 if v * new < 0.0 else new
            x += h * v
            if not ENDS[0] < x < ENDS[1]:
                x, v = min(max(x, ENDS[0]), ENDS[1]), 0.0
    return IOData(u, y + NOISE * np.random.default_rng(seed).normal(size=len(y)), TS, "u", "y", "V", "deg")


@cache
def fitted(one_way):
    """The record of a motor that turns back and forth, or that goes up from stop to stop once, and its joint."""
    rng = np.random.default_rng(2)
    data = record(np.r_[0.0, 1.0, 1.5, 0.0, 2.0, 0.0, 3.0, 5.0] if one_way else rng.uniform(-6.0, 6.0, 40))
    motor = Motor(load=0, stops=True)
    return sysid.fit(actuated_joint(motor=motor, play=False), data, search="lm", starts=2), data


def test_an_end_is_as_sure_as_the_rests_where_the_record_has_no_room_for_a_backlash():
    fit, data = fitted(one_way=False)
    assert hidden_play(fit, data) < NOISE
    found = {value.name: value for value in joint_values(fit, data=data)}
    for name, end in zip(("end_low", "end_high"), ENDS, strict=True):
        assert found[name].holds(end)
        assert found[name].high - found[name].low < NOISE  # and half a percent of 150 degrees before


def test_a_way_that_never_turns_leaves_the_usual_backlash_open():
    """Its link lies on one side throughout, as that of a joint whose ends lie elsewhere."""
    fit, data = fitted(one_way=True)
    assert hidden_play(fit, data) == pytest.approx(0.015 * np.ptp(data.y), rel=0.5)
