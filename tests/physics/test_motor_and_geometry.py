"""Datasheet numbers and pin positions, measured on the compiled model."""

from contextlib import nullcontext

import mujoco
import numpy as np
import pytest
from rig import record

from twin import IMPERFECTIONS, JOINTS, Parameters
from twin.hardware.actuator import dry_friction, motor
from twin.hardware.linkage import clearance, end_angles, linkage, middle, stroke
from twin.plant import layout
from twin.plant.board import circuit, user_data
from twin.plant.leg import BENCH_LEG, LEGS, bench, model_path, robot
from twin.plant.stepping import boards

P = Parameters()
ROD_JOINTS = JOINTS[1:]


def ideal(joint: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The bench without imperfections, at mid stroke."""
    model = bench(joint, without=IMPERFECTIONS)
    data = mujoco.MjData(model)
    data.qpos[0] = middle(P, joint)
    mujoco.mj_forward(model, data)
    return model, data


def stall(joint: str) -> float:
    return P[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]


@pytest.mark.parametrize("joint", JOINTS)
def test_no_load_speed_is_the_datasheets(joint: str) -> None:
    model, data = ideal(joint)
    data.ctrl[0] = P[f"{joint}.rated_voltage"]
    mujoco.mj_step(model, data, 500)  # about ten time constants
    speed = data.qvel[0] if joint == "shoulder" else data.ten_velocity[model.tendon(joint + BENCH_LEG).id]
    # 1 %: the link, thrown about by a changing moment arm, holds the motor back a little.
    assert speed == pytest.approx(P[f"{joint}.no_load_speed"], rel=0.01)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("sign", [-1, 1])
def test_stall_force_is_the_datasheets(joint: str, sign: int) -> None:
    arm = 1.0 if joint == "shoulder" else linkage(P, joint).arm(middle(P, joint))
    for share, moves in ((0.99, sign), (1.01, -sign)):  # 1 % under stall the motor wins, 1 % over it the load does
        model, data = ideal(joint)
        data.ctrl[0] = sign * P[f"{joint}.rated_voltage"]
        data.qfrc_applied[0] = -sign * share * stall(joint) * arm
        mujoco.mj_step(model, data, 300)
        assert np.sign(data.qvel[0]) == moves


@pytest.mark.parametrize("joint", JOINTS)
def test_the_compiled_motor_holds_the_derived_constants(joint: str) -> None:
    model, constants = bench(joint), motor(P, joint)
    actuator = model.actuator(joint + BENCH_LEG)
    assert actuator.gear[0] == pytest.approx(constants.gear)
    assert actuator.gainprm[:2] == pytest.approx([constants.resistance, constants.constant])
    assert model.actuator_armature[actuator.id] == pytest.approx(constants.inertia)


def test_reflected_rotor_mass_outweighs_the_leg() -> None:
    leg = sum(P[f"{part}_mass"] for part in ("thigh", "shank", "foot", "actuator"))
    for joint in ROD_JOINTS:
        assert motor(P, joint).reflected_inertia > 100 * leg  # hundreds of kg against one or two


def test_the_files_numbers_are_the_nominal_parameters() -> None:
    raw, written = mujoco.MjModel.from_xml_path(str(model_path())), robot()
    for field in (
        *("body_mass", "body_inertia", "actuator_gainprm", "actuator_gear", "actuator_armature", "site_pos"),
        *("tendon_range", "tendon_frictionloss", "tendon_damping", "dof_frictionloss", "dof_damping", "jnt_range"),
    ):
        # 1e-5: the file is written with six digits or so.
        np.testing.assert_allclose(getattr(raw, field), getattr(written, field), rtol=1e-5, atol=1e-6, err_msg=field)
    np.testing.assert_array_equal(raw.opt.gravity, written.opt.gravity)


@pytest.mark.parametrize("joint", ROD_JOINTS)
def test_closed_form_geometry_is_the_compiled_tendon(joint: str) -> None:
    model = bench(joint)
    data, tendon = mujoco.MjData(model), model.tendon(joint + BENCH_LEG).id
    for q in np.linspace(*end_angles(P, joint), 7):
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        # Rounding only: one triangle, computed twice.
        assert data.ten_length[tendon] == pytest.approx(linkage(P, joint).length(q), abs=1e-12)
        data.qvel[0] = 1.0
        mujoco.mj_forward(model, data)
        assert data.ten_velocity[tendon] == pytest.approx(linkage(P, joint).arm(q), abs=1e-12)


@pytest.mark.parametrize("joint", ROD_JOINTS)
def test_angle_inverts_length(joint: str) -> None:
    for length in np.linspace(*stroke(P, joint), 5):
        assert linkage(P, joint).length(linkage(P, joint).angle(length)) == pytest.approx(length, abs=1e-12)


def test_torso_has_the_papers_size() -> None:
    model = robot()
    np.testing.assert_allclose(2 * model.geom("torso").size, [0.44, 0.21, 0.12])


def test_four_equal_legs() -> None:
    model = robot()
    assert model.nu == 12
    per_leg = [
        sum(model.body_mass[k] for k in range(model.nbody) if model.body(k).name.endswith(suffix))
        for suffix in LEGS.values()
    ]
    assert per_leg == pytest.approx([per_leg[0]] * 4)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    feet = np.array([data.site(f"foot{suffix}").xpos for suffix in LEGS.values()])
    names = list(LEGS)
    front, left = [n.startswith("front") for n in names], [n.endswith("left") for n in names]
    assert (feet[:, 0] > 0).tolist() == front
    assert (feet[:, 1] > 0).tolist() == left
    np.testing.assert_allclose(np.abs(feet), np.abs(feet[[0]]).repeat(4, 0), atol=1e-9)


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("sign", [-1, 1])
def test_holding_force_is_what_friction_says(joint: str, sign: int) -> None:
    # With the power off a load W slips where it exceeds (1 + stribeck) Coulomb + load_friction W.
    p = P.replace({f"{joint}.load_friction": 0.5})
    dry = dry_friction(p, joint)
    holding = (1 + dry.stribeck) * (dry.up if sign > 0 else dry.down) / (1 - 0.5)
    arm = 1.0 if joint == "shoulder" else linkage(P, joint).arm(middle(P, joint))
    without = ("backlash", "gravity")
    for share, slips in ((0.99, False), (1.01, True)):
        model = bench(joint, p.replace({f"{joint}.bearing_coulomb": 0.0}), without)
        data = mujoco.MjData(model)
        data.qpos[0] = middle(P, joint)
        data.userdata[:] = user_data(model, [circuit(p, joint, without)])
        with boards():
            for push in np.minimum(np.arange(1500) / 1000, 1.0):  # laid on within a second: no knock
                data.qfrc_applied[0] = sign * push * share * holding * arm
                mujoco.mj_step(model, data)
        assert (sign * (data.qpos[0] - middle(P, joint)) > 1e-4) == slips


@pytest.mark.parametrize("joint", ROD_JOINTS)
def test_a_self_locking_screw_holds_any_load(joint: str) -> None:
    p = P.replace({f"{joint}.coulomb": 0.0, f"{joint}.bearing_coulomb": 0.0, "foot_mass": 5.0})
    moved = []
    for share in (1.02, 0.9):  # from 1 on no load drives the screw back
        locked = p.replace({f"{joint}.load_friction": share})
        y = record(joint, np.zeros(30), ("backlash",), start=0.1, parameters=locked)
        moved.append(np.rad2deg(np.ptp(y)))
    assert moved[0] < 0.01 < 1.0 < moved[1]


def test_the_layout_of_mujocos_structs_is_the_running_ones() -> None:
    assert layout.fits()


def test_a_model_without_a_board_is_left_alone() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><size nuserdata='20'/><worldbody><body><joint name='a' damping='1'/><geom size='0.1'/></body>"
        "</worldbody>"
        "<actuator><motor joint='a'/></actuator></mujoco>"
    )
    plain, within = mujoco.MjData(model), mujoco.MjData(model)
    for data, context in ((plain, nullcontext()), (within, boards())):
        with context:
            data.ctrl[0] = 3.0
            mujoco.mj_step(model, data, 100)
    np.testing.assert_array_equal(plain.qpos, within.qpos)
    assert within.ctrl[0] == 3.0


@pytest.mark.parametrize("height", [0.35, 0.6])
def test_clearance_is_the_compiled_foots_height(height: float) -> None:
    p = P.replace({"bench_height": height})
    model = bench("leg", p)
    data = mujoco.MjData(model)
    for joint in JOINTS:
        data.joint(joint + BENCH_LEG).qpos[0] = middle(p, joint)
    mujoco.mj_kinematics(model, data)
    foot = model.geom("foot" + BENCH_LEG)
    assert clearance(p) == pytest.approx(data.geom("foot" + BENCH_LEG).xpos[2] - foot.size[0], abs=1e-9)


def test_a_bench_that_was_changed_leaves_the_next_one_as_it_is():
    """Equal ones are compiled once; each caller has numbers of its own."""
    first = bench("shank", P, ("friction",))
    step, mass = first.opt.timestep, first.body_mass.copy()
    first.opt.timestep, first.body_mass[:] = 0.5, 99.0
    second = bench("shank", P, ("friction",))
    assert second.opt.timestep == step
    np.testing.assert_array_equal(second.body_mass, mass)
    assert bench("shank", P).tendon_damping.tolist() != second.tendon_damping.tolist()
    heavy = bench("shank", P.replace({"torso_mass": 2 * P["torso_mass"]}), ("friction",))
    assert heavy.body_mass.sum() > mass.sum()
