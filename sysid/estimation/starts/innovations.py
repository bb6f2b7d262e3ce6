"""Starts of a chain that predicts: estimators of several speeds, with the plant of each by least squares.

For a given C the prediction is linear in A, B, the initial state and a constant, so that only C needs a guess: that of
a long regression's innovations (Hannan and Rissanen 1982, Biometrika 69), or poles at one place.
"""

import numpy as np

from sysid.base.poles import mirrored, monic
from sysid.block.block import StaticBlock
from sysid.blocks import Innovations
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, delay, generators, longest, start_maps
from sysid.model.chain import Chain

_SPEEDS = (0.0, 0.5, 0.8, 0.95)  # poles of the estimators
_SAMPLES = 8  # of a record for each parameter of the long regression
_LONG = (10, 40)  # its lags


class Predictors(Start):
    """Maps near the identity, then a linear block that predicts; more starts vary the maps and the estimators."""

    blocks = (Innovations,)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record, linear = longest(data), chain.blocks[-1]
        assert isinstance(linear, Innovations)
        u, y = np.ascontiguousarray(record.u[:, 0]), np.ascontiguousarray(record.y[:, 0])
        theta = np.zeros(len(chain.names))
        w = start_maps(chain, theta, chain.blocks[:-1], u, u - u.mean())
        guesses = [*_of_long_regressions(linear, w, y), *(monic(np.full(linear.nf, z)) for z in _SPEEDS)]
        points = [_point(chain, linear, theta, u, y, c) for c in guesses]
        for rng in generators(count, seed):
            varied = points[0].copy()
            for b in chain.blocks:
                varied[chain.index(b)] = b.vary(chain.part(varied, b), rng)
            c = chain.part(varied, linear)[linear.states.stop :]
            points.append(_point(chain, linear, varied, u, y, c))
        return points[: len(guesses) + count - 1] if count > 1 else points[:1]


def _of_long_regressions(linear: Innovations, w: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """C (nf,) from the innovations of regressions on many lags."""
    n, found = linear.nf, []
    for lags in _LONG:
        if len(y) < _SAMPLES * 2 * lags:
            break
        past = [delay(y, j) for j in range(1, lags + 1)] + [delay(w, linear.nk + i) for i in range(lags)]
        e = _errors(np.column_stack([*past, np.ones(len(y))]), y, lags + linear.nk)
        columns = [-delay(y, j + 1) for j in range(n)] + [delay(w, linear.nk + i) for i in range(linear.nb)]
        columns += [delay(e, j + 1) for j in range(n)] + [np.ones(len(y))]
        first = lags + linear.nk + n
        solution = np.linalg.lstsq(np.column_stack(columns)[first:], y[first:], rcond=1e-12)[0]
        found.append(mirrored(solution[n + linear.nb : n + linear.nb + n]))
    return found


def _errors(regressors: np.ndarray, y: np.ndarray, first: int) -> np.ndarray:
    """Errors (N,) of a regression from sample `first` on, 0 before it."""
    e = np.zeros_like(y)
    e[first:] = y[first:] - regressors[first:] @ np.linalg.lstsq(regressors[first:], y[first:], rcond=1e-12)[0]
    return e


def _point(
    chain: Chain, linear: Innovations, theta: np.ndarray, u: np.ndarray, y: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """theta (P,) with this C, and A, B, the initial state and the maps' constant by least squares."""
    point, n = theta.copy(), linear.states.stop
    w = chain.through(point, u, 0, len(chain.blocks) - 1)
    part = np.zeros(linear.n_parameters)
    part[n:] = c
    J = np.empty((len(w), linear.n_parameters))
    at_zero = linear.predict_all(part, [w], [J], 0, y[:, None])[0][0]  # A = 1, B = 0: what C alone predicts
    constant = np.empty((len(w), 0))
    maps = [b for b in chain.blocks[:-1] if isinstance(b, StaticBlock)]
    if any(b.n_parameters for b in maps):
        one = linear.predict_all(
            np.concatenate([[1.0], np.zeros(n - 1), c]), [np.ones(len(w))], [constant], 0, 0.0 * y[:, None]
        )[0][0]
        constant = one[:, None]
    solution = np.linalg.lstsq(np.column_stack([J[:, :n], constant]), y - at_zero, rcond=1e-12)[0]
    part[:n] = solution[:n]
    point[chain.index(linear)] = part
    gain = float(part[: linear.nb].sum())
    if constant.shape[1] and gain:
        _shift(chain, point, maps, solution[n] / gain)
    return point


def _shift(chain: Chain, theta: np.ndarray, maps: list[StaticBlock], offset: float) -> None:
    """Moves the output of the last map that can by `offset`."""
    for b in reversed(maps):
        for s in b.symmetries(chain.part(theta, b)):
            if s.out_shift == 1.0 and s.in_shift == 0.0:
                theta[chain.index(b)] += offset * s.d_theta
                return
