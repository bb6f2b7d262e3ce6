"""Candidates for two filters with a map between them: splits of the poles and zeros of linear models, ranked.

For a first filter, the rest is a Hammerstein system from its output, which least squares solves; so every split has a
loss at once (compare Sjoberg and Schoukens 2012, Automatica 48, who search from every split).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from sysid.base.poles import monic
from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.starts._start import best_output_error, delay, denominators
from sysid.estimation.starts.portfolio import curves
from sysid.estimation.starts.portfolio.curves import is_map, line
from sysid.estimation.starts.portfolio.members import curved_input, even_part, random_poles
from sysid.estimation.starts.portfolio.screen import FEWEST, Candidate, Screen
from sysid.estimation.starts.portfolio.surrogate import Surrogate
from sysid.model.chain import Chain

_SPLITS = 60  # at most, of one linear model
_DRAWN = 12
_PLACES = 8


@dataclass(frozen=True)
class Split:
    """A first filter b (nb,), f (nf,) with its output w (N,) of standard deviation 1, and the rest as a candidate."""

    b: np.ndarray
    f: np.ndarray
    w: np.ndarray
    rest: Candidate

    @property
    def loss(self) -> float:
        """Share of the output's variance."""
        return self.rest.loss

    @property
    def signal(self) -> np.ndarray:
        """What tells candidates apart."""
        return np.concatenate([self.w, self.rest.signal / (self.rest.signal.std() or 1.0)])


def splits(
    chain: Chain, record: IOData, rng: np.random.Generator, turn: int, draw: bool, theta_best: np.ndarray | None
) -> list[Split]:
    """Candidates of one round, unsorted; poles and zeros of `theta_best` (P,), the best so far, are divided again."""
    u, y = record.u[:, 0] - record.u[:, 0].mean(), record.y[:, 0]
    (_, first), (_, second) = chain.dynamics
    series = TransferFunction(first.nb + second.nb - 1, first.nf + second.nf, first.nk + second.nk)
    linear: list[tuple[str, np.ndarray]] = []
    if turn == 0:
        aim = y - y.mean()
        raw = denominators(series, u, aim)
        linear = [("output_error", best_output_error(series, raw, u, aim))]
        linear += [("approximation", _with_zeros(series, f, u, aim)) for f in raw]
    elif theta_best is not None:
        linear = [("divided_again", _product(chain, theta_best))]
    pool: list[Split] = []
    for member, theta in linear:
        for b, f, second_poles in _divide_roots(series, theta, first, rng):
            pool += _rest(member, first, second, b, f, u, y, second_poles)
    for member, f in _unmodelled_poles(u, y, first, second, rng, turn) if draw else ():
        for b in _numerators(first, rng):
            pool += _rest(member, first, second, b, f, u, y, None)
    return pool


def _product(chain: Chain, theta: np.ndarray) -> np.ndarray:
    """Numerator and denominator of both filters in series."""
    (first_part, first), (second_part, second) = chain.dynamics
    (b1, f1, _), (b2, f2, _) = first.split(theta[first_part]), second.split(theta[second_part])
    F = np.convolve(np.concatenate([[1.0], f1]), np.concatenate([[1.0], f2]))
    return np.concatenate([np.convolve(b1, b2), F[1:]])


def surrogate_of_split(chain: Chain, split: Split, record: IOData) -> Surrogate:
    """The chain with a middle of straight lines that a split describes."""
    y = record.y[:, 0]
    (_, first), (_, second) = chain.dynamics
    middle = next(b for b in chain.blocks if is_map(b))
    knots, curve = curves.places(split.w, _PLACES), split.rest.curve
    assert curve is not None
    values = np.interp(knots, *curve[0])
    theta_first, theta_second = np.zeros(first.n_parameters), np.zeros(second.n_parameters)
    theta_first[: first.nb], theta_first[first.nb : first.nb + first.nf] = split.b, split.f
    gain = float(np.cov(split.rest.signal, y)[0, 1] / (split.rest.signal.var() or 1.0))
    theta_second[: second.nb], theta_second[second.nb : second.nb + second.nf] = gain * split.rest.b, split.rest.f
    F1, B1 = 1.0 + split.rest.f.sum(), gain * split.rest.b.sum()
    if abs(B1) > 1e-9 * np.abs(theta_second).max():
        values = values + float(np.mean(y - gain * split.rest.signal)) * F1 / B1
    blocks = tuple(line(knots, b.role) if b is middle else b for b in chain.blocks)
    return Surrogate(
        Chain(blocks, structure=chain.structure),
        np.concatenate([theta_first, values, theta_second]),
        member=split.rest.member,
    )


