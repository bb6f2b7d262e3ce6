"""Servo joints: the motion of an independent solver, and values found in records of drawn joints."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import sysid
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.base.quantities import Unit
from sysid.blocks import ServoMotor
from sysid.data.record import IOData
from sysid.joint.full import PARTS
from sysid.joint.posterior import fit_joint
from sysid.joint.values import displayed_value, joint_values
from sysid.model.chain import Chain
from sysid.structures import ServoJoint, servo_joint

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "studies"))
from servo_joints import TICK, Joint, drawn, goals, model, record, simulated

SMOOTH = {
    **{"kp": 2.0, "kd": 1.5, "ki": 0.03, "i0": 0.05, "dead": 0.02, "limit": 1.0, "sag": 0.4},
    **{"gain": 0.06, "lag": 4.0, "rise": 0.0, "fall": 0.0, "load0": 0.04, "load1": -0.1, "load2": 0.08},
    **{"delay": 0.4, "x0": 0.2, "v0": -0.01},
}


def block(load=1, **options):
    """A servo without friction and stops, and its parameters."""
    made = ServoMotor(load=load, stops=False, at=0.1, role="motor", **options)
    return made, np.array([SMOOTH[slot.name] for slot in made.slots()])


def solved(made, theta, goal):
    """Positions (N,) of a servo without friction by scipy, its loop continuous."""
    m = {**dict.fromkeys(("kd", "ki", "i0", "dead", "sag", "load1", "load2"), 0.0), **made.by_name(theta)}

    def rate(t, state, wanted):
        x, v, i = state
        e = wanted - x
        e -= np.clip(e, -m["dead"], m["dead"])
        asked = m["kp"] * e - m["kd"] * v + i
        w = np.clip(asked, -m["limit"], m["limit"])
        winds = m["ki"] * e if w == asked else 0.0
        share = m["sag"] * (w / m["limit"]) ** 2
        away = x - made.at
        push = (w + share * v / m["gain"]) / (1 + share) - m["load0"] - m["load1"] * away - m["load2"] * away**2
        return [v, (m["gain"] * push - v) / m["lag"], winds]

    state, found = np.array([m["x0"], m["v0"], m["i0"]]), []
    for before, wanted in zip(np.concatenate([goal[:1], goal[:-1]]), goal, strict=True):
        found.append(state[0])
        for g, length in ((before, m["delay"]), (wanted, 1.0 - m["delay"])):
            run = solve_ivp(rate, (0.0, length), state, args=(g,), rtol=1e-9, atol=1e-11, max_step=0.1)
            state = run.y[:, -1]
    return np.array(found)


@pytest.mark.parametrize(
    ("options", "order"),
    [
        ({}, 2),
        ({"load": 3}, 1),
        ({"loop": "pd"}, 1),
        ({"loop": "pd", "dead": True, "sags": True}, 1),
        ({"loop": "pid", "dead": True}, 1),
    ],
    ids=["p", "load", "pd", "dead_and_sag", "pid"],
)
def test_the_motion_comes_to_that_of_an_independent_solver(options, order):
    """Steps that reach the limit and small ones. Sixteen times the updates leave a sixteenth of the error or less."""
    goal = np.repeat([0.2, 0.5, -1.2, -1.0, 1.1, 1.15, 0.0], 25)
    expected = solved(*block(**options), goal)
    assert np.ptp(expected) > 1.5
    worst = {}
    for updates in (4, 64):
        made, theta = block(updates=updates, **options)
        worst[updates] = np.abs(Chain((made,)).simulate(theta, goal) - expected).max()
    assert worst[64] < {1: 2e-4, 2: 2e-7}[order]
    assert worst[64] < worst[4] / {1: 10.0, 2: 100.0}[order]


def plain(**values) -> Joint:
    """A joint of plain numbers with a noise-free, slow and strong servo."""
    numbers = {
        **{"speed": 6.0, "lag": 0.04, "up": 0.06, "down": 0.08, "stick": 0.0, "stick_speed": 0.1, "pull": 0.0},
        **{"tilt": 0.0, "backlash": 0.0, "kp": 4.0, "kd": 0.0, "delay": 0.004, "noise": 1e-9, "Ts": 0.01},
    }
    return Joint(**(numbers | {"known": False} | values))


@pytest.mark.parametrize("kd", [0.0, 0.05])
def test_a_servo_with_friction_moves_and_sticks_as_one_that_is_simulated_step_by_step(kd):
    """Against the script's steps of 0.1 ms; its encoder moves by 0.0015 rad, its loop looks once a millisecond."""
    joint = plain(kd=kd)
    goal = goals(np.random.default_rng(3), 1500, joint.Ts)
    known = {
        **{"kp": joint.kp, "kd": kd / joint.Ts, "limit": 1.0, "gain": joint.speed * joint.Ts, "lag": 4.0},
        **{"rise": joint.up, "fall": joint.down, "delay": 0.4, "x0": goal[0], "v0": 0.0},
    }
    made = ServoMotor(loop="pd" if kd else "p", load=0, stops=False, updates=10, role="motor")
    y = Chain((made,)).simulate(np.array([known[slot.name] for slot in made.slots()]), goal)
    expected = simulated(joint, goal)
    assert np.sum(np.diff(expected) == 0.0) > 100  # it sticks
    assert np.abs(y - expected).max() < 4e-3
    assert np.sqrt(np.mean((y - expected) ** 2)) < TICK  # it reads whole ticks, and its derivative is filtered


