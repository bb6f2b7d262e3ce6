"""An automatic start: the kind of chain that it applies to, and its starting points for a search."""

from abc import ABC, abstractmethod

import numpy as np

from sysid.data.record import IOData
from sysid.model.chain import Chain


class Start(ABC):
    """One way to start a search, see `sysid.estimation.starts.TABLE`."""

    @abstractmethod
    def applies(self, chain: Chain) -> bool:
        """Whether this start applies to the chain."""

    @abstractmethod
    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        """Up to `count` starting points theta (P,), the best guess first; fixed values and bounds are applied later."""


def longest(data: IOData) -> IOData:
    """The longest experiment of a record."""
    return max(data.experiments, key=lambda e: e.N)


def generators(count: int, seed: int) -> list[np.random.Generator]:
    """One generator for each start after the first, so that start k does not depend on the number of starts."""
    return [np.random.default_rng([seed, k]) for k in range(1, count)]


def within(chain: Chain, theta: np.ndarray) -> np.ndarray:
    """theta within the chain's bounds, with fixed parameters at their values."""
    inside = np.clip(theta, *chain.limits)
    return np.array([chain.fixed.get(name, value) for name, value in zip(chain.names, inside, strict=True)])
