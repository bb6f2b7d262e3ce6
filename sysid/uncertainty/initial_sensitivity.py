"""The initial state of a record for given parameters, and its sensitivity to them."""

import numpy as np

from sysid.data.record import IOData
from sysid.model.chain import Chain


def with_initial_state(chain: Chain, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) with the initial states that give the best fit to one experiment."""
    from sysid.estimation.initial_state import estimate_initial

    return estimate_initial(chain, theta, data)


def initial_state_sensitivity(J: np.ndarray, initial: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Error propagation of a fitted initial state: T (N, P) = dyhat/dtheta and S (N, n) = dyhat/de of the first n.

    J (N, P) is the free run's Jacobian with the initial states as separate parameters; `initial` (P,) marks them.
    They solve least squares over the first n samples: to first order dx0 = X+ (e - J dtheta) with X = J[:n, initial].
    """
    X = J[:n, initial]
    back = np.linalg.pinv(X / _norm(X), rcond=1e-9) / _norm(X)[:, None]
    T = J - J[:, initial] @ (back @ J[:n])
    T[:, initial] = 0.0
    return T, J[:, initial] @ back


def _norm(X: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(X, axis=0)
    return np.where(norm > 0, norm, 1.0)
