"""The whole box of parameters: nothing explodes, and without power no leg gains energy."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch
from often import FULL, by_day

from twin import Ensemble, Experiment
from twin.ensemble.draws import whole_box
from twin.hardware.linkage import end_angles
from twin.parameters import JOINTS, Parameters
from twin.plant import slots, stepping
from twin.plant.leg import bench
from twin.plant.stepping import attempt, boards


def switched(run: stepping.Run, seed: int) -> stepping.Run:
    """The run with some power-off parts in its voltage."""
    rng = np.random.default_rng([seed, 9])
    for _ in range(2):
        start = rng.integers(len(run.commands))
        run.commands[start : start + rng.integers(1, 20)] = 0.0
    return run


@pytest.mark.slow
@pytest.mark.parametrize("joint", by_day([*JOINTS, "leg"], "leg"))  # which has all three joints
def test_nothing_explodes_in_the_parameter_box(joint: str) -> None:
    n, side_by_side = (10_000 if FULL else 100), 50
    # What the hardest impact drives into a stop; among 4 x 2,500 draws the worst was 0.024.
    slack = 0.05  # [rad]
    experiment = Experiment(joint, "aprbs", 5.0, options={"hold_min": 0.1, "hold_max": 1.5})
    whole = Ensemble(experiment, range(n), whole_box(), "unused")
    for first in range(0, n, side_by_side):
        cases = whole.members.prepare(range(first, min(first + side_by_side, n)))
        runs = [switched(case.run, case.row["seed"]) for case in cases if case.run is not None]
        assert len(runs) == len(cases)
        shown, trouble = attempt(runs, experiment.Ts, 0.5, 2)
        assert not any(trouble), trouble
        for case, rows in zip(cases, shown, strict=True):
            assert case.experiment is not None
            p = case.experiment.p
            for name, angle in zip(experiment.joints, rows[:, :, slots.ANGLE].T, strict=True):
                low, high = end_angles(p, name)
                beyond = p[f"{name}.backlash"] / 2 + slack
                assert low - beyond < angle.min() <= angle.max() < high + beyond, case.row


# Of the weight's work over half a metre and the motion at power-off: how much the energy may be above what it was then,
# and above the least since. The soft stops of play and stroke, which are not counted, give back what they took up. Legs
# of all joints free are worse than one joint: a heavy link that bounces in its play can creep against its weight.
GAIN = {"shoulder": (5e-4, 2e-3), "thigh": (5e-4, 2e-3), "shank": (5e-4, 2e-3), "leg": (5e-4, 2e-3)}
OFF = 1.5  # [s]


@pytest.mark.slow
@pytest.mark.parametrize("joint", GAIN)
def test_energy_does_not_grow_with_the_power_off(joint: str) -> None:
    n, per = (500 if FULL else 40), 100
    # No floor: a bench so low that the foot starts inside it gains what the contact pushes.
    experiment = Experiment(joint, "aprbs", OFF, without=("contact",), options={"hold_min": 0.1, "hold_max": 1.5})
    whole = Ensemble(experiment, range(n), whole_box(), "unused")
    for first in range(0, n, 20):
        numbers = range(first, min(first + 20, n))
        cases = [whole.case(number) for number in numbers]
        runs = [case.prepare() for case in cases]
        for run in runs:
            run.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        batch = Batch(runs[0].model, len(runs), 2)
        batch.set_models([run.model for run in runs])
        batch.qpos, batch.userdata = (np.stack([getattr(run, name) for run in runs]) for name in ("qpos", "user_data"))
        driven = np.repeat(np.stack([run.commands for run in runs]), per, axis=1)
        volts = np.concatenate([driven, np.zeros((len(runs), 2500, len(experiment.joints)))], axis=1)
        with boards():
            shown = batch.rollout(volts.shape[1], volts, record=("energy", "ctrl"))
        assert not batch.warning.any()
        off = driven.shape[1] + 101  # the board looks at commands every 0.1 s or more often
        assert not shown["ctrl"][:, off:].any()  # shorted: back-EMF brakes
        for case, model, energy in zip(cases, batch.models, shown["energy"][:, off:], strict=True):
            moving = model.body_mass.sum() - case.p["torso_mass"]
            whole_energy, scale = energy.sum(axis=1), 0.5 * moving * case.p["gravity"] + energy[0, 1]
            above, regrown = GAIN[joint]
            assert whole_energy.max() - whole_energy[0] <= above * scale, case.seed
            assert (whole_energy - np.minimum.accumulate(whole_energy)).max() <= regrown * scale, case.seed


LIMITS = {int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT), int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)}


@pytest.mark.parametrize(("joint", "number"), [("thigh", 65), ("thigh", 25), ("shoulder", 29), ("leg", 14)])
def test_what_comes_back_with_the_power_off_is_what_the_soft_stops_took_up(joint: str, number: int) -> None:
    """The cases of the box in which most energy comes back: without the work of the stops, none does."""
    experiment = Experiment(joint, "aprbs", OFF, without=("contact",), options={"hold_min": 0.1, "hold_max": 1.5})
    run = Ensemble(experiment, range(number + 1), whole_box(), "unused").case(number).prepare()
    model = run.model
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qpos[:], data.userdata[:] = run.qpos, run.user_data
    driven = np.repeat(run.commands, round(experiment.Ts / model.opt.timestep), axis=0)
    energy, given = [], []
    with boards():
        for volts in np.concatenate([driven, np.zeros((2500, driven.shape[1]))]):
            data.ctrl[:] = volts
            mujoco.mj_step(model, data)  # its energy is that before the step
            rows = [i for i in range(data.nefc) if int(data.efc_type[i]) in LIMITS]
            speeds = data.efc_J.reshape(-1, model.nv)[rows] @ data.qvel if rows else np.zeros(0)
            energy.append(data.energy.sum())
            given.append(float(data.efc_force[rows] @ speeds) * model.opt.timestep)
    off = len(driven) + 101
    left, work = np.array(energy[off:]), np.cumsum([0.0, *given[off:-1]])
    assert (left - np.minimum.accumulate(left)).max() > 5e-4  # [J]
    # A step of free joints is exact to first order in the step alone: in the worst case here 1.4e-9 of the energy.
    assert ((left - work) - np.minimum.accumulate(left - work)).max() < 1e-8 * abs(left[0])


def test_energy_counts_the_rotor() -> None:
    """Kinetic energy of a turning shoulder by hand: rotor and link."""
    p = Parameters()
    model = bench("shoulder", p, without=("backlash",))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    mujoco.mj_forward(model, data)
    data_without = mujoco.MjData(model)
    rotor = p["shoulder.rotor_inertia"] * p["shoulder.gear_ratio"] ** 2
    model.actuator_armature[:] = 0.0
    data_without.qvel[0] = 2.0
    mujoco.mj_forward(model, data_without)
    assert data.energy[1] - data_without.energy[1] == pytest.approx(0.5 * rotor * 2.0**2, rel=1e-9)
