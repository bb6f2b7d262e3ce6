"""What is known of the parameters beside the record: a Gaussian prior as further rows of the least-squares problem."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Prior:
    """Errors weight (target - rows theta) on top of those of the record: rows (k, P), target (k,) and weight (k,).

    A weight is the standard deviation of the noise over that of the prior, in the unit of y. `chosen` where the record
    has chosen the weights: then the uncertainty of a fit is the posterior, and directions that the prior holds do not
    count as parameters.
    """

    rows: np.ndarray
    target: np.ndarray
    weight: np.ndarray
    chosen: bool = False

    def moved(self, M: np.ndarray, m: np.ndarray, size: float) -> "Prior":
        """The same in units with theta = M theta here + m and errors = size errors here."""
        rows = np.linalg.solve(M.T, self.rows.T).T
        return replace(self, rows=rows, target=self.target + rows @ m, weight=self.weight * size)

    def errors(self, theta: np.ndarray) -> np.ndarray:
        """e (k,) at theta (P,)."""
        return np.asarray(self.weight * (self.target - self.rows @ theta))

    def jacobian(self, basis: np.ndarray) -> np.ndarray:
        """-de/dp (k, n) for theta = theta0 + basis (P, n) p."""
        return np.asarray(self.weight[:, None] * (self.rows @ basis))
