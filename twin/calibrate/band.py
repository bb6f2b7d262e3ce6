"""How far the calibrated twin may be from a log that was not used: the band of its free run.

The parameters, those that kept their value among them, and the departures of `twin.calibrate.discrepancy` have a joint
posterior, linear about the optimum: one scale of each parameter and the estimated size of each departure are plausible
before (the prior). The band of another log is that of the change that they make of its response, and of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from twin.calibrate import discrepancy
from twin.calibrate.problem import Simulations


@dataclass(frozen=True)
class Lack:
    """Mean (m,) and covariance (m, m) of what the twin's parameters and departures may change, in standard deviations
    of their priors; `spreads` (n,) are those of the parameters as coordinates."""

    mean: np.ndarray
    covariance: np.ndarray
    spreads: np.ndarray
    sizes: discrepancy.Sizes
    frame: discrepancy.Frame

    def half(self, task: Simulations, p: np.ndarray, response: np.ndarray, level: float) -> np.ndarray:
        """Half width (N,) of the band of `level` about the `response` of the one record of `task` at p (n,).

        The shared parameters of `task` are those whose posterior this is.
        """
        shared = range(len(task.shared))
        columns = np.zeros((len(response), len(shared)))
        columns[task.records[0].scored] = task.columns(p, shared) * self.spreads
        groups = discrepancy.departures([response], [task.records[0].Ts], self.sizes.width, self.frame)
        D = np.hstack([columns, discrepancy.by_size(groups, self.sizes)])
        squares = (D @ self.mean) ** 2 + np.einsum("ij,jk,ik->i", D, self.covariance, D) + self.sizes.noise**2
        return np.asarray(norm.ppf(0.5 + level / 2) * np.sqrt(squares))


def lack(
    e: np.ndarray,
    J: np.ndarray,
    spreads: np.ndarray,
    own: np.ndarray,
    groups: Sequence[np.ndarray],
    size: discrepancy.Sizes,
    frame: discrepancy.Frame,
) -> Lack:
    """The posterior from residuals e (N,), their Jacobian J (N, n) by shared parameters with priors of `spreads` (n,)
    and `own` (N, q) by those of each record, and the `groups` of departures (N, k) with their sizes."""
    D = np.hstack([J * spreads, discrepancy.by_size(groups, size), own]) / size.noise
    covariance = np.linalg.inv(D.T @ D + np.eye(D.shape[1]))
    mean, m = covariance @ (D.T @ e) / size.noise, D.shape[1] - own.shape[1]
    return Lack(mean[:m], covariance[:m, :m], spreads, size, frame)
