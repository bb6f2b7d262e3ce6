"""What the families of the leg share: scenario names, excitations that suit a joint, and a task from two logs."""

from typing import Any

import numpy as np

from sysid.base.errors import unknown
from sysid.bench.task import Task, Truth
from twin.experiment import PACE, Experiment
from twin.hardware.linkage import end_angles
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.truth import truth

TS = 0.05  # [s]
TRAIN, TEST = 125.0, 60.0  # [s]
DROP = 50  # samples of a test from which the initial state is taken
ORDERS = (2, 2, 1)  # a lag and an integrator
SERVO = "-servo"
HALF_PERIOD = {"fast": 2.5, "slow": 10.0}  # [s] of a drawn sweep on the nominal leg, on the mean
LEVELS = 0.6  # least level of a drawn sweep, as a share of the supply


def split_name(scenario: str, family: str, kinds: tuple[str, ...] = ("",)) -> tuple[str, str, str]:
    """Joint, kind and mode of a scenario "JOINT[-KIND][-servo]"; raises InputError for another name."""
    for name, found in named(kinds).items():
        if name == scenario:
            return found
    raise unknown(f"scenario of {family}", scenario, named(kinds))


def named(kinds: tuple[str, ...] = ("",)) -> dict[str, tuple[str, str, str]]:
    """Joint, kind and mode by scenario name."""
    return {
        f"{joint}{f'-{kind}' if kind else ''}{SERVO if mode == 'servo' else ''}": (joint, kind, mode)
        for joint in JOINTS
        for kind in kinds
        for mode in ("voltage", "servo")
    }


def crossing(joint: str, p: Parameters) -> float:
    """Time [s] that the joint of these parameters needs from end to end at full voltage, without friction."""
    low, high = end_angles(p, joint)
    return (high - low) / (abs(truth(joint, TS, p).gain) * p["supply_voltage"])


def sweep(joint: str, p: Parameters, mode: str) -> dict[str, Any]:
    """Settings of a sweep between drawn levels whose half periods fit the leg; it reaches the ends now and then."""
    half = HALF_PERIOD[PACE[joint]] * crossing(joint, p) / crossing(joint, Parameters())
    return {"half_period": round(half, 2), "jitter": 0.5, "shrink": 1.0 - LEVELS if mode == "voltage" else 0.8}


def both(train: Experiment, test: Experiment) -> tuple[Log, Log]:
    """The logs of the estimation experiment and of the other one."""
    return train.run(), test.run()


def task(train: Log, test: Log, given: str, poles: np.ndarray | None = None, orders: Any = ORDERS) -> Task:
    """The task of two logs with true readings [rad]; its noise is all that lies between reading and record."""
    assert train.y_true is not None
    assert test.y_true is not None
    known = Truth({"test": test.y_true}, float(np.std(train.y - train.y_true)), poles)
    return Task(train.io(), {"test": test.io()}, DROP, "rad", orders, known, given=given)
