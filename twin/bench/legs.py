"""Drawn legs: every seed is another leg, with all imperfections."""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.bench.task import Task
from twin.bench.records import TEST, TRAIN, TS, both, named, split_name, sweep, task
from twin.bench.standin import hidden
from twin.experiment import Experiment


@dataclass(frozen=True)
class Legs:
    """Scenarios JOINT and JOINT-servo. The seed draws geometry, motor, friction, play and delay of the leg (see
    `twin.bench.standin.RANGES`), and excitation and noise; the sweep's half periods fit the leg that was drawn.
    """

    name: str = "legs"
    about: str = "legs with drawn parameters and all imperfections"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return list(named())

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        joint, _, mode = split_name(scenario, self.name)
        p = hidden(joint, seed)
        train = Experiment(joint, "sweep", TRAIN, TS, 2 * seed, (), p, sweep(joint, p, mode), mode)
        test = Experiment(joint, "aprbs", TEST, TS, 2 * seed + 1, (), p, {}, mode)
        drawn = ", ".join(f"{name} {value:.4g}" for name, value in p.changed().items())
        return task(*both(train, test), f"{joint}, {mode}; {drawn}")