def values(fit, joint):
    """Found over true values."""
    found = dict(zip(fit.model.names, fit.theta, strict=True))
    true = {"gain": joint.speed * joint.Ts, "lag": joint.lag / joint.Ts, "kp": joint.kp}
    true |= {"rise": joint.up, "fall": joint.down}
    return {name: found[f"motor.{name}"] / value for name, value in true.items()}


def test_a_record_that_reaches_full_duty_gives_every_value():
    rng = np.random.default_rng(5)
    joint = plain(noise=1e-3)
    data, _ = record(joint, rng, 20.0)
    fit = sysid.fit(servo_joint(ServoMotor(load=0, stops=False), play=False), data, search="lm", starts=4)
    for name, ratio in values(fit, joint).items():
        assert ratio == pytest.approx(1.0, abs=0.03), name
    assert not np.isinf(fit.covariance.std()[fit.model.names.index("motor.kp")])


def of_dead_band(dead, kp=4.0, speed=6.0, lag=0.05, dry=0.03, Ts=0.01, parts=20):
    """Goal and angle of a servo whose loop acts on what the error exceeds its band by, by plain steps of time."""
    rng, h = np.random.default_rng(5), Ts / parts
    goal = np.repeat(rng.uniform(-1.2, 1.2, 40), rng.integers(30, 70, 40))
    x, v, y = float(goal[0]), 0.0, np.zeros(len(goal))
    for t, wanted in enumerate(goal):
        y[t] = x
        for _ in range(parts):
            drive = kp * np.sign(wanted - x) * max(abs(wanted - x) - dead, 0.0)
            drive = min(max(drive, -1.0), 1.0)
            if v == 0.0 and abs(drive) <= dry:
                continue
            new = v + h * (speed * (drive - dry * np.sign(v or drive)) - v) / lag
            v = 0.0 if v * new < 0.0 else new
            x += h * v
    return IOData(goal, y + 5e-4 * rng.normal(size=len(y)), Ts, "goal", "angle", "rad", "rad")


@pytest.mark.parametrize("band", [0.0, 0.02])
def test_a_dead_band_is_found_beside_a_gain_that_it_does_not_lower(band):
    data, motor = of_dead_band(band), servo_joint(ServoMotor(load=0, stops=False), play=False)
    found = fit_joint(data, motor, parts=("bands",))
    shown = {value.name: value for value in joint_values(found.fit, data=data)}
    assert shown["kp"].holds(4.0)
    assert shown["kp"].value == pytest.approx(4.0, rel=0.02)
    read = displayed_value(shown["kp"])  # 4 duty/rad, beside a goal and an angle in degrees
    assert (read.unit, read.holds(4.0 * np.pi / 180.0), read.holds(4.0)) == ("duty/deg", True, False)
    turns = replace(data, y_unit=Unit("rad", "rev", 0.5 / np.pi))
    (of_a_turn,) = (value for value in joint_values(found.fit, data=turns) if value.name == "kp")
    read = displayed_value(of_a_turn)
    assert (read.unit, read.holds(8.0 * np.pi)) == ("duty/rev", True)
    assert found.shown == (("motor.dead",) if band else ())
    assert ("dead" in shown) == bool(band)
    if band:
        assert shown["dead"].holds(band)
        assert shown["dead"].value == pytest.approx(band, rel=0.05)
    assert "bands" in PARTS  # which is what identify looks for


