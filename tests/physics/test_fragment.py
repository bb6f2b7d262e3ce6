"""MJCF of an identified joint does in MuJoCo what the fitted chain does."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.blocks import Motor, Play, ServoMotor
from sysid.export import mjcf
from sysid.structures import actuated_joint, servo_joint
from twin.fragment import into, rollout

TS = 0.05


def fit_of(chain, **values):
    """The chain with these parameters, as far as an export reads a fit."""
    theta = np.array([values[name.split(".")[1]] for name in chain.names])
    return SimpleNamespace(model=chain, theta=theta, Ts=TS)


def drawn(N=600, amplitude=8.0, seed=0):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-amplitude, amplitude, N // 15), 15)


def share(fit, u, **settings):
    data = sysid.IOData(u, u, TS)
    return rollout.check(mjcf.fragment(fit, "knee", **settings), fit, data)


PLAIN = {"gain": 0.01, "lag": 0.6, "rise": 1.5, "fall": 1.0, "x0": 0.1, "v0": 0.0, "delay": 0.4}
STOPS = {"lower": -0.5, "upper": 0.6}
DIRECT = {
    "friction": (Motor(load=0, stops=False), PLAIN),
    "ends": (Motor(load=0), PLAIN | STOPS),
    "load": (Motor(load=3), PLAIN | STOPS | {"load0": 0.6, "load1": 1.0, "load2": -0.8}),
    "load without a zero": (Motor(load=3), PLAIN | STOPS | {"load0": 1.6, "load1": 0.1, "load2": 0.8}),
    "constant load": (Motor(load=1), PLAIN | STOPS | {"load0": 0.9}),
    "load without a zero, lower stop": (
        Motor(load=3, stops="lower"),
        PLAIN | {"lower": -0.5, "load0": 1.6, "load1": 0.1, "load2": 0.8},
    ),
    "upper stop": (Motor(load=0, stops="upper"), PLAIN | {"upper": 0.6}),
    "stribeck, lower stop": (
        Motor(load=0, stribeck=True, substeps=16, stops="lower"),
        PLAIN | {"lower": -0.5, "stick": 0.6, "stick_speed": 0.004},
    ),
    "stribeck": (Motor(load=0, stribeck=True, substeps=16), PLAIN | STOPS | {"stick": 0.6, "stick_speed": 0.004}),
    "no delay": (Motor(load=0, delayed=False), PLAIN | STOPS),
}


@pytest.mark.parametrize("torque_per_volt", [0.05, 20.0])
@pytest.mark.parametrize("name", DIRECT)
def test_motor_on_the_joint(name, torque_per_volt):
    motor, values = DIRECT[name]
    chain = actuated_joint(motor=motor, knots=None, play=False)
    found = share(fit_of(chain, **values), drawn(), torque_per_volt=torque_per_volt)
    assert np.ptp(found.chain) > 0.5
    # LuGre's bristles begin without deflection: a first break-away that friction nearly holds comes a sample early.
    assert found.share < (0.01 if name.startswith("stribeck") else 0.005)


SERVO = PLAIN | {"gain": 0.3, "rise": 0.02, "fall": 0.02, "limit": 1.0, "kp": 3.0, "x0": 0.0}
LOOPS = {
    "p": SERVO,
    "p that reaches its limit": SERVO | {"kp": 40.0},
    "pd": SERVO | {"kd": 1.5, "kp": 5.0},
    "pid": SERVO | {"kd": 1.0, "ki": 0.3, "i0": 0.0, "rise": 0.0005, "fall": 0.001},
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_loop_of_a_servo(name):
    """The drive's limit, kd and ki as well, in seconds; the goal is what the actuator takes.

    At its limit the integral of MuJoCo's controller goes on, so that a PID is compared below it.
    """
    motor = ServoMotor(load=0, stops=False, loop=name.split(" ")[0])
    fit = fit_of(servo_joint(motor=motor, play=False), **LOOPS[name])
    goal = drawn(amplitude=0.02 if name == "pid" else 0.8)
    found = share(fit, goal, torque_per_volt=2.0)
    assert np.ptp(found.chain) > np.ptp(goal) / 2
    assert found.share < 0.005
    voltage = fit_of(actuated_joint(motor=Motor(load=0, stops=False), knots=None, play=False), **LOOPS[name])
    assert share(voltage, goal, torque_per_volt=2.0).chain.std() != pytest.approx(found.chain.std(), rel=0.05)


def test_what_a_loop_has_beyond_the_elements_is_named():
    motor = ServoMotor(load=0, stops=False, dead=True, sags=True, loop="pid", held=True)
    chain = servo_joint(motor=motor, play=False)
    values = LOOPS["pid"] | {"dead": 0.01, "sag": 0.2}
    left_out = " ".join(mjcf.fragment(fit_of(chain, **values), "knee").left_out)
    assert all(words in left_out for words in ("dead band", "sagging", "integral", "once in a sample"))
    none = " ".join(mjcf.fragment(fit_of(chain, **values | {"dead": 0.0, "sag": 0.0}), "knee").left_out)
    assert "dead band" not in none
    assert "sagging" not in none


def test_plain_play():
    chain = actuated_joint(motor=Motor(load=0), knots=None, play=Play())
    found = share(fit_of(chain, **PLAIN, **STOPS, width=0.05, rest=0.0), drawn())
    without = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=False), **PLAIN, **STOPS)
    assert found.share < 0.005
    assert share(without, drawn()).share < 0.005
    difference = found.rolled - share(without, drawn()).rolled
    low, high = np.quantile(difference, [0.1, 0.9])  # the link lies against one side or the other most of the time
    assert high - low == pytest.approx(0.05, rel=0.05)


@pytest.fixture(scope="module", params=["shoulder", "thigh", "shank"])
def identified(request):
    import twin

    log = twin.Experiment(joint=request.param, excitation="aprbs", duration=60.0, Ts=0.1, seed=5).run()
    return sysid.fit(actuated_joint(play=False), log.io(), search="lm", starts=2, seed=0), log.io()


def test_identified_joints_of_the_leg(identified):
    """The goal: less than 0.5 % of the stroke RMS between the chain and its MJCF."""
    fit, data = identified
    made = mjcf.fragment(fit, "knee")
    assert rollout.check(made, fit, data).share < 0.005
    motor = ET.fromstring(made.actuator)
    speed = 1.0 / float(motor.get("motorconst").split()[0])  # strokes per second and volt
    values = {p.name: p.value for p in fit.parameters}
    assert speed == pytest.approx(values["motor.gain"] / 0.1)


def test_torque_scales_forces_and_nothing_else(identified):
    fit, data = identified
    small, large = (rollout.check(mjcf.fragment(fit, "knee", torque_per_volt=k), fit, data) for k in (0.2, 5.0))
    np.testing.assert_allclose(small.rolled, large.rolled, rtol=0, atol=2e-3 * np.ptp(small.chain))


def test_own_link_takes_its_share_of_the_inertia():
    fit = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=False), **PLAIN, **STOPS)
    armature = [
        float(ET.fromstring(mjcf.fragment(fit, "knee", 2.0, inertia).actuator).get("armature"))
        for inertia in (0.0, 0.1)
    ]
    assert armature[0] - armature[1] == pytest.approx(0.1, rel=1e-6)
    with pytest.raises(InputError, match="smaller link_inertia"):
        mjcf.fragment(fit, "knee", 2.0, 100.0)


MODEL = """<mujoco>
  <!-- somebody's robot -->
  <default><joint armature="1" damping="2" limited="true"/></default>
  <worldbody>
    <body name="leg"><joint name="hip" type="hinge" axis="0 1 0" range="-90 90"/>
      <geom size="0.1" mass="1"/>
      <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 -1 0" pos="0 0 0.1" range="-100 5" stiffness="3"/>
        <geom size="0.05" mass="0.2"/></body></body>
  </worldbody>
  <actuator><motor name="old" joint="knee"/><motor name="hip" joint="hip"/></actuator>
  <keyframe><key name="home" qpos="0.3 -0.4" qvel="1 2" ctrl="5 6"/></keyframe>
