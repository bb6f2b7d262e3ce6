"""Other poles for a filter, now that the maps beside it are known: linear models of the signals inside the chain.

Coarse curves leave errors that hide a weak pole; a fit with good curves may keep the wrong one. From its own signals
the filter can be identified again as a linear system.
"""

import numpy as np
from scipy.signal import lfilter

from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.linear_start import denominators, same_poles
from sysid.estimation.portfolio.members import random_poles
from sysid.model.chain import Chain

_DRAWN, _NEAR = 20, 10  # pole sets drawn, and varied from the present ones
_FLAT = 0.1  # of the mean slope: flatter parts of a map say little of what is before them


def alternatives(
    chain: Chain, theta: np.ndarray, record: IOData, rng: np.random.Generator, count: int
) -> list[np.ndarray]:
    """Up to `count` points theta (P,), each with other poles of one filter, the likeliest first."""
    signals = chain.signals(theta, record.u[:, 0])
    e = record.y[:, 0] - signals[-1]
    if not np.all(np.isfinite(e)):
        return []
    found: list[tuple[float, np.ndarray]] = []
    for k, block in enumerate(chain.blocks):
        if not isinstance(block, TransferFunction) or not block.nf:
            continue
        if any(isinstance(b, TransferFunction) for b in chain.blocks[k + 1 :]):
            continue  # what its output should be is hidden behind another filter
        target = signals[k + 1] + _through(chain, theta, k, signals[k + 1], e)
        found += _of(chain, theta, block, signals[k], target, rng)
    found.sort(key=lambda pair: pair[0])
    kept: list[np.ndarray] = []
    for _, point in found:
        others = [theta, *kept]
        if all(not _same(chain, point, other) for other in others):
            kept.append(point)
            if len(kept) == count:
                break
    return kept


def _through(chain: Chain, theta: np.ndarray, k: int, w: np.ndarray, e: np.ndarray) -> np.ndarray:
    """What would have to be added to w (N,), the output of block k, to take away the errors e (N,)."""
    if k + 1 == len(chain.blocks):
        return e
    step = 1e-4 * float(np.ptp(w) or 1.0)
    slope = (chain.through(theta, w + step, k + 1) - chain.through(theta, w - step, k + 1)) / (2.0 * step)
    least = _FLAT * float(np.mean(np.abs(slope))) or 1.0
    return e * slope / (slope**2 + least**2)


def _of(
    chain: Chain,
    theta: np.ndarray,
    block: TransferFunction,
    x: np.ndarray,
    target: np.ndarray,
    rng: np.random.Generator,
) -> list[tuple[float, np.ndarray]]:
    """Losses and points with other poles of one filter from x to target (N,), its B and initial state solved for."""
    part = chain.part(theta, block)
    tried = denominators(block, x - x.mean(), target - target.mean())
    tried += [np.real(np.poly(block.stretched(part, rng)))[1:] for _ in range(_NEAR)]
    tried += [random_poles(block.nf, len(x), rng) for _ in range(_DRAWN)]
    found = []
    for f in tried:
        F = np.concatenate([[1.0], f])
        with np.errstate(over="ignore", invalid="ignore"):
            g, h = lfilter([1.0], F, x), lfilter([1.0], F, np.eye(1, len(x))[0])
        columns = [_delayed(g, block.nk + i) for i in range(block.nb)]
        columns += [_delayed(h, i) for i in range(block.n_state if block.initial_state else 0)]
        A = np.column_stack(columns)
        if not np.all(np.isfinite(A)):
            continue
        own = np.linalg.lstsq(A, target, rcond=1e-10)[0]
        fresh = theta.copy()
        fresh[chain.index(block)] = np.concatenate([own[: block.nb], f, own[block.nb :]])
        if block.admissible(chain.part(fresh, block)):
            found.append((float(np.mean((target - A @ own) ** 2)), fresh))
    return found


def _same(chain: Chain, a: np.ndarray, b: np.ndarray) -> bool:
    return all(same_poles(block, a[part], b[part]) for part, block in chain.dynamics if block.nf)


def _delayed(x: np.ndarray, k: int) -> np.ndarray:
    return np.concatenate([np.zeros(k), x[: len(x) - k]])
