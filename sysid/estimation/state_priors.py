"""What the initial state of a free run may be before an output is seen: Gaussians with weights.

The first outputs of a short window hardly determine the state of a filter, and least squares then takes any state whose
decay resembles their noise. A prior keeps it near what the model's own states are on the record's input. It is a
mixture of Gaussians, so that the window itself chooses between rest, the steady state and the middle of an experiment
(empirical Bayes; Robbins 1956, Gelman et al., Bayesian Data Analysis, 3rd ed., chapter 5).

The states that a nonlinear state space visits lie close to a curved surface, and a few outputs leave most directions
off this surface open. So its prior has a Gaussian around each of several visited states, as wide and as inclined as
their neighbours lie (an adaptive kernel density; Silverman 1986, chapter 5). The candidates are the visited states
whose outputs are nearest to the record's (as the particles of Gordon et al. 1993, IEE Proc. F 140).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, hankel

from sysid.base.errors import InputError
from sysid.block.block import StaticBlock
from sysid.blocks import StateSpace, TransferFunction
from sysid.data.record import IOData
from sysid.model.chain import Chain

LONGEST = 20_000  # samples of the record that give the statistics of the states
IMPULSE = 5000  # samples of the impulse response that give the states under white noise
_SMALL = 1e-3  # impulse by the scale of the input: small enough for the linear part
_VISITED = 2000  # states that the candidates are taken from
_COMPARED = 30  # samples of the window that choose the candidates
_CANDIDATES = 16
_NEIGHBOURS = 50  # visited states that give the width of a Gaussian
_APART = 0.3  # distance between candidates, by the standard deviation of the states


@dataclass(frozen=True)
class Gaussian:
    """States (s,) = mean + root z with z (r,) standard normal; root (s, 0) is a point. `weight` is its prior share."""

    mean: np.ndarray
    root: np.ndarray
    weight: float


def priors(chain: Chain, rest: np.ndarray, u: np.ndarray, sensitivity: np.ndarray) -> list[Gaussian]:
    """The mixture for `rest` (P,), the parameters with initial states of zero, and the input u (N, nu) of the record.

    In order: rest; any sample of a record with this input; the steady state of the first input; any steady level;
    states that the input has not caused, whose effect on the window's outputs is of the size that `sensitivity` (M, s)
    says, the outputs' Jacobian divided by their distance from the run at rest. Each in several widths.
    """
    states, steady, levels, loose = [], [], [], []
    for part, block, w in _filters(chain, rest, u[:LONGEST]):
        theta = rest[part]
        samples = _sampled_states(block, theta, w)
        states.append(samples)
        with np.errstate(invalid="ignore"):  # a filter that does not settle under an input of zero; left out below
            steady.append(_constant(block, theta) * w[0])
        level = _level_state(block, theta)
        levels.append(level[:, None] * np.sqrt(np.mean(block.output(theta, w) ** 2)))
        loose.append(root_of(_sampled_states(block, theta, np.eye(1, IMPULSE)[0])))
    shortest = min(len(s) for s in states)  # the same samples of every filter
    root, n = root_of(np.hstack([s[len(s) - shortest :] for s in states])), len(sensitivity.T)
    zero, mean = np.zeros(n), np.concatenate(steady)
    root_levels, free = block_diag(*levels), of_size(block_diag(*loose), sensitivity)
    mixture = [Gaussian(zero, np.zeros((n, 0)), 0.3)]
    mixture += [Gaussian(zero, t * root, 0.3 / 4) for t in (1.0, 0.3, 0.1, 0.03)]
    mixture += [Gaussian(mean, t * root, 0.2 / 4) for t in (0.3, 0.1, 0.03, 0.0)]
    mixture += [Gaussian(zero, np.hstack([t * root_levels, 0.03 * root]), 0.1 / 2) for t in (1.0, 0.3)]
    mixture += [Gaussian(zero, t * free, 0.1 / 3) for t in (10.0, 3.0, 1.0)]
    return [g for g in mixture if np.all(np.isfinite(g.mean)) and np.all(np.isfinite(g.root))]


def of_size(root: np.ndarray, sensitivity: np.ndarray) -> np.ndarray:
    """root (s, r) scaled so that `sensitivity` (M, s), which sees the states, makes it 1 in the mean square."""
    return np.asarray(root / (np.sqrt(np.sum((sensitivity @ root) ** 2) / len(sensitivity)) or 1.0))


def _filters(chain: Chain, rest: np.ndarray, u: np.ndarray) -> Iterator[tuple[slice, TransferFunction, np.ndarray]]:
    """Every transfer function with an initial state: its place in theta, and its input (N,) in the run from rest."""
    for block, x in zip(chain.blocks, chain.signals(rest, u), strict=False):
        inputs = x.reshape(len(u), -1).T
        for k, (part, entry) in enumerate(block.parts()):
            if isinstance(entry, TransferFunction) and entry.initial_state and entry.n_state:
                start = chain.index(block).start
                yield slice(start + part.start, start + part.stop), entry, inputs[k % len(inputs)]


def _sampled_states(block: TransferFunction, theta: np.ndarray, w: np.ndarray) -> np.ndarray:
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


def _level_state(block: TransferFunction, theta: np.ndarray) -> np.ndarray:
    """The state (n,) that keeps the output at 1 while the input is zero."""
    return np.asarray(np.cumsum(block.padded(theta)[1])[:-1])


def root_of(states: np.ndarray) -> np.ndarray:
    """R (n, n) with R R' = the second moment of states (M, n)."""
    if not len(states) or not np.all(np.isfinite(states)):
        return np.zeros((states.shape[1], 0))
    R = np.asarray(np.linalg.qr(states, mode="r"))
    return R.T / np.sqrt(len(states))