def test_a_record_below_full_duty_gives_what_it_can_and_the_rest_where_the_gain_is_known():
    """Small slow steps: gain times kp and friction over kp, not kp itself, unless it is given."""
    rng = np.random.default_rng(6)
    joint = plain(noise=1e-4, kp=2.0, up=0.02, down=0.03)
    goal = np.repeat(rng.uniform(-0.15, 0.15, 60), 25)
    y = simulated(joint, goal) + joint.noise * rng.normal(size=len(goal))
    data = IOData(goal, y, joint.Ts)
    motor = ServoMotor(load=0, stops=False)
    given = sysid.fit(servo_joint(motor, False, fixed={"motor.kp": joint.kp}), data, search="lm")
    shown = {value.name: value for value in joint_values(given, data=data)}["kp"]
    assert (shown.low, shown.value, shown.high) == (joint.kp, joint.kp, joint.kp)
    known = values(given, joint)
    for name, ratio in known.items():
        assert ratio == pytest.approx(1.0, abs=0.05), name
    fit = sysid.fit(servo_joint(motor, False), data, search="lm")
    open_ = values(fit, joint)
    assert open_["gain"] * open_["kp"] == pytest.approx(1.0, abs=0.05)
    assert open_["rise"] / open_["kp"] == pytest.approx(1.0, abs=0.1)
    std = dict(zip(fit.model.names, fit.covariance.std(), strict=True))
    assert not np.isfinite(std["motor.kp"])
    assert any("do not determine" in warning for warning in fit.warnings)


def still(joint, seed: int) -> IOData:
    """A record of small slow steps, far below full duty."""
    rng = np.random.default_rng(seed)
    goal = np.repeat(rng.uniform(-0.15, 0.15, 60), 25)
    y = simulated(joint, goal) + joint.noise * rng.normal(size=len(goal))
    return IOData(goal, y, joint.Ts, "goal", "angle", "rad", "rad")


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_known_gains_of_a_pd_loop_count_in_seconds_and_in_the_unit_of_the_record(unit):
    """Below full duty the derivative acts like a drag: with kd known the lag is the motor's, and not without."""
    joint = plain(noise=1e-4, kp=2.0, kd=0.04, up=0.02, down=0.03)
    data, scale = still(joint, 6), 180.0 / np.pi if unit == "deg" else 1.0
    data = replace(data, u=scale * data.u, y=scale * data.y, u_unit=unit, y_unit=unit)
    own = ServoJoint("pd", kp=joint.kp / scale, kd=joint.kd / scale)
    assert own.model_of(data).blocks[0].period == pytest.approx(2 * np.pi * scale)
    motor = ServoMotor(load=0, stops=False, loop="pd")
    fit = sysid.fit(servo_joint(motor, False, kp=own.kp, kd=own.kd, Ts=joint.Ts), data, search="lm", starts=4)
    assert own.model_of(data).fixed["motor.kd"] == dict(zip(fit.model.names, fit.theta, strict=True))["motor.kd"]
    found = dict(zip(fit.model.names, fit.theta, strict=True))
    assert found["motor.gain"] == pytest.approx(scale * joint.speed * joint.Ts, rel=0.05)
    assert found["motor.lag"] == pytest.approx(joint.lag / joint.Ts, rel=0.1)
    assert found["motor.rise"] == pytest.approx(joint.up, rel=0.05)


def test_a_known_integral_gain_counts_in_seconds():
    """A pid servo without friction by scipy: ki in drive per unit and s gives back gain and lag."""
    made, theta = block(loop="pid", load=1)
    goal, Ts = np.repeat([0.2, 0.5, -1.2, -1.0, 1.1, 1.15, 0.0], 25), 0.02
    y = solved(made, theta, goal)
    chain = servo_joint(
        ServoMotor(load=1, stops=False, loop="pid", updates=64),
        False,
        fixed={f"motor.{name}": SMOOTH[name] for name in ("load0", "rise", "fall", "v0")},
        **{"kp": SMOOTH["kp"], "kd": SMOOTH["kd"] * Ts, "ki": SMOOTH["ki"] / Ts, "Ts": Ts},
    )
    start = [chain.fixed.get(name, 1.3 * SMOOTH[name.split(".")[1]]) for name in chain.names]
    fit = sysid.fit(chain, IOData(goal, y, Ts), start=np.clip(start, *chain.limits))
    found = dict(zip(fit.model.names, fit.theta, strict=True))
    for name in ("gain", "lag", "delay"):
        assert found[f"motor.{name}"] == pytest.approx(SMOOTH[name], rel=0.01), name


