"""The twin driven with a log's input gives the log back, if it is the twin's own."""

import numpy as np
import pytest

import twin
from sysid.base.errors import InputError
from twin.hardware.linkage import end_angles, middle
from twin.log import Log

IDEAL_READING = ("noise", "adc", "jitter", "dropouts")


def made(joint, Ts=0.1, duration=12.0, **settings):
    return twin.Experiment(
        joint=joint, excitation="aprbs", duration=duration, Ts=Ts, seed=3, without=IDEAL_READING, **settings
    ).run()


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_own_log_comes_back(joint):
    log = made(joint)
    (back,) = twin.Follower(log, joint).readings([twin.Parameters()], [middle(twin.Parameters(), joint)])
    # The log is MuJoCo's, whose solver stops at a tolerance; the follower has the equations of one joint.
    np.testing.assert_allclose(back, log.y_true, rtol=0, atol=1e-8)


def test_own_servo_log_comes_back():
    log = twin.Experiment(
        joint="thigh", excitation="staircase", duration=12.0, Ts=0.05, mode="servo", without=IDEAL_READING
    ).run()
    p = twin.Parameters()
    (back,) = twin.Follower(log, "thigh").readings([p], [middle(p, "thigh")])
    assert np.ptp(back) > np.deg2rad(2)
    # The servo loop reads its own noise, which a follower leaves out like every noise.
    np.testing.assert_allclose(back, log.y_true, rtol=0, atol=np.deg2rad(0.5))


def test_rows_belong_to_their_parameters():
    log = made("shank")
    p = twin.Parameters()
    other = p.replace({"shank.coulomb": 45.0})
    rows = twin.Follower(log, "shank").readings([p, other, p], [middle(p, "shank")] * 3)
    np.testing.assert_array_equal(rows[0], rows[2])
    alone = twin.Follower(log, "shank").readings([other], [middle(p, "shank")])
    np.testing.assert_array_equal(rows[1], alone[0])
    assert np.abs(rows[1] - rows[0]).max() > np.deg2rad(0.2)


def test_shift_is_a_continuous_delay():
    """A delay of one whole period of the board, once as a parameter, once as a shift of the reading."""
    log = made("shoulder")
    p = twin.Parameters()
    late = p.replace({"delay": p["delay"] + 0.01})
    rows = twin.Follower(log, "shoulder").readings([late, p], [middle(p, "shoulder")] * 2, [0.0, 0.01])
    # 10 ms more at rest leave MuJoCo's iterative solver at other roundings: 2e-9 rad.
    np.testing.assert_allclose(rows[1][1:], rows[0][1:], rtol=0, atol=1e-7)


def test_any_sampling_time_is_allowed():
    """Commands of 0.1 s written down at 1/30 s: each lasts three samples, and every third reading is the same."""
    log = made("thigh")
    fine = Log(np.repeat(log.u, 3), np.zeros(3 * log.N), 0.1 / 3, joint="thigh")
    p = twin.Parameters()
    (row,) = twin.Follower(fine, "thigh").readings([p], [middle(p, "thigh")])
    np.testing.assert_allclose(row[::3], log.y_true, rtol=0, atol=1e-9)


def test_start_outside_the_stroke_is_the_end():
    p = twin.Parameters()
    still = Log(np.zeros(30), np.full(30, 3.0), 0.1, joint="thigh")
    (row,) = twin.Follower(still, "thigh", without=("nonlinearity", "backlash")).readings([p])
    assert row[-1] == pytest.approx(end_angles(p, "thigh")[1], abs=np.deg2rad(0.2))


def test_what_cannot_be_followed_is_said():
    log = made("thigh")
    with pytest.raises(InputError, match="joint"):
        twin.Follower(log, "knee")
    with pytest.raises(InputError, match="joint of this log"):
        twin.Follower(log, "shank")
    with pytest.raises(InputError, match="resample it first"):
        twin.Follower(Log(log.u, log.y, 1e-4), "thigh")


def test_several_shifts_of_one_leg_are_simulated_once():
    """Rows in any order, each with its own shift, equal those that were simulated one by one."""
    log = made("shoulder", duration=6.0)
    legs = [twin.Parameters(), twin.Parameters({"shoulder.coulomb": 1.3})]
    follower, starts, shifts = twin.Follower(log, "shoulder"), [0.0, 0.1], [0.0, 0.013, 0.02]
    rows = follower.readings(legs, starts, shifts, which=[1, 0, 1])
    for row, k, shift in zip(rows, [1, 0, 1], shifts, strict=True):
        (alone,) = follower.readings([legs[k]], [starts[k]], [shift])
        np.testing.assert_array_equal(row, alone)


@pytest.mark.parametrize("Ts", [0.1, 0.05])
def test_an_experiment_comes_back_with_its_noise(Ts):
    """The same seed draws the same noise, jitter and lost samples, bit for bit as far as rounding of times allows."""
    p = twin.Parameters({"dropout_rate": 0.05, "sample_jitter": 0.004})
    log = twin.Experiment("shoulder", "aprbs", 10.0, Ts, seed=4, parameters=p).run()
    back = twin.Follower(log, "shoulder").record(p, seed=4, start=middle(p, "shoulder"))
    np.testing.assert_allclose(back.y_true, log.y_true, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(back.y, log.y)
    assert back.meta["parameters_changed"] == log.meta["parameters_changed"]
    other = twin.Follower(log, "shoulder").record(p, seed=5, start=middle(p, "shoulder"))
    assert np.std(other.y - log.y) > p["pot_noise"]


def test_courses_are_read_between_steps():
    log = made("shank")
    follower = twin.Follower(log, "shank")
    (course,) = follower.courses([twin.Parameters()])
    (row,) = follower.readings([twin.Parameters()], shifts=[0.0305])
    np.testing.assert_allclose(row[1:], 0.5 * (course[69::100] + course[70::100])[: len(row) - 1], rtol=0, atol=1e-15)


def test_starts_and_shifts_are_one_for_each_run():
    follower, two = twin.Follower(made("shank"), "shank"), [twin.Parameters()] * 2
    with pytest.raises(InputError, match=r"^starts has shape \(3,\); give one number for each of the 2 parameters$"):
        follower.courses(two, [0.1, 0.2, 0.3])
    with pytest.raises(InputError, match=r"^shifts has shape \(1,\); give one number for each of the 2 rows$"):
        follower.readings(two, [0.1, 0.2], [0.0])
