"""The initial state of a free run given its first outputs: the mean over what it may be, or exactly rest.

For a fixed Gaussian the state is a ridge regression with a known weight; its marginal likelihood tells how well this
Gaussian, this size and this correlation of the noise explain the outputs (Rasmussen and Williams 2006, chapter 5). The
mean over all of them has the smallest expected error (Hoeting et al. 1999, Bayesian model averaging).
"""

from dataclasses import dataclass

import numpy as np

from sysid.block.block import Block
from sysid.blocks import StateSpace, TransferFunction
from sysid.data.record import IOData
from sysid.estimation.state_priors import Gaussian, priors, state_space_of, state_space_priors
from sysid.model.chain import Chain

# Weights and widths were chosen on windows of drawn systems (scripts/initial_windows.py).
_INFLATED = ((1.0, 0.6), (4.0, 0.2), (25.0, 0.1), (400.0, 0.1))  # noise variance by that of the fit, prior share
_CORRELATED = (0.0, 0.5, 0.8, 0.95)  # of neighbouring errors: those of a model that is not exact are seldom white
_DOUBT = 0.03  # probability of rest above which the run begins there: no estimate then spoils a record from rest
_RARE = 1e-3  # share below which a state is not considered
_AHEAD = 500  # samples over which the runs of likely states are compared
_STEPS = 12  # Gauss-Newton steps of a chain with a map behind its filter


@dataclass(frozen=True)
class _Window:
    """The outputs' distance r (M,) from the run at some states x (s,), and their Jacobian J (M, s) there.

    `rows` are the lengths of the outputs' stretches in r.
    """

    x: np.ndarray
    r: np.ndarray
    J: np.ndarray
    rows: tuple[int, ...]

    def at_zero(self) -> np.ndarray:
        """r (M,) of the linearisation at x = 0."""
        return np.asarray(self.r + self.J @ self.x)


def likely_initial(
    chain: Chain, rest: np.ndarray, data: IOData, u: np.ndarray, noise_variance: float
) -> np.ndarray | None:
    """theta (P,) whose initial states are likely after the outputs of `data`; None if the model's run is not finite.

    rest (P,) has initial states of zero, u (N, nu) is the input of the whole record, which tells how large states
    become; noise_variance [unit of y squared] is that of the fit.
    """
    window = _linearise(chain, rest, data, np.zeros(int(chain.initial.sum())))
    if window is None or not len(window.r):
        return None
    size = float(np.sqrt(np.mean(window.r**2)))
    if size == 0.0:
        return rest
    noise = max(noise_variance, (1e-9 * size) ** 2)
    sensitivity = window.J / size
    entries = [entry for b in chain.blocks[_first(chain) :] for _, entry in b.parts()]
    affine = all(_affine(entry) for entry in entries)
    space = state_space_of(chain)
    mixture = (
        priors(chain, rest, u, sensitivity)
        if space is None
        else state_space_priors(chain, space, rest, data, u, sensitivity)
    )
    states, evidence = [], []
    for g in mixture:
        linearisation = window if affine else _search_mode(chain, rest, data, g, noise, window)
        x, log = _posterior(linearisation, g, noise)
        states.append(x)
        evidence.append(log + np.log(g.weight))
    share = np.exp(np.array(evidence) - max(evidence))
    share /= share.sum()
    if share[0] > _DOUBT:
        return rest
    theta = rest.copy()
    if affine:
        theta[chain.initial] = share @ np.array(states)
    elif space is not None:
        theta[chain.initial] = _central(chain, rest, u, np.array(states), share)
    else:
        theta[chain.initial] = states[int(np.argmax(share))]
    return theta


def _affine(entry: Block) -> bool:
    return isinstance(entry, TransferFunction) or (isinstance(entry, StateSpace) and not entry.features)


