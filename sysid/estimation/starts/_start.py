"""What starts have in common: the interface of one, maps near the identity, and linear models of a record."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.base.poles import mirrored, monic
from sysid.block.block import Block, StaticBlock
from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.problem import ChainProblem, search_best
from sysid.model.chain import Chain, columns
from sysid.solver.iterate import Options

_EMPTY = 1e-12  # singular values below this share of the largest are zero


class Start(ABC):
    """One way to start a search, see `sysid.estimation.starts.TABLE`: for chains with a block of one of these kinds."""

    blocks: ClassVar[tuple[type[Block], ...]]

    def applies(self, chain: Chain) -> bool:
        """Whether this start applies to the chain."""
        return any(isinstance(b, self.blocks) for b in chain.blocks) and self.suits(chain)

    def suits(self, chain: Chain) -> bool:
        """Whether this start applies to a chain that has a block of its kinds."""
        return True

    @abstractmethod
    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        """Up to `count` starting points theta (P,), the best guess first; fixed values and bounds are applied later."""


def longest(data: IOData) -> IOData:
    """The longest experiment of a record, of those in which all inputs move if there are such."""
    return data.experiments[longest_number(data)]


def longest_number(data: IOData) -> int:
    """The number of the `longest` experiment, from 0."""
    moves = [bool(np.ptp(e.u, axis=0).all()) for e in data.experiments]
    return max(range(len(moves)), key=lambda k: (moves[k], data.lengths[k]))


def signals_of(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """Input and output of a record as `Chain.signals` has them: (N,) where there is one channel, else (N, channels)."""
    u, y = (x[:, 0] if x.shape[1] == 1 else x for x in (data.u, data.y))
    return u, y


def filters_of(block: Block) -> tuple[TransferFunction, ...]:
    """The transfer functions that a block consists of; none of another block."""
    return tuple(part for _, part in block.parts() if isinstance(part, TransferFunction))


def filter_blocks(chain: Chain) -> list[Block]:
    """The chain's blocks of transfer functions."""
    return [block for block in chain.blocks if filters_of(block)]


def generators(count: int, seed: int) -> list[np.random.Generator]:
    """One generator for each start after the first, so that start k does not depend on the number of starts."""
    return [np.random.default_rng([seed, k]) for k in range(1, count)]


def clip_to_bounds(chain: Chain, theta: np.ndarray) -> np.ndarray:
    """theta within the chain's bounds, with fixed parameters at their values."""
    clipped_theta = np.clip(theta, *chain.limits)
    return np.array([chain.fixed.get(name, value) for name, value in zip(chain.names, clipped_theta, strict=True)])


def start_maps(
    chain: Chain, theta: np.ndarray, blocks: tuple, x: np.ndarray, target: np.ndarray, straight: bool = False
) -> np.ndarray:
    """Start static maps from x to target, (N,) or (N, n), write them into theta and return their output.

    `straight`: on a straight line, see `StaticBlock.straight`.
    """
    for b in blocks:
        maps = [m for _, m in b.parts() if isinstance(m, StaticBlock)]
        if len(maps) < len(b.parts()):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        theta[chain.index(b)] = np.concatenate(
            [
                _shift_output(m, m.straight(xi) if straight else m.start(xi), xi, goal)
                for m, xi, goal in zip(maps, columns(x, len(maps)), columns(target, len(maps)), strict=True)
            ]
        )
        x = Chain((b,)).through(theta[chain.index(b)], x)
    return x


