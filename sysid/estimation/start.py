"""What an automatic start is: a kind of chain that it applies to, and starting points for a search over it."""

from abc import ABC, abstractmethod

import numpy as np

from sysid.data.record import IOData
from sysid.model.chain import Chain


class Start(ABC):
    """One way to start a search, see `sysid.estimation.starts.TABLE`."""

    @abstractmethod
    def applies(self, chain: Chain) -> bool:
        """Whether this start knows chains of this kind."""

    @abstractmethod
    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        """Up to `count` starting points theta (P,), the best guess first; what is held or bounded comes later."""


def longest(data: IOData) -> IOData:
    """The longest experiment of a record."""
    return max(data.experiments, key=lambda e: e.N)


def generators(count: int, seed: int) -> list[np.random.Generator]:
    """One generator for each start behind the first, so that start k is the same however many are asked for."""
    return [np.random.default_rng([seed, k]) for k in range(1, count)]
