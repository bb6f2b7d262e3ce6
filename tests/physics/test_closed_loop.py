"""The tendon leg against the same leg with its actuators as bodies: cylinder, rod and a closed kinematic loop."""

import numpy as np
import pytest
from rig import QUIET

from twin import Experiment, Parameters
from twin.plant.leg import BENCH_LEG, bench, loop_positions


@pytest.mark.parametrize("joint", ["thigh", "shank"])
@pytest.mark.parametrize("excitation", ["sweep", "aprbs"])
def test_the_tendon_leg_moves_as_the_closed_loop(joint: str, excitation: str) -> None:
    tendon, loop = (
        np.rad2deg(Experiment(joint, excitation, 60.0, without=QUIET, realisation=realisation).run().y)
        for realisation in ("tendon", "closed_loop")
    )
    assert np.ptp(tendon) > 25  # two fifths of the travel take part, in a sweep both ends
    assert np.sqrt(np.mean((loop - tendon) ** 2)) < 0.05


def test_with_all_joints_free_both_move_alike() -> None:
    tendon, loop = (
        np.rad2deg(Experiment("leg", "aprbs", 40.0, without=QUIET, realisation=realisation).run().y)
        for realisation in ("tendon", "closed_loop")
    )
    assert np.ptp(tendon, axis=0).min() > 20
    assert np.sqrt(np.mean((loop - tendon) ** 2, axis=0)).max() < 0.05


@pytest.mark.parametrize("joint", ["thigh", "shank"])
@pytest.mark.parametrize("angle", [-0.5, 0.0, 0.4])
def test_the_loop_is_closed_where_it_is_assembled(joint: str, angle: float) -> None:
    import mujoco

    model = bench(joint, realisation="closed_loop")
    data = mujoco.MjData(model)
    cylinder, rod = loop_positions(Parameters(), joint, angle)
    for name, value in ((joint, angle), (f"{joint}_cylinder", cylinder), (f"{joint}_rod", rod)):
        data.joint(name + BENCH_LEG).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    gap = data.body(f"{joint}_rod{BENCH_LEG}").xpos - data.site(f"{joint}_rod{BENCH_LEG}").xpos
    axis = data.xaxis[model.joint(joint + BENCH_LEG).id]  # the pins lie side by side along it
    assert np.linalg.norm(gap - (gap @ axis) * axis) < 1e-9