def _shift_output(block: StaticBlock, theta: np.ndarray, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """theta changed along the block's output shift, if it has one, so that the mean output equals the target's mean."""
    for s in block.symmetries(theta):
        if s.out_shift == 1.0 and s.in_shift == 0.0:
            y = block.output(theta, x)
            return theta + s.d_theta * float(np.mean(target - y))
    return theta


def output_error_start(linear: Block, w: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Parameters of a linear block (p,) for w, y: the best of several linear starts after output error each."""
    return best_output_error(linear, denominators(linear, w, y), w, y)


def best_output_error(linear: Block, raw: list[np.ndarray], w: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Parameters (p,) of the best output-error search, each from poles f of `raw`."""
    problems = (ChainProblem.least_squares(Chain((linear,)), solve_linear(linear, f, w, y), w, y) for f in raw)
    return search_best(problems, Options.from_estimate(30), np.zeros(linear.n_parameters))[0]


def coefficients(linear: Block) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions in theta of all b, of all f and of the initial states of a linear block, one entry after the other."""
    b, f, x0 = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for place, entry in linear.parts():
        assert isinstance(entry, TransferFunction)
        ends = np.arange(place.start, place.stop), (entry.nb, entry.nb + entry.nf)
        for group, positions in zip((b, f, x0), np.split(*ends), strict=True):
            group.append(positions)
    return np.concatenate(b), np.concatenate(f), np.concatenate(x0)


def refined_iv(nb: int, nf: int, nk: int, w: np.ndarray, y: np.ndarray, iterations: int = 20) -> np.ndarray:
    """f (nf,) of y = B/F w by refined instrumental variables (Young 2011, Recursive Estimation, ch. 7).

    Regressors are filtered by the last 1/F; the instruments are the noise-free output of the last model. Poles outside
    the unit circle are mirrored before each pass. The pass with the best free-run fit is returned.
    """
    from sysid.block.kernels import all_pole

    linear = TransferFunction(nb, nf, nk, initial_state=False)
    f, x, best, best_cost = np.zeros(nf), y, np.zeros(nf), np.inf
    for _ in range(iterations):
        wf, yf, xf = np.empty_like(w), np.empty_like(w), np.empty_like(w)
        for signal, out in ((w, wf), (y, yf), (x, xf)):
            all_pole(f, signal, out)
        inputs = [delay(wf, nk + i) for i in range(nb)]
        regressors = np.column_stack([-delay(yf, j + 1) for j in range(nf)] + inputs)
        instruments = np.column_stack([-delay(xf, j + 1) for j in range(nf)] + inputs)
        # An orthonormal basis of the instruments: products with them would square the condition number.
        Q, R = np.linalg.qr(instruments)
        U, s, _ = np.linalg.svd(R)
        basis = Q @ U[:, s > _EMPTY * s.max(initial=0.0)]  # a poor excitation leaves directions empty
        theta = np.linalg.lstsq(basis.T @ regressors, basis.T @ yf, rcond=_EMPTY)[0]
        f = mirrored(theta[:nf])
        with np.errstate(over="ignore", invalid="ignore"):
            x = linear.output(np.concatenate([theta[nf:], f]), w)
            cost = float(np.sum((y - x) ** 2))
        if not np.isfinite(cost):
            break
        if cost < best_cost:
            converged = best_cost - cost < 1e-6 * cost
            best, best_cost = f, cost
            if converged:
                break
    return best


def denominators(
    linear: Block, w: np.ndarray, y: np.ndarray, rates: tuple[int, ...] = (4, 16, 64, 256)
) -> list[np.ndarray]:
    """Candidates for f of a linear block, that of one entry after the other; w (N,) or (N, nu), y (N,) or (N, ny)."""
    return joined([_denominators(entry, wi, goal, rates) for entry, wi, goal in alone(linear, w, y)])


def joined(candidates: list[list[np.ndarray]]) -> list[np.ndarray]:
    """The k-th candidates of all entries in one, for each k; the last one of an entry that has fewer."""
    count = max(map(len, candidates)) if all(candidates) else 0
    return [np.concatenate([each[min(k, len(each) - 1)] for each in candidates]) for k in range(count)]


def alone(linear: Block, w: np.ndarray, y: np.ndarray) -> Iterator[tuple[TransferFunction, np.ndarray, np.ndarray]]:
    """Every entry of a linear block with its input (N,), and with its output (N,) less what other inputs contribute."""
    (nu, ny), entries = linear.channels, iter(filters_of(linear))
    ws = columns(w, nu)
    for goal in columns(y, ny):
        shares = _shares(ws, goal) if nu > 1 else [goal]
        for i, wi in enumerate(ws):
            yield next(entries), wi, goal - sum(shares[:i] + shares[i + 1 :], np.zeros(1))


def _shares(ws: list[np.ndarray], y: np.ndarray) -> list[np.ndarray]:
    """Contribution of each input (N,) to y (N,), by one least-squares fit of finite responses."""
    length = max(2, min(80, len(y) // (4 * len(ws))))
    X = np.column_stack([delay(w, k) for w in ws for k in range(length)])
    response = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    return [X[:, i : i + length] @ response[i : i + length] for i in range(0, X.shape[1], length)]


def _denominators(linear: TransferFunction, w: np.ndarray, y: np.ndarray, rates: tuple[int, ...]) -> list[np.ndarray]:
    """Candidates for f (nf,) by refined IV, from the record and from records decimated by `rates`.

    If sampling is much faster than the dynamics, all poles are close to 1; poles of a decimated record are converted
    to the full rate.
    """
    candidates = [refined_iv(linear.nb, linear.nf, linear.nk, w, y)]
    for thin in rates:
        n = len(w) // thin
        if linear.nf == 0 or n < 20 * (linear.nb + linear.nf):
            break
        means = w[: n * thin].reshape(n, thin).mean(axis=1)
        slow = refined_iv(linear.nf, linear.nf, 1, means, y[: n * thin : thin])
        poles = np.roots(np.concatenate([[1.0], slow])).astype(complex)
        # A pole on the negative real axis is the alias of none; it becomes a fast one.
        poles = np.where((poles.real <= 0) & (np.abs(poles.imag) < 1e-12), 1e-3, poles)
        candidates.append(monic(poles ** (1.0 / thin)))
    return candidates


def same_poles(linear: Block, a: np.ndarray, b: np.ndarray) -> bool:
    """True if the poles of two linear blocks differ by less than a tenth of their distance from the unit circle."""
    for place, entry in linear.parts():
        assert isinstance(entry, TransferFunction)
        p, q = np.sort_complex(entry.poles(a[place])), np.sort_complex(entry.poles(b[place]))
        if not np.all(np.abs(p - q) < 0.1 * np.maximum(1.0 - np.abs(p), 1e-6)):
            return False
    return True


def solve_linear(linear: Block, f: np.ndarray, w: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (p,) with these poles f, and with B and the initial states of least squares."""
    at_b, at_f, at_x0 = coefficients(linear)
    theta = np.zeros(linear.n_parameters)
    theta[at_f] = f
    J = Chain((linear,)).sensitivities(theta, w)[1]
    enters = np.concatenate([at_b, at_x0])  # these enter linearly
    if np.all(np.isfinite(J[:, enters])):
        theta[enters] = np.linalg.lstsq(J[:, enters], y.T.ravel(), rcond=1e-12)[0]
    return theta


def delay(x: np.ndarray, k: int) -> np.ndarray:
    """x (N,) k samples later, with zeros before it."""
    return np.concatenate([np.zeros(k), x[: len(x) - k]])
