"""The bench of one joint in its own equations beside MuJoCo, which is the independent implementation here."""

from dataclasses import replace

import numpy as np
import pytest
from often import FULL

from sysid.base.errors import InputError
from twin.ensemble.draws import whole_box
from twin.experiment import SETTLE, Experiment
from twin.follow import Follower
from twin.hardware.linkage import clearance
from twin.imperfections import IMPERFECTIONS
from twin.log import Log
from twin.parameters import JOINTS, TABLE, Parameters
from twin.plant import mechanics, slots
from twin.plant.stepping import attempt

DEGREE = np.pi / 180


def drawn(joint: str, seed: int) -> Experiment | None:
    """Any leg of the box with any imperfections off, in any mode; None where the twin refuses it."""
    rng = np.random.default_rng([seed, JOINTS.index(joint)])
    mode = str(rng.choice(["voltage", "voltage", "servo"]))
    try:
        return Experiment(
            joint,
            "aprbs" if mode == "servo" else str(rng.choice(["sweep", "aprbs", "staircase", "prbs"])),
            15.0,
            0.05,
            seed,
            tuple(name for name in IMPERFECTIONS if rng.random() < 0.2),
            whole_box(seed).draw(Parameters(), 0).parameters,
            mode=mode,
            pot_side=str(rng.choice(["link", "drive"])),
        )
    except InputError:
        return None


def both(experiment: Experiment) -> tuple[np.ndarray, np.ndarray | None]:
    """The readings (N,) of MuJoCo and of the joint's own equations."""
    run = experiment.prepare()
    shown, _ = attempt([replace(run, late=np.zeros(len(run.commands)))], experiment.Ts, SETTLE)
    per_sample = round(experiment.Ts / 1e-3)
    course = mechanics.course(
        experiment.p,
        experiment.joint,
        experiment.without,
        np.repeat(run.commands[:, 0], per_sample),
        float(run.qpos[0]),
        SETTLE,
        experiment.mode == "servo",
        experiment.pot_side == "link",
        experiment.seed,
    )
    return shown[0, :, 0, slots.READING], None if course is None else course[::per_sample]


@pytest.mark.slow
@pytest.mark.parametrize("joint", JOINTS)
def test_it_is_mujoco_in_the_whole_box(joint: str) -> None:
    """Legs of the box agree to roundings, but for few that double them at each swing: without stops, say."""
    distances = []
    for seed in range(300 if FULL else 20):
        experiment = drawn(joint, seed)
        if experiment is None:
            continue
        mujocos, own = both(experiment)
        if own is not None:
            distances.append(np.abs(own - mujocos).max())
    assert len(distances) > (100 if FULL else 10)
    assert np.median(distances) < 1e-9
    assert np.quantile(distances, 0.9) < 1e-3 * DEGREE


@pytest.mark.parametrize("joint", JOINTS)
def test_no_row_is_forgotten(joint: str) -> None:
    """A leg whose drive and board are another's, behind one whose links are the same and are kept from it."""
    rng, p = np.random.default_rng([5, JOINTS.index(joint)]), Parameters()
    names = {f"{joint}.{name}" for name in mechanics._OF_DRIVE} | set(mechanics._OF_BOARD)
    names &= {row.name for row in TABLE}
    changes = {name: p[name] * rng.uniform(0.98, 1.02) for name in sorted(names)}
    experiment = Experiment(joint, "aprbs", 10.0, 0.05, options={"amplitude": 8.0})
    both(experiment)
    for part in ({}, *({name: value} for name, value in changes.items())):
        mujocos, own = both(replace(experiment, parameters=p.replace(part)))
        np.testing.assert_allclose(own, mujocos, rtol=0, atol=1e-5 * DEGREE, err_msg=str(part))


def test_a_leg_on_the_floor_is_left_to_mujoco() -> None:
    p = Parameters()
    p = p.replace({"bench_height": p["bench_height"] - clearance(p) + 0.002})
    experiment = Experiment("thigh", "sweep", 15.0, 0.05, without=("noise", "adc", "jitter", "dropouts"), parameters=p)
    mujocos, own = both(experiment)
    assert own is None
    raised, _ = both(replace(experiment, parameters=Parameters()))
    assert np.abs(mujocos - raised).max() > DEGREE  # the floor is felt
    log = Log(experiment.commands()[:, 0], mujocos, 0.05, joint="thigh")
    (row,) = Follower(log, "thigh").readings([p], [float(experiment.prepare().qpos[0])])
    np.testing.assert_allclose(row, mujocos, rtol=0, atol=1e-9)


def test_a_closed_loop_is_left_to_mujoco() -> None:
    experiment = Experiment("shank", "aprbs", 6.0, 0.05, without=("noise", "adc", "jitter", "dropouts"))
    log, start = experiment.run(), [float(experiment.prepare().qpos[0])]
    tendon, loop = (
        Follower(log, "shank", realisation=name).readings([experiment.p], start)[0]
        for name in ("tendon", "closed_loop")
    )
    assert 1e-5 * DEGREE < np.abs(tendon - loop).max() < 0.2 * DEGREE