def state_space_of(chain: Chain) -> StateSpace | None:
    """The chain's state space, if all initial states are its own and only maps stand behind it."""
    k = next((k for k, b in enumerate(chain.blocks) if isinstance(b, StateSpace)), None)
    if k is None or not all(isinstance(b, StaticBlock) for b in chain.blocks[k + 1 :]):
        return None
    block = chain.blocks[k]
    own = chain.initial[chain.index(block)].sum() == chain.initial.sum()
    return block if own and isinstance(block, StateSpace) else None


def state_space_priors(
    chain: Chain, block: StateSpace, rest: np.ndarray, data: IOData, u: np.ndarray, sensitivity: np.ndarray
) -> list[Gaussian]:
    """The mixture of a state space, with the arguments of `priors` and the window `data`.

    In order: rest; the steady states of an input of zero, where an experiment begins if the input has another centre,
    and of the first input; any state of the record's size; visited states; states that the input has not caused.
    """
    k = chain.blocks.index(block)
    theta, w = chain.part(rest, block), chain.signals(rest, u[:LONGEST])[k].reshape(-1, block.nu)
    X = block.states(theta, _extend_input(w))
    X = X[np.all(np.isfinite(X), axis=1)]
    X = X[:: max(len(X) // _VISITED, 1)]
    zero, root = np.zeros(block.nx), root_of(X)
    mixture = [Gaussian(zero, np.zeros((block.nx, 0)), 0.3)]
    for level in (np.zeros(block.nu), w[0]):
        mean = _steady(block, theta, level)
        if mean is not None:
            mixture += [Gaussian(mean, t * root, 0.2 / 8) for t in (0.3, 0.1, 0.03, 0.0)]
    mixture += [Gaussian(zero, t * root, 0.05 / 4) for t in (1.0, 0.3, 0.1, 0.03)]
    mixture += _gaussians_around(X, _misfit(chain, block, rest, data, w, X), 0.4)
    free = of_size(_impulses(block, theta), sensitivity)
    mixture += [Gaussian(zero, t * free, 0.05 / 3) for t in (10.0, 3.0, 1.0)]
    return [g for g in mixture if np.all(np.isfinite(g.root))]


def _extend_input(w: np.ndarray) -> np.ndarray:
    """The input w (N, nu) twice, and pieces of it in drawn order up to `_VISITED` samples: the past is not known.

    Pieces keep how an input moves (block bootstrap; Kuensch 1989, Annals of Statistics 17).
    """
    rng, n = np.random.default_rng(0), len(w)
    parts, total = [w, w], 2 * n
    while total < _VISITED:
        length = int(rng.integers(n // 8 + 1, n // 2 + 2))
        parts.append(np.take(w, np.arange(length) + int(rng.integers(n)), axis=0, mode="wrap"))
        total += length
    return np.concatenate(parts)


def _misfit(
    chain: Chain, block: StateSpace, rest: np.ndarray, data: IOData, w: np.ndarray, X: np.ndarray
) -> np.ndarray:
    """Mean square (M,) of the first outputs' distance from the runs with the input w (N, nu) from each of X (M, nx)."""
    n = min(data.N, _COMPARED)
    Y = block.outputs_from(chain.part(rest, block), w[:n], X).reshape(len(X) * n, -1)
    ys = [np.ascontiguousarray(column) for column in Y.T]
    for b in chain.blocks[chain.blocks.index(block) + 1 :]:
        ys = b.propagate_all(chain.part(rest, b), ys, [np.empty((len(Y), 0))] * len(ys), 0)[0]
    distance = np.where(data.observed[:n], data.y[:n] - np.column_stack(ys).reshape(len(X), n, -1), 0.0)
    with np.errstate(over="ignore"):  # from a state at which the run diverges
        return np.nan_to_num(np.mean(distance**2, axis=(1, 2)), nan=np.inf)


def _gaussians_around(X: np.ndarray, misfit: np.ndarray, weight: float) -> list[Gaussian]:
    """Gaussians around the visited states X (M, nx) of small misfit (M,) that lie apart, each with its neighbours."""
    size = np.std(X, axis=0)
    _, s, Vt = np.linalg.svd((X - X.mean(axis=0)) / np.where(size > 0, size, 1.0), full_matrices=False)
    if not len(s) or s[0] == 0.0:
        return []
    own = s > 1e-6 * s[0]
    white = (X / np.where(size > 0, size, 1.0)) @ Vt[own].T / (s[own] / np.sqrt(len(X)))
    gaussians: list[Gaussian] = []
    excluded = np.zeros(len(X), dtype=bool)
    for k in np.argsort(misfit, kind="stable"):
        if excluded[k] or len(gaussians) == _CANDIDATES:
            continue
        distance = np.sum((white - white[k]) ** 2, axis=1)
        excluded |= distance < _APART**2
        neighbours = np.argsort(distance, kind="stable")[1 : _NEIGHBOURS + 1]
        gaussians.append(Gaussian(X[k], root_of(X[neighbours] - X[k]), weight * (len(neighbours) + 1) / len(X)))
    return gaussians


def _impulses(block: StateSpace, theta: np.ndarray) -> np.ndarray:
    """A root of the second moment of the states after small impulses, from rest."""
    centre, scale, _, _ = block.scales()
    pulses = [np.zeros((IMPULSE, block.nu)) for _ in range(block.nu)]
    for k, pulse in enumerate(pulses):
        pulse[0, k] = _SMALL
    return root_of(np.vstack([block.states(theta, centre + scale * pulse) for pulse in pulses]))


def _steady(block: StateSpace, theta: np.ndarray, u: np.ndarray) -> np.ndarray | None:
    try:
        return block.rest(theta, u)
    except InputError:
        return None