def test_a_gain_that_the_loop_lacks_or_that_has_no_time_is_refused():
    pd = ServoMotor(load=0, stops=False, loop="pd")
    for make, words in (
        (lambda: ServoJoint("p", kd=0.1), "kd of the servo is 0.1 and its loop 'p', which has none"),
        (lambda: ServoJoint("pd", ki=0.1), "give loop pid"),
        (lambda: ServoJoint("pd", kd=-0.1), "kd of the servo is -0.1; give 0 or more"),
        (lambda: servo_joint(pd, kd=0.1), "give Ts"),
        (lambda: servo_joint(pd, kp=2.0, fixed={"motor.kp": 2.0}), "motor.kp is given as a gain and in fixed"),
    ):
        with pytest.raises(InputError, match=words):
            make()
    assert {n.loop for n in ServoJoint("pd", kd=0.1).neighbours()} == {"pd", "pid"}
    assert {n.loop for n in ServoJoint("pid", ki=0.2).neighbours()} == {"pid"}


def test_drawn_joints_come_near_the_ceiling():
    """The worst of the first ten: half of the record is fitted, the other half run freely."""
    gaps = []
    for k in range(10):
        rng = np.random.default_rng([0, k])
        joint = drawn(rng)
        data, truth = record(joint, rng)
        half = data.N // 2
        test = data.select(half, data.N)
        fit = sysid.fit(model(joint, True), data.select(0, half), search="lm", starts=4)
        gaps.append(float(np.ravel(fit_percent(test.y, truth[half:, None]))[0]) - float(fit.fit_percent(test)))
    assert np.mean(np.array(gaps) <= 0.5) >= 0.8
    assert max(gaps) < 1.5


def test_a_gain_that_is_known_for_each_record_scales_the_loop_of_each():
    """The gains of a second channel: as fixed gains of each, and all records in one fit."""
    rng, joints = np.random.default_rng(8), [plain(kp=kp, noise=1e-3) for kp in (2.0, 4.0, 8.0)]
    records = []
    for joint in joints:
        data, _ = record(joint, rng, 10.0)
        records.append(replace(data, u=np.column_stack([data.u, np.full(data.N, joint.kp / 4.0)])))
    chain = servo_joint(ServoMotor(load=0, stops=False, scheduled=True), play=False)
    fit = sysid.fit(chain, IOData.merge(*records[::2]), search="lm", starts=4)
    for name, ratio in values(fit, joints[1]).items():
        assert ratio == pytest.approx(1.0, abs=0.03), name
    assert float(fit.fit_percent(records[1])) > 99.0
    alone = servo_joint(ServoMotor(load=0, stops=False), play=False)
    theta = np.where(np.array(alone.names) == "motor.kp", 2.0 * fit.theta, fit.theta)
    np.testing.assert_array_equal(
        chain.simulate(fit.theta, records[2].u), alone.simulate(theta, np.ascontiguousarray(records[2].u[:, 0]))
    )
    varies = records[0].u.copy()
    varies[5, 1] = 3.0
    with pytest.raises(InputError, match="varies within a record"):
        chain.simulate(fit.theta, varies)


def test_the_tangent_of_a_scheduled_gain_is_that_of_differences():
    made = ServoMotor(loop="pd", load=1, stops=False, scheduled=True, role="motor")
    chain, rng = Chain((made,)), np.random.default_rng(9)
    known = {**SMOOTH, "rise": 0.05, "fall": 0.04}
    theta = np.array([known[slot.name] for slot in made.slots()])
    u = np.column_stack([np.repeat(rng.uniform(-1, 1, 20), 15), np.full(300, 1.7)])
    _, J = chain.tangent(theta, u)
    for i in range(len(theta)):
        e = np.zeros(len(theta))
        e[i] = 1e-6
        slope = (chain.simulate(theta + e, u) - chain.simulate(theta - e, u)) / 2e-6
        np.testing.assert_allclose(J[:, i], slope, atol=1e-6 * max(1.0, np.abs(J).max()))


def test_a_sampled_loop_that_would_swing_up_is_refused():
    """Hardly any lag and one update a sample: the error is multiplied by 1 - kp gain, stable while kp gain < 2."""
    made = ServoMotor(load=0, stops=False, delayed=False, held=True, updates=1, role="motor")
    at = {"kp": 10.0, "limit": 1.0, "gain": 0.1, "lag": 1e-3, "rise": 0.0, "fall": 0.0, "x0": 0.0, "v0": 0.0}
    for kp, stable in ((19.9, True), (20.1, False)):
        theta = np.array([{**at, "kp": kp}[slot.name] for slot in made.slots()])
        assert made.admissible(theta) is stable
        y = Chain((made,)).simulate(theta, np.full(400, 1e-3))
        assert bool(abs(y[-1] - 1e-3) < 1e-4) is stable
