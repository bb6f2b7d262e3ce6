"""The linearised model, the closed form and a step test tell the same poles."""

import json

import mujoco
import numpy as np
import pytest
from rig import ANGLE, QUIET

from sysid.base.errors import InputError
from twin import IMPERFECTIONS, JOINTS, Experiment, Parameters, truth
from twin.experiment import SETTLE
from twin.hardware.linkage import middle
from twin.plant.leg import BENCH_LEG, bench
from twin.plant.stepping import step
from twin.truth import LINEAR, channel, closed_form, linearise

P = Parameters()


def linear(joint: str, timestep: float = 0.001) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = bench(joint, P.replace({f"{joint}.coulomb": 0.0, f"{joint}.bearing_coulomb": 0.0}), LINEAR)
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    data.qpos[0] = middle(P, joint)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("Ts", [0.1, 0.02])
def test_linearisation_agrees_with_the_closed_form(joint: str, Ts: float) -> None:
    known = truth(joint, Ts)
    assert known.poles[0] == pytest.approx(1.0, abs=1e-6)  # finite differences see the arm change a little
    # In the s-plane, 1e-3 (the bound); both include the 1 ms implicit step.
    assert known.poles_s[1] == pytest.approx(known.closed_form_poles_s[1], rel=1e-3)
    assert known.gain == pytest.approx(known.closed_form_gain, rel=1e-3)


@pytest.mark.parametrize("joint", JOINTS)
def test_with_a_short_step_the_pole_is_the_continuous_one(joint: str) -> None:
    h = 1e-5
    model, data = linear(joint, h)
    poles, _ = channel(*linearise(model, data), 1)
    # 1e-3: the step's own error, s h / 2, is 1e-4 here. No integrator map on either side.
    assert np.log(poles[1]).real / h == pytest.approx(truth(joint).continuous_pole, rel=1e-3)


@pytest.mark.parametrize("joint", JOINTS)
def test_step_response_shows_the_same_pole_and_gain(joint: str) -> None:
    Ts, volts = 0.02, 0.05  # so little that the moment arm stays
    model, data = linear(joint)
    data.ctrl[0] = volts
    angle = [data.qpos[0]]
    for _ in range(25):
        mujoco.mj_step(model, data, round(Ts / model.opt.timestep))
        angle.append(data.qpos[0])
    steps = np.diff(angle)
    settled = steps[-1]
    ratio = (settled - steps[1:6]) / (settled - steps[:5])  # what is missing to full speed shrinks by the pole
    known = truth(joint, Ts)
    # 2e-3: full speed is read after ten time constants, and the arm moves by a few 1e-4 on the way.
    assert np.log(ratio.mean()) / Ts == pytest.approx(known.poles_s[1].real, rel=2e-3)
    assert settled / Ts / volts == pytest.approx(known.gain, rel=2e-3)


@pytest.mark.parametrize("joint", JOINTS)
def test_closed_form_inertia_is_the_models(joint: str) -> None:
    model, data = linear(joint)
    mass = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, mass)
    _, inertia, _ = closed_form(joint, P, model, data)
    assert inertia == pytest.approx(mass[0, 0], rel=1e-9)


def test_more_stall_force_means_a_faster_lag() -> None:
    weak, strong = (truth("thigh", parameters=Parameters({"thigh.stall_force": f})) for f in (200.0, 300.0))
    assert strong.poles_s[1].real < weak.poles_s[1].real < 0


def test_slow_pole_lies_inside_the_circle_and_the_integrator_on_it() -> None:
    for joint in JOINTS:
        known = truth(joint)
        assert 0 < known.poles[1].real < 0.5
        assert known.breakaway_voltage[0] < 0 < known.breakaway_voltage[1]
        assert known.end_angles[0] < known.operating_point < known.end_angles[1]


def test_truth_can_be_written_as_json() -> None:
    written = json.loads(json.dumps(truth("shank").as_dict()))
    assert written["poles"][1][0] == pytest.approx(truth("shank").poles[1].real)


@pytest.mark.parametrize(("joint", "Ts"), [("knee", 0.1), ("thigh", 0.0), ("thigh", 0.00051), ("thigh", float("nan"))])
def test_bad_questions_are_refused(joint: str, Ts: float) -> None:
    with pytest.raises(InputError, match=r"choose one of|milliseconds"):
        truth(joint, Ts)


def test_bench_names_are_the_legs() -> None:
    assert bench("thigh").actuator(0).name == "thigh" + BENCH_LEG


def halved(joint: str, excitation: str, without: tuple[str, ...], **options: float) -> float:
    """RMS [deg] by which 60 s of `joint` change when the simulation step is halved."""
    angles = []
    for timestep in (0.001, 0.0005):
        model = bench(joint, without=without)
        model.opt.timestep = timestep
        run = Experiment(joint, excitation, 60.0, without=without, options=options).prepare(model)
        angles.append(np.rad2deg(step([run], 0.1, SETTLE)[0, :, 0, ANGLE]))
    return float(np.sqrt(np.mean((angles[0] - angles[1]) ** 2)))


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("excitation", ["sweep", "aprbs"])
def test_half_the_time_step_hardly_changes_a_record(joint: str, excitation: str) -> None:
    # All on: the shoulder crosses its play at 60 deg/s, and when it strikes is what a step decides.
    assert halved(joint, excitation, QUIET) < (0.06 if joint == "shoulder" else 0.01)


@pytest.mark.parametrize("joint", JOINTS)
def test_half_the_time_step_hardly_changes_the_ideal_joint(joint: str) -> None:
    assert halved(joint, "sweep", IMPERFECTIONS, amplitude=3.0) < 0.01  # 3 V: it stays inside its stroke