def _central(chain: Chain, rest: np.ndarray, u: np.ndarray, states: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Of states (K, s) and their mean, the one whose run is nearest to the mean of all runs (share (K,)).

    The mean run has the smallest expected error; the mean of states that a map cannot tell apart may be none of them.
    """
    likely = share > _RARE
    states, share = states[likely], share[likely] / share[likely].sum()
    states = np.vstack([states, share @ states])
    runs = []
    for x in states:
        theta = rest.copy()
        theta[chain.initial] = x
        runs.append(chain.outputs(theta, u[:_AHEAD]).ravel())
    with np.errstate(invalid="ignore", over="ignore"):
        middle = share @ np.array(runs[:-1])
        error = np.array([np.sum((run - middle) ** 2) for run in runs])
    return np.asarray(states[np.argmin(np.where(np.isfinite(error), error, np.inf))])


def _first(chain: Chain) -> int:
    """Number of the first block with an initial state."""
    return next(k for k, b in enumerate(chain.blocks) if any(s.initial for s in b.slots()))


def _linearise(chain: Chain, theta: np.ndarray, data: IOData, x: np.ndarray) -> _Window | None:
    theta = theta.copy()
    theta[chain.initial] = x
    y, J = chain.sensitivities(theta, data.u)
    observed = data.observed.T
    r, J = (data.y - y).T[observed], J[:, chain.initial][observed.ravel()]
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J))):
        return None
    return _Window(x, r, J, tuple(int(k) for k in observed.sum(axis=1)))


def _search_mode(chain: Chain, rest: np.ndarray, data: IOData, g: Gaussian, noise: float, window: _Window) -> _Window:
    """The linearisation at the most likely states under one Gaussian and white noise."""

    def cost(w: _Window, z: np.ndarray) -> float:
        return float(w.r @ w.r) / noise + float(z @ z)

    z = np.zeros(g.root.shape[1])
    current = _linearise(chain, rest, data, g.mean) if g.mean.any() else window
    if current is None:
        return window
    for _ in range(_STEPS if len(z) else 0):
        A = np.vstack([current.J @ g.root / np.sqrt(noise), np.eye(len(z))])
        target = np.concatenate([current.r / np.sqrt(noise), -z])
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(target))):  # the states stay where they are
            break
        step = np.linalg.lstsq(A, target, rcond=None)[0]
        cost_before, scale = cost(current, z), 1.0
        while scale > 1e-3:
            trial = _linearise(chain, rest, data, g.mean + g.root @ (z + scale * step))
            if trial is not None and cost(trial, z + scale * step) < cost_before:
                break
            scale *= 0.25
        else:
            break
        z, current = z + scale * step, trial
        if cost(current, z) > cost_before - 1e-3:
            break
    return current


def _posterior(window: _Window, g: Gaussian, noise: float) -> tuple[np.ndarray, float]:
    """Mean of the states (s,) under one Gaussian, over sizes and correlations of the noise, and the log evidence."""
    distance, J = window.at_zero() - window.J @ g.mean, window.J @ g.root
    means, logs = [], []
    for correlation in _CORRELATED:
        r, A, logdet = _whiten(distance, J, window.rows, correlation)
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        projection = U.T @ r
        remainder = max(float(r @ r - projection @ projection), 0.0)
        for inflation, share in _INFLATED:
            variance = inflation * noise
            shrinkage = 1.0 + s**2 / variance
            means.append(Vt.T @ (s * projection / variance / shrinkage))
            square = remainder / variance + float(np.sum(projection**2 / shrinkage)) / variance
            logs.append(
                np.log(share) - 0.5 * (square + float(np.sum(np.log(shrinkage))) + len(r) * np.log(variance) + logdet)
            )
    highest = max(logs)
    weight = np.exp(np.array(logs) - highest)
    total = float(weight.sum())
    return g.mean + g.root @ (weight / total @ np.array(means)), highest + float(np.log(total))


def _whiten(
    r: np.ndarray, J: np.ndarray, rows: tuple[int, ...], correlation: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """r and J in coordinates in which AR(1) noise of variance 1 is white, and the log determinant of its covariance."""
    if correlation == 0.0:
        return r, J, 0.0
    columns = np.column_stack([r, J])
    parts, end = [], 0
    for n in rows:
        piece = columns[end : end + n]
        end += n
        if n:
            parts += [piece[:1], (piece[1:] - correlation * piece[:-1]) / np.sqrt(1.0 - correlation**2)]
    white = np.concatenate(parts)
    steps = sum(max(n - 1, 0) for n in rows)
    return white[:, 0], white[:, 1:], steps * float(np.log(1.0 - correlation**2))
