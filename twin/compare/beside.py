"""The twin's response beside a log, from the start that fits best: what a viewer shows."""

from dataclasses import dataclass

import numpy as np

from twin.compare.search import Search, refine
from twin.compare.trials import Trials
from twin.follow import Follower
from twin.log import Log, check_plausible
from twin.parameters import Parameters


@dataclass(frozen=True)
class Beside:
    """Time t (N,) [s], input u (N,) [V], the log's angle y and the twin's (N,) [rad] of one joint."""

    joint: str
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    twin: np.ndarray


def beside(log: Log, joint: str, parameters: Parameters | None = None, pot_side: str = "link") -> Beside:
    """The twin under the input of the log; raises InputError for a joint that the log does not have, and for
    numbers that cannot be of it."""
    follower, p = Follower(log, joint, pot_side=pot_side), parameters or Parameters()
    check_plausible(log, joint, p)
    trials, search = Trials(follower, p), Search("", ())
    refine(trials, search, follower.y, rounds=2)
    (row,) = trials.rows([search.state])
    return Beside(joint, log.t, follower.u, follower.y, row)
