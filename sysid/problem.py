"""A chain and a record as a least-squares problem in the chain's free parameters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.chain import Chain


@dataclass(frozen=True)
class ChainProblem:
    """min over p of sum (y - yhat)^2, with p the entries of theta where `free` is True and the others kept.

    theta (P,) gives the values that are kept; u and y are (N,).
    """

    chain: Chain
    theta: np.ndarray
    u: np.ndarray
    y: np.ndarray
    free: np.ndarray

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        slots = self.chain.slots
        return np.array([s.lower for s in slots])[self.free], np.array([s.upper for s in slots])[self.free]

    @property
    def p(self) -> np.ndarray:
        """The free parameters of `theta`."""
        return self.theta[self.free]

    @property
    def size(self) -> float:
        """y'y."""
        return float(self.y @ self.y)

    def full(self, p: np.ndarray) -> np.ndarray:
        """theta (P,) with the free entries replaced by p."""
        theta = self.theta.copy()
        theta[self.free] = p
        return theta

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e (N,), or None outside the bounds or where the chain is not admissible."""
        lower, upper = self._limits
        if np.any(p < lower) or np.any(p > upper):
            return None
        theta = self.full(p)
        if not self.chain.admissible(theta):
            return None
        return self.y - self.chain.simulate(theta, self.u)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dp (N, free parameters)."""
        yhat, J = self.chain.tangent(self.full(p), self.u)
        return self.y - yhat, J if self.free.all() else J[:, self.free]
