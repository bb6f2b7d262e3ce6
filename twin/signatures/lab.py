"""The bench of the experiments that show the imperfections."""

from collections.abc import Sequence

import numpy as np

from twin.experiment import SETTLE, Experiment
from twin.imperfections import IMPERFECTIONS, Trial
from twin.parameters import Parameters
from twin.plant import slots
from twin.plant.stepping import TIMESTEP, step
from twin.truth import truth


def omit_all_but(*names: str) -> tuple[str, ...]:
    """All imperfections except these, to be left out."""
    return tuple(name for name in IMPERFECTIONS if name not in names)


def pair(
    name: str, other_names: Sequence[str], p: Parameters, joint: str, u: np.ndarray, Ts: float, **settings
) -> tuple[Trial, Trial]:
    """The same trial with the imperfections `name` and `other_names`, and with only those of `other_names`."""
    omissions = omit_all_but(name, *other_names), omit_all_but(*other_names)
    run, base = (trial(p, joint, u, Ts, without=names, **settings) for names in omissions)
    return run, base


def trial(
    parameters: Parameters, joint: str, u: np.ndarray, Ts: float, start: float | None = None, **settings
) -> Trial:
    """`joint` under u (N,) [V], each value held for Ts [s]; it starts at rest at `start` [rad] or mid stroke."""
    experiment = Experiment(joint, Ts=Ts, parameters=parameters, **settings)
    run = experiment.prepare(u=u[:, None], start={} if start is None else {joint: start})
    boards = step([run], Ts, SETTLE)[0]
    angle, reading, volts = (boards[:, 0, column] for column in (slots.ANGLE, slots.READING, slots.VOLTS))
    return Trial(np.arange(len(u)) * Ts, u, angle, reading, volts, experiment.record(run, boards).y)


FREE = ("coulomb", "bearing_coulomb", "viscous", "bearing_viscous")


def free(p: Parameters, joint: str) -> Parameters:
    """The same with a joint that only back-EMF brakes."""
    return p.replace({f"{joint}.{name}": 0.0 for name in FREE})


def lag(p: Parameters, joint: str) -> float:
    """Time constant [s] of the free joint's speed; friction makes it shorter."""
    return -1.0 / truth(joint, parameters=free(p, joint)).continuous_pole


def tick(p: Parameters) -> float:
    """The board's reading interval [s], in whole steps of the simulation."""
    return max(1, round(p["switch_period"] / TIMESTEP)) * TIMESTEP
