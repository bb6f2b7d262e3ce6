"""A chain and a record as a least-squares problem."""

from dataclasses import dataclass

import numpy as np

from sysid.chain import Chain
from sysid.uncertainty import Covariance, covariance


@dataclass(frozen=True)
class ChainProblem:
    """min over p of sum (y - yhat)^2 with theta = theta0 + basis[:, moving] p.

    theta0 (P,) is where p = 0; u and y are (N,); moving (P,) marks the directions of the chain's basis in p (n,).
    """

    chain: Chain
    theta0: np.ndarray
    u: np.ndarray
    y: np.ndarray
    moving: np.ndarray

    @classmethod
    def whole(cls, chain: Chain, theta0: np.ndarray, u: np.ndarray, y: np.ndarray) -> "ChainProblem":
        """All free parameters move, in the basis that their blocks ask for."""
        return cls(chain, theta0, u, y, chain.free)

    @classmethod
    def initial_state(cls, chain: Chain, theta0: np.ndarray, u: np.ndarray, y: np.ndarray) -> "ChainProblem":
        """Only the initial states move."""
        return cls(chain, theta0, u, y, chain.initial)

    @property
    def start(self) -> np.ndarray:
        """p (n,) of theta0."""
        return np.zeros(int(self.moving.sum()))

    @property
    def size(self) -> float:
        """y'y."""
        return float(self.y @ self.y)

    def theta(self, p: np.ndarray) -> np.ndarray:
        """All parameters (P,) at p (n,)."""
        return self.theta0 + self.chain.basis[:, self.moving] @ p

    def repair(self, p: np.ndarray) -> np.ndarray:
        """p within the bounds, and where the chain is admissible if its blocks know how."""
        theta = self.theta(p)
        if not np.all(np.isfinite(theta)):
            return p
        repaired = self.chain.repair(theta)
        if np.array_equal(repaired, theta):
            return p
        return p + np.linalg.solve(self.chain.basis, repaired - theta)[self.moving]

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """True (n,) where p stands at a limit and the descent direction `gradient` points beyond it."""
        low, high = self.chain.at_limit(self.theta(p))
        return (low[self.moving] & (gradient < 0)) | (high[self.moving] & (gradient > 0))

    def covariance(self, p: np.ndarray) -> Covariance:
        """Covariance of theta at p; a direction that a limit holds counts as known."""
        e, J = self.linearise(p)
        theta = self.theta(p)
        open_ = ~self.blocked(p, J.T @ e)
        basis = self.chain.basis[:, self.moving]
        redundant = np.linalg.solve(self.chain.basis, self.chain.gauge(theta))[self.moving]
        return covariance(e, J[:, open_], redundant[open_], basis[:, open_], self.chain.count(theta))

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e (N,), or None where the chain is not admissible."""
        theta = self.theta(p)
        if not self.chain.admissible(theta):
            return None
        return self.y - self.chain.simulate(theta, self.u)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dp (N, n)."""
        yhat, J = self.chain.tangent(self.theta(p), self.u)
        for b in self.chain.blocks:
            part = self.chain.index(b)
            if b.has_basis:
                J[:, part] = J[:, part] @ self.chain.basis[part, part]
        return self.y - yhat, J if self.moving.all() else J[:, self.moving]