def _rest(
    member: str,
    first: TransferFunction,
    second: TransferFunction,
    b: np.ndarray,
    f: np.ndarray,
    u: np.ndarray,
    y: np.ndarray,
    poles: np.ndarray | None,
) -> list[Split]:
    """The Hammerstein system behind a first filter: with given poles (nf,) of the second, or with its own."""
    with np.errstate(over="ignore", invalid="ignore"):
        w = lfilter(np.concatenate([np.zeros(first.nk), b]), np.concatenate([[1.0], f]), u)
    if not np.all(np.isfinite(w)) or not w.std() > 0.0:
        return []
    b, w = b / w.std(), w / w.std()
    screen = Screen(w, y, second, before=True, behind=False, most=FEWEST)  # w is a guess: more places follow its errors
    try:
        choices = [poles] if poles is not None else list(curved_input(screen, np.random.default_rng(0)))
    except np.linalg.LinAlgError:
        return []
    rest = [c for denominator in choices for c in screen.candidates(member, denominator)]
    best = min(rest, key=lambda c: c.loss, default=None)
    return [] if best is None else [Split(b, f, w, best)]


def _with_zeros(series: TransferFunction, f: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Parameters of the linear model with the poles of f and the numerator of least squares."""
    g = lfilter([1.0], np.concatenate([[1.0], f]), u)
    X = np.column_stack([delay(g, k) for k in range(series.nk, series.nk + series.nb)])
    return np.concatenate([np.linalg.lstsq(X, y, rcond=1e-10)[0], f])


def _divide_roots(
    series: TransferFunction, theta: np.ndarray, first: TransferFunction, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """b and f of the first filter, and f of the second, for divisions of poles and zeros with pairs kept together."""
    poles = np.roots(np.concatenate([[1.0], theta[series.nb : series.nb + series.nf]])).astype(complex)
    zeros = np.roots(theta[: series.nb]).astype(complex)
    ways = list(itertools.product(choose_roots(poles, first.nf), choose_roots(zeros, min(first.nb - 1, len(zeros)))))
    if len(ways) > _SPLITS:
        ways = [ways[k] for k in rng.choice(len(ways), _SPLITS, replace=False)]
    for (first_poles, second_poles), (first_zeros, _) in ways:
        b = np.zeros(first.nb)
        b[: len(first_zeros) + 1] = np.real(np.poly(first_zeros)) if len(first_zeros) else 1.0
        yield b, monic(first_poles), monic(second_poles)


def choose_roots(roots: np.ndarray, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ways to choose n of the roots, pairs kept together; a pair becomes two real roots where there is no way."""
    for _ in range(2):
        real = [np.array([z]) for z in roots if abs(z.imag) < 1e-12]
        pairs = [np.array([z, z.conjugate()]) for z in roots if z.imag >= 1e-12]
        groups, choices = real + pairs, []
        for m in range(len(groups) + 1):
            for subset in itertools.combinations(range(len(groups)), m):
                if sum(len(groups[k]) for k in subset) == n:
                    subset_roots = [groups[k] for k in subset]
                    rest = [g for k, g in enumerate(groups) if k not in subset]
                    empty = np.empty(0, dtype=complex)
                    choices.append((np.concatenate([empty, *subset_roots]), np.concatenate([empty, *rest])))
            if len(choices) > 4 * _SPLITS:
                break
        if choices:
            return choices
        slowest = max(pairs, key=lambda pair: abs(pair[0]))
        roots = np.concatenate([*real, *(p for p in pairs if p is not slowest), np.abs(slowest) * [1.0, 0.9]])
    return [(roots[:n], roots[n:])]


def _unmodelled_poles(
    u: np.ndarray, y: np.ndarray, first: TransferFunction, second: TransferFunction, rng: np.random.Generator, turn: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Poles of the first filter that no linear model gives: from the even part, from one filter alone, and drawn."""
    if turn == 0:
        even = Screen(u, y, first, before=False, behind=True)
        yield from (("even_part", f) for f in even_part(even, rng))
        yield from (("approximation", f) for f in denominators(first, u, y - y.mean()))
    for _ in range(_DRAWN * (1 + turn)):
        yield "drawn", random_poles(first.nf, len(u), rng)


def _numerators(first: TransferFunction, rng: np.random.Generator) -> Iterator[np.ndarray]:
    yield np.eye(first.nb)[0]
    if first.nb > 1:
        zeros = rng.uniform(-1.2, 0.95, first.nb - 1)
        yield np.real(np.poly(zeros))
