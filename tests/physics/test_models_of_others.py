"""`export --into` on models of the kinds that people publish: what differs is listed, and nothing else differs."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from sysid import InputError
from sysid.blocks import Motor, Play
from sysid.export import mjcf
from sysid.structures import actuated_joint
from twin.fragment.into import put_into

VALUES = {"gain": 0.01, "lag": 0.6, "rise": 1.5, "fall": 1.5, "x0": 0.1, "v0": 0.0, "delay": 0.4}
VALUES |= {"lower": -0.5, "upper": 0.6, "width": 0.02, "rest": 0.0}


def links(*names, more=None, last=""):
    """A chain of bodies with a hinge each; `more` are attributes by joint, `last` is put into the last body."""
    more = more or {}
    opened = "".join(
        f'<body name="b_{n}" pos="0 0 0.2"><joint name="{n}" axis="0 1 0" {more.get(n, "")}/>'
        f'<geom size="0.04" mass="0.5"/><site name="s_{n}" pos="0.05 0 0.1"/>'
        for n in names
    )
    return opened + last + "</body>" * len(names)


ARM = f"""<mujoco model="arm"><compiler angle="radian"/>
<default><joint damping="0.5" armature="0.1"/>
<default class="servo"><position kp="40" ctrlrange="-2 2"/></default></default>
<worldbody>{links("shoulder", "knee", "wrist", more={"knee": 'range="-2 2" frictionloss="0.1"'})}</worldbody>
<actuator><position class="servo" name="a_shoulder" joint="shoulder"/>
<position class="servo" name="a_knee" joint="knee"/><velocity class="servo" name="v_knee" joint="knee" kv="2"/>
<position class="servo" name="a_wrist" joint="wrist"/></actuator>
<sensor><jointpos name="at" joint="knee"/></sensor>
<keyframe><key name="home" qpos="0.1 0.2 0.3" ctrl="0.1 0.2 0 0.3"/>
<key name="up" qpos="1 0.5 0" ctrl="1 0.5 0 0"/></keyframe>
</mujoco>"""

PARALLEL = f"""<mujoco model="scara"><worldbody>{links("base", "knee")}</worldbody>
<actuator><general name="turn" joint="base" gear="3"/><general name="bend" jointinparent="knee" biastype="affine"
gainprm="20" biasprm="0 -20 -1"/></actuator></mujoco>"""

TENDON_OF_ONE = f"""<mujoco model="toe"><worldbody>{links("hip", "knee")}</worldbody>
<tendon><fixed name="cable"><joint joint="knee" coef="0.02"/></fixed></tendon>
<actuator><motor name="hip" joint="hip"/><motor name="pull" tendon="cable"/></actuator></mujoco>"""

QUADRUPED = f"""<mujoco model="quadruped">
<default><default class="leg"><joint range="-60 60" damping="1"/></default></default>
<worldbody><body name="trunk" pos="0 0 1" childclass="leg"><freejoint name="root"/><geom size="0.2" mass="5"/>
{links("fl_hip", "fl_calf")}{links("knee", "fr_calf")}</body></worldbody>
<actuator><motor name="m_fl_hip" joint="fl_hip"/><motor name="m_fl_calf" joint="fl_calf"/>
<motor name="m_knee" joint="knee"/><motor name="m_fr_calf" joint="fr_calf"/></actuator>
<keyframe><key name="stand" qpos="0 0 1 1 0 0 0 0.1 0.2 0.3 0.4" qvel="0 0 0 0 0 0 1 2 3 4" ctrl="1 2 3 4"/></keyframe>
</mujoco>"""

SPRUNG = f"""<mujoco model="finger"><worldbody>{links("mcp", "knee")}</worldbody>
<tendon><spatial name="extensor" stiffness="30" damping="0.2">
<site site="s_mcp"/><site site="s_knee"/></spatial></tendon>
<actuator><motor name="flex" joint="knee"/></actuator></mujoco>"""

GRIPPER = f"""<mujoco model="hand"><worldbody>{links("knee", "tip")}</worldbody>
<tendon><fixed name="flexor"><joint joint="knee" coef="1"/><joint joint="tip" coef="0.7"/></fixed></tendon>
<actuator><position name="close" tendon="flexor" kp="10"/></actuator></mujoco>"""

MIMIC = f"""<mujoco model="pincher"><worldbody>{links("knee")}{links("other")}</worldbody>
<equality><joint name="mirror" joint1="other" joint2="knee" polycoef="0 -1 0 0 0"/></equality>
<actuator><motor name="m" joint="knee"/></actuator></mujoco>"""

FIT = {"ARM": ARM, "PARALLEL": PARALLEL, "TENDON_OF_ONE": TENDON_OF_ONE, "QUADRUPED": QUADRUPED, "SPRUNG": SPRUNG}
OF_JOINT = ("range", "limited", "damping", "armature", "stiffness", "frictionloss", "axis", "pos", "type")
OF_ACTUATOR = ("trntype", "gainprm", "biasprm", "dynprm", "ctrlrange", "ctrllimited", "gear", "gaintype", "biastype")


def fragment(play=True):
    chain = actuated_joint(motor=Motor(load=0), knots=None, play=Play() if play else False)
    theta = np.array([VALUES[name.split(".")[1]] for name in chain.names])
    return mjcf.fragment(SimpleNamespace(model=chain, theta=theta, Ts=0.05), "knee", 2.0)


def compiled(model):
    """What MuJoCo has of a model, by kind and name; keyframes by joint and actuator."""
    found = {}
    for kind, names, count in (("joint", OF_JOINT, model.njnt), ("actuator", OF_ACTUATOR, model.nu)):
        for k in range(count):
            element = getattr(model, kind)(k)
            found[kind, element.name] = np.concatenate(
                [np.ravel(getattr(element, name)).astype(float) for name in names]
            )
    for k in range(model.nkey):
        key = model.key(k).name
        for j in range(model.njnt):
            at, end = model.jnt_qposadr[j], model.jnt_qposadr[j + 1] if j + 1 < model.njnt else model.nq
            found["key", key, model.joint(j).name] = model.key_qpos[k][at:end]
        for j in range(model.nu):
            found["key", key, model.actuator(j).name] = model.key_ctrl[k][[j]]
    for kind, count in (
        ("body", model.nbody),
        ("tendon", model.ntendon),
        ("equality", model.neq),
        ("sensor", model.nsensor),
    ):
        found |= {(kind, getattr(model, kind)(k).name): np.zeros(1) for k in range(count)}
    return found


@pytest.mark.parametrize("play", [True, False])
@pytest.mark.parametrize("name", FIT)
def test_all_that_differs_in_the_compiled_model_is_listed_and_the_rest_is_as_it_was(name, play, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(FIT[name])
    text, changes = put_into(fragment(play), path)
    before, after = (compiled(mujoco.MjModel.from_xml_string(t)) for t in (FIT[name], text))
    differ = [
        key
        for key in {**before, **after}
        if key not in before or key not in after or not np.array_equal(before[key], after[key])
    ]
    assert ("joint", "knee") in differ
    for key in differ:
        assert any(repr(key[1]) in change for change in changes), (key, changes)
    own = {"knee", "knee_play", "knee_angle", "a_knee", "v_knee", "bend", "pull", "m_knee", "flex"}
    assert {key[-1] for key in differ if key[0] != "body"} <= own
    for change in changes:  # and nothing is listed that did not change
        said = change.split("'")[1]
        assert any(said in key for key in differ) or "stays and acts" in change, change


def test_the_order_of_actuators_and_the_values_of_keyframes_stay(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(QUADRUPED)
    text, changes = put_into(fragment(), path)
    model = mujoco.MjModel.from_xml_string(text)
    assert [model.actuator(k).name for k in range(model.nu)] == ["m_fl_hip", "m_fl_calf", "m_knee", "m_fr_calf"]
    place = {model.joint(k).name: model.key_qpos[0][model.jnt_qposadr[k]] for k in range(1, model.njnt)}
    assert place == {"fl_hip": 0.1, "fl_calf": 0.2, "knee": 0.3, "knee_play": 0.0, "fr_calf": 0.4}
    assert list(model.key_ctrl[0]) == [1, 2, 0, 4]
    assert any("'stand'" in c and "ctrl 1 2 3 4 becomes 1 2 0 4" in c for c in changes)
    assert any("qpos (12 numbers): 0 is added as number 11" in c for c in changes)


def test_two_motors_of_one_joint_become_one(tmp_path):
    (tmp_path / "robot.xml").write_text(ARM)
    text, changes = put_into(fragment(), tmp_path / "robot.xml")
    model = mujoco.MjModel.from_xml_string(text)
    assert [model.actuator(k).name for k in range(model.nu)] == ["a_shoulder", "knee", "a_wrist"]
    assert {"position 'a_knee' is taken out", "velocity 'v_knee' is taken out"} <= set(changes)
    np.testing.assert_array_equal(model.key_ctrl, [[0.1, 0, 0.3], [1, 0, 0]])


def test_a_tendon_at_its_dead_centre_acts_too(tmp_path):
    """Straight above the joint, where a small turn changes its length by the square of the turn."""
    straight = SPRUNG.replace('<site name="s_knee" pos="0.05 0 0.1"/>', '<site name="s_knee" pos="0 0 0.1"/>')
    straight = straight.replace('<site name="s_mcp" pos="0.05 0 0.1"/>', '<site name="s_mcp" pos="0 0 0.1"/>')
    assert straight != SPRUNG
    (tmp_path / "robot.xml").write_text(straight)
    _, changes = put_into(fragment(), tmp_path / "robot.xml")
    assert any("tendon 'extensor' stays" in c for c in changes)


def test_a_tendon_that_goes_on_pulling_is_named(tmp_path):
    (tmp_path / "robot.xml").write_text(SPRUNG)
    _, changes = put_into(fragment(), tmp_path / "robot.xml")
    assert any("tendon 'extensor' stays and acts on 'knee' with stiffness and damping" in c for c in changes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GRIPPER, "the actuator 'close' moves 'knee' together with tip"),
        (MIMIC, "an equality constraint 'mirror' acts on 'knee'"),
        (TENDON_OF_ONE.replace('name="pull" ', ""), "1 actuators move 'knee' and 0 of them stand in this file"),
    ],
)
def test_what_cannot_be_replaced_is_refused(text, said, tmp_path):
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(InputError, match=said):
        put_into(fragment(), tmp_path / "robot.xml")
