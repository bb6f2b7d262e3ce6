"""A network in the units of its record, from one that was fitted in normal units, see `sysid.estimation.normal`."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.direction import direction
from sysid.data.record import IOData
from sysid.estimation.normal import largest_unit, observed, unit_of
from sysid.nlarx.model import Network
from sysid.nlarx.result import Choice
from sysid.solver.covariance import Covariance


@dataclass(frozen=True)
class Units:
    """u = a u and y = b y in normal units; powers of two or their negatives, so that nothing is rounded."""

    a: float
    b: float

    @classmethod
    def of(cls, data: IOData) -> "Units":
        """The units that bring the spread of a record of one input and one output near 1, and its signs to one side."""
        u, (y,) = data.u[:, 0], observed(data)
        return cls(direction(u) * unit_of(u), direction(y) * largest_unit(data))

    def normal(self, data: IOData) -> IOData:
        """The record in normal units."""
        return replace(data, u=data.u / self.a + 0.0, y=data.y / self.b + 0.0)

    def factors(self, network: Network) -> np.ndarray:
        """theta (P,) of the network by theta in normal units: its units see coordinates, which have none."""
        found = np.ones(network.size)
        found[0] = self.b
        found[1 : 1 + network.n] = self.b / self._regressors(network)
        found[network.dilations - 1] = self.b
        return found

    def network(self, network: Network) -> Network:
        """A network of normal units for regressors in those of the record."""
        r = self._regressors(network)
        return replace(network, mu=network.mu * r, T=np.ascontiguousarray(network.T / r))

    def covariance(self, found: Covariance, network: Network) -> Covariance:
        """The covariance of theta in the units of the record."""
        f = self.factors(network)
        return Covariance(found.cov * np.outer(f, f), found.unidentifiable, found.noise_variance * self.b**2)

    def choices(self, tried: tuple[Choice, ...]) -> tuple[Choice, ...]:
        """The errors of each size in the unit of the output."""
        size = abs(self.b)
        return tuple(replace(c, error=c.error * size, free=c.free * size) for c in tried)

    def _regressors(self, network: Network) -> np.ndarray:
        model = network.model
        return np.repeat([self.b, self.a], [model.na, model.nb])