</mujoco>"""


@pytest.mark.parametrize("play", [False, Play()])
def test_joint_of_a_model_of_others(tmp_path, play):
    """Ends are radians in the fit and degrees in the model; place, axis and the other joint stay."""
    (tmp_path / "robot.xml").write_text(MODEL)
    values = PLAIN | STOPS | ({"width": 0.02, "rest": 0.0} if play else {})
    values |= {"fall": values["rise"]}  # else their difference acts as a spring
    fit = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=play), **values)
    text, _ = into.put_into(mjcf.fragment(fit, "knee", 2.0), tmp_path / "robot.xml")
    before, after = mujoco.MjModel.from_xml_string(MODEL), mujoco.MjModel.from_xml_string(text)
    knee = after.joint("knee")
    np.testing.assert_allclose(knee.range, [-0.5, 0.6], atol=1e-9)
    np.testing.assert_allclose(knee.axis, before.joint("knee").axis)
    np.testing.assert_allclose(knee.pos, before.joint("knee").pos)
    assert (knee.damping[0], knee.armature[0], knee.stiffness[0]) == (0.0, 0.0, 0.0)
    assert knee.frictionloss[0] == pytest.approx(2.0 * 1.5 * (0.95 if play else 1.0))
    np.testing.assert_array_equal(after.joint("hip").range, before.joint("hip").range)
    assert [after.actuator(k).name for k in range(after.nu)] == ["old", "hip"]  # sensors of the old motor find it
    for name, value, speed in (("hip", 0.3, 1.0), ("knee", -0.4, 2.0), ("knee_play", 0.0, 0.0))[: after.njnt]:
        assert after.key_qpos[0][after.joint(name).qposadr[0]] == value
        assert after.key_qvel[0][after.joint(name).dofadr[0]] == speed
    assert list(after.key_ctrl[0]) == [0.0, 6.0]
    assert after.njnt == before.njnt + (play is not False)
    assert "somebody's robot" in text


def test_linkage_of_a_model_of_others(tmp_path, identified):
    """The coupled motor starts where the joint's angle is nearest to the model's first pose, and stays there."""
    fit, _ = identified
    (tmp_path / "robot.xml").write_text(MODEL)
    text, _ = into.put_into(mjcf.fragment(fit, "knee", 20.0), tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    ends = [p.value for p in fit.parameters if p.name in ("map.low", "map.high")]
    assert data.joint("knee").qpos[0] == pytest.approx(np.clip(0.0, *ends), abs=0.02)
    places = [model.joint(name).qposadr[0] for name in ("hip", "knee")]
    assert list(model.key_qpos[0][places]) == [0.3, -0.4]
    assert len(np.flatnonzero(model.key_qvel[0])) == 2


DEFAULTS = [
    '<motor ctrlrange="-1 1" ctrllimited="true" gear="5"/>',
    '<general forcerange="-2 2" forcelimited="true"/>',
    '<joint actuatorfrcrange="-0.1 0.1" actuatorfrclimited="true" margin="0.1" stiffness="3" springdamper="1 1"/>',
    '<equality active="false" solref="0.5 1"/>',
    '<tendon limited="true" range="0 0.1" stiffness="100"/>',
]


def swing(model, joints, u):
    data = mujoco.MjData(model)
    data.qvel[:] = 0.0
    read = []
    for volts in u:
        data.ctrl[:] = volts
        mujoco.mj_step(model, data, 50)
        read.append(sum(data.joint(name).qpos[0] for name in joints))
    return np.array(read)


@pytest.mark.parametrize("ref", ["", ' ref="5"'])
@pytest.mark.parametrize("default", DEFAULTS)
def test_defaults_of_a_model_of_others_change_nothing(tmp_path, identified, default, ref):
    """One link without weight: the robot's joint moves as the stand-alone model does, in the fit's own angle."""
    fit, _ = identified
    text = f"""<mujoco><default>{default}</default><option timestep="0.001" integrator="implicitfast"/><worldbody>
      <body gravcomp="1"><joint name="knee" axis="0 1 0"{ref}/><inertial pos="0 0 0" mass="1e-3"
      diaginertia="1e-6 1e-6 1e-6"/></body></worldbody><actuator><motor name="m" joint="knee"/></actuator></mujoco>"""
    (tmp_path / "robot.xml").write_text(text)
    made = mjcf.fragment(fit, "knee", 20.0)
    put = mujoco.MjModel.from_xml_string(into.put_into(made, tmp_path / "robot.xml")[0])
    alone = mujoco.MjModel.from_xml_string(made.model())
    put.opt.gravity[:] = alone.opt.gravity[:] = 0.0
    u = drawn(300, 12.0)
    want, got = swing(alone, made.reading, u), swing(put, made.reading, u)
    assert np.ptp(want) > 0.2
    np.testing.assert_allclose(got[5:], want[5:], rtol=0, atol=0.01 * np.ptp(want))


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("<mujoco><worldbody>", "knee", "MuJoCo does not load it"),
        (MODEL, "ankle", "hip, knee"),
        (MODEL.replace("<default>", '<option><flag limit="disable"/></option><default>'), "knee", "flags of <option>"),
        (
            MODEL.replace("<actuator>", '<equality><joint name="e" joint1="knee" joint2="hip"/></equality><actuator>'),
            "knee",
            "an equality constraint 'e' acts on 'knee'",
        ),
        (MODEL.replace('axis="0 -1 0"', 'type="slide" axis="0 -1 0"'), "knee", "is a slide; give a hinge"),
    ],
)
def test_models_that_do_not_fit_are_said(tmp_path, text, name, said):
    (tmp_path / "robot.xml").write_text(text)
    fit = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=False), **PLAIN, **STOPS)
    with pytest.raises(InputError, match=said):
        into.put_into(mjcf.fragment(fit, name), tmp_path / "robot.xml")


def test_what_is_no_joint_is_said():
    data = sysid.IOData(drawn(200), np.cumsum(drawn(200)), TS)
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), data)
    with pytest.raises(InputError, match="structure actuated_joint"):
        mjcf.fragment(fit)
    still = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=False), **PLAIN | {"gain": 0.0}, **STOPS)
    with pytest.raises(InputError, match="the fitted motor never moves"):
        mjcf.fragment(still)
    good = fit_of(actuated_joint(motor=Motor(load=0), knots=None, play=False), **PLAIN, **STOPS)
    with pytest.raises(InputError, match="torque_per_volt is -1"):
        mjcf.fragment(good, torque_per_volt=-1.0)


def test_parts_without_elements_are_named():
    motor = replace(Motor(load=1), loss=True, jams=True)
    values = PLAIN | STOPS | {"load0": 0.5, "loss": 0.4, "jam": 3.0}
    fit = fit_of(actuated_joint(motor=motor, knots=None, play=False, driver_step=0.1), **values)
    said = " ".join(mjcf.fragment(fit).left_out)
    assert "load" in said
    assert "jamming" in said
    assert "levels of the driver" in said
    shape = {"angle0": 0.9, "angle1": 3.1, "stroke": 0.4}  # a constant torque acts by the slope, 24 at this dead centre
    values = PLAIN | {"lower": 0.0, "upper": 1.0, "load0": 0.6, "bearing": 0.2, **shape}
    fit = fit_of(actuated_joint(motor=Motor(load=1, lever=True), play=False), **values, low=-0.5, high=0.6)
    said = " ".join(mjcf.fragment(fit).left_out)
    assert float(said.split("cubic: ")[1].split(" V")[0]) > 1.0
    assert "a bearing's friction by the slope of the linkage" in said
    swings = Motor(load=0, periodic=1, stops="upper", delayed=False)
    fit = fit_of(actuated_joint(motor=swings, knots=None, play=False), **PLAIN, **STOPS, sine1=0.5, cosine1=0.0)
    said = " ".join(mjcf.fragment(fit).left_out)
    assert "periodic load" in said
    assert "the lower end stop, which the fit does not know" in said
