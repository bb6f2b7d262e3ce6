"""Task: what one scenario and seed give to a method, and how it is judged. Family: where tasks come from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from sysid.bench.contract import Data
from sysid.data.record import IOData
from sysid.model.chain import Chain

SEEDS = 2**20  # of a method: generators of some libraries take no larger ones


@dataclass(frozen=True)
class Truth:
    """What is known of a synthetic plant: noise-free outputs (N,) of the tests, and noise-free output of the
    estimation record, the standard deviation of the noise on it, poles in z, and chain and parameters if it is a chain.
    """

    y: Mapping[str, np.ndarray]
    noise: float
    poles: np.ndarray | None = None
    chain: Chain | None = None
    theta: np.ndarray | None = None


@dataclass(frozen=True)
class Task:
    """An estimation record, and test records by name whose first `drop` samples are known and not scored.

    Split, dropped samples and the unit of errors travel with it. `orders` are told to every method. `published` are
    errors of other people's models by the same protocol, in `unit`. `given` says in words what was drawn.
    """

    train: IOData
    tests: Mapping[str, IOData]
    drop: int
    unit: str = ""
    orders: tuple[int, int, int] | None = None
    truth: Truth | None = None
    published: Mapping[str, str] = field(default_factory=dict)
    given: str = ""

    def data(self, seconds: float, seed: int) -> Data:
        """The estimation record as a method gets it."""
        parts = self.train.experiments
        return Data(
            tuple(e.u[:, 0] for e in parts),
            tuple(e.y[:, 0] for e in parts),
            tuple(~e.observed[:, 0] for e in parts),
            self.train.Ts,
            self.orders,
            seconds,
            seed % SEEDS,
        )


class Family(Protocol):
    """Scenarios of one kind. A scenario is a name; with a seed it becomes a task. Objects travel to other processes."""

    @property
    def name(self) -> str:
        """First part of the names of its scenarios."""
        ...

    @property
    def about(self) -> str:
        """What its scenarios are, in a few words."""
        ...

    def scenarios(self) -> Sequence[str]:
        """Names of its scenarios, without the family's name."""
        ...

    def make(self, scenario: str, seed: int) -> Task:
        """The task of one scenario and seed, always the same. Raises InputError if its records are not there."""
        ...
