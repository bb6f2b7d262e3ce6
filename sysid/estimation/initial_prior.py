"""What a free run's initial state may be before an output is seen: Gaussians with weights.

The first outputs of a short window hardly determine the state of a filter, and least squares then takes any state whose
decay resembles their noise. A prior keeps it near what the model's own states are on the record's input. It is a
mixture of Gaussians, so that the window itself chooses between rest, the steady state and the middle of an experiment
(empirical Bayes; Robbins 1956, Gelman et al., Bayesian Data Analysis, 3rd ed., chapter 5).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, hankel

from sysid.blocks import TransferFunction
from sysid.model.chain import Chain

LONGEST = 20_000  # samples of the record that give the statistics of the states
IMPULSE = 5000  # samples of the impulse response that give the states under white noise


@dataclass(frozen=True)
class Gaussian:
    """States (s,) = mean + root z with z (r,) standard normal; root (s, 0) is a point. `weight` is its prior share."""

    mean: np.ndarray
    root: np.ndarray
    weight: float


def filters_only(chain: Chain) -> bool:
    """Whether all initial states of the chain are those of transfer functions."""
    own = np.zeros(len(chain.names), dtype=bool)
    for part, _ in chain.dynamics:
        own[part] = True
    return bool(np.all(own[chain.initial]))


def priors(chain: Chain, rest: np.ndarray, u: np.ndarray, seen: np.ndarray) -> list[Gaussian]:
    """The mixture for `rest` (P,), the parameters with initial states of zero, and the input u (N, nu) of the record.

    In order: rest; any sample of a record with this input; the steady state of the first input; any steady level;
    states that the input has not caused, whose effect on the window's outputs is of the size that `seen` (M, s), the
    outputs' Jacobian divided by their distance from the run at rest, says. Each in several widths.
    """
    states, steady, levels, loose = [], [], [], []
    for part, block, w in _filters(chain, rest, u[:LONGEST]):
        own = rest[part]
        visited = _visited(block, own, w)
        states.append(visited)
        with np.errstate(invalid="ignore"):  # a filter that does not settle under an input of zero; left out below
            steady.append(_constant(block, own) * w[0])
        level = _held(block, own)
        levels.append(level[:, None] * np.sqrt(np.mean(block.output(own, w) ** 2)))
        loose.append(root_of(_visited(block, own, np.eye(1, IMPULSE)[0])))
    shortest = min(len(s) for s in states)  # the same samples of every filter
    root, n = root_of(np.hstack([s[len(s) - shortest :] for s in states])), len(seen.T)
    nothing, mean = np.zeros(n), np.concatenate(steady)
    held, free = block_diag(*levels), of_size(block_diag(*loose), seen)
    found = [Gaussian(nothing, np.zeros((n, 0)), 0.3)]
    found += [Gaussian(nothing, t * root, 0.3 / 4) for t in (1.0, 0.3, 0.1, 0.03)]
    found += [Gaussian(mean, t * root, 0.2 / 4) for t in (0.3, 0.1, 0.03, 0.0)]
    found += [Gaussian(nothing, np.hstack([t * held, 0.03 * root]), 0.1 / 2) for t in (1.0, 0.3)]
    found += [Gaussian(nothing, t * free, 0.1 / 3) for t in (10.0, 3.0, 1.0)]
    return [g for g in found if np.all(np.isfinite(g.mean)) and np.all(np.isfinite(g.root))]


def of_size(root: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """root (s, r) scaled so that `seen` (M, s), which sees the states, makes it 1 in the mean square."""
    return np.asarray(root / (np.sqrt(np.sum((seen @ root) ** 2) / len(seen)) or 1.0))


def _filters(chain: Chain, rest: np.ndarray, u: np.ndarray) -> Iterator[tuple[slice, TransferFunction, np.ndarray]]:
    """Every transfer function with an initial state: its place in theta, and its input (N,) in the run from rest."""
    for block, x in zip(chain.blocks, chain.signals(rest, u), strict=False):
        inputs = x.reshape(len(u), -1).T
        for k, (part, entry) in enumerate(block.parts()):
            if isinstance(entry, TransferFunction) and entry.initial_state and entry.n_state:
                start = chain.index(block).start
                yield slice(start + part.start, start + part.stop), entry, inputs[k % len(inputs)]


def _visited(block: TransferFunction, theta: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The block's state x0 (N - n, n) at every sample but the first n of a run from rest with the input w (N,).

    x0_i is what the past adds to the output's recursion i samples later: sum_k B_(i+k) w_(-k) - F_(i+k) x_(-k).
    """
    n = block.n_state
    B, F = block.padded(theta)
    x = block.output(theta, w)
    past = [np.lib.stride_tricks.sliding_window_view(s, n)[:, ::-1] for s in (w, x)]
    return past[0] @ hankel(B[1:]).T - past[1] @ hankel(F[1:]).T


def _constant(block: TransferFunction, theta: np.ndarray) -> np.ndarray:
    """The state (n,) after an input that was 1 for ever; not finite for an integrator."""
    B, F = block.padded(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.divide(B.sum(), F.sum())
        # x0_i = sum over k of B_(i+k) - F_(i+k) gain
        return np.asarray((np.cumsum(B[::-1])[::-1] - gain * np.cumsum(F[::-1])[::-1])[1:])


def _held(block: TransferFunction, theta: np.ndarray) -> np.ndarray:
    """The state (n,) that keeps the output at 1 while the input is zero."""
    return np.asarray(np.cumsum(block.padded(theta)[1])[:-1])


def root_of(states: np.ndarray) -> np.ndarray:
    """R (n, n) with R R' = the second moment of states (M, n)."""
    if not len(states) or not np.all(np.isfinite(states)):
        return np.zeros((states.shape[1], 0))
    R = np.asarray(np.linalg.qr(states, mode="r"))
    return R.T / np.sqrt(len(states))
