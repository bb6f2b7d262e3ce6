"""Starts of a Box-Jenkins chain: the plant from the record through several whitening filters, then its noise.

The record as it is gives the plant of output error. Filtered by the A of a long regression A y = B u + e, it has the
noise e, which is white, so that the same search is that of the prediction errors (Zhu and Hjalmarsson 2016, Automatica
65). What the plant leaves is C/D e, whose C and D are a regression on itself and on e (Hannan and Rissanen 1982,
Biometrika 69). C and D that nearly cancel have optima of their own, so that C of several speeds is tried beside it.
"""

import numpy as np

from sysid.base.poles import mirrored, monic
from sysid.blocks import BoxJenkins
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, delay, generators, longest, output_error_start
from sysid.model.chain import Chain

_SAMPLES = 8  # of a record for each parameter of a long regression
_LONG = (10, 40)  # its lags
_SPEEDS = (0.5, 0.8, 0.95)  # roots of C
_EMPTY = 1e-12


class BoxJenkinsStarts(Start):
    """An offset at the mean of the input, then the plant and its noise; more starts vary the poles of the plant."""

    blocks = (BoxJenkins,)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record, block = longest(data), chain.blocks[-1]
        assert isinstance(block, BoxJenkins)
        u, y = np.ascontiguousarray(record.u[:, 0]), np.ascontiguousarray(record.y[:, 0])
        level, aim = u - u.mean(), y - y.mean()
        plants = [output_error_start(block.plant, level, aim)]
        for lags in _LONG:
            if len(y) >= _SAMPLES * 2 * lags:
                A = np.append(1.0, _regression(level, aim, lags, block.nk))
                white = [np.convolve(A, x)[: len(x)][lags:] for x in (level, aim)]
                plants.append(output_error_start(block.plant, *white))
        points = [_point(chain, block, plant, u, y) for plant in plants]
        for speed in _SPEEDS if block.nc else ():
            points.append(_point(chain, block, plants[0], u, y, monic(np.full(block.nc, speed))))
        points += [_point(chain, block, block.plant.vary(plants[0], rng), u, y) for rng in generators(count, seed)]
        return points if count > 1 else points[:1]


def _regression(u: np.ndarray, y: np.ndarray, lags: int, nk: int) -> np.ndarray:
    """The coefficients (lags,) of y in a regression on as many samples of y and of u before."""
    past = [-delay(y, j) for j in range(1, lags + 1)] + [delay(u, nk + i) for i in range(lags)]
    first = lags + nk
    solution: np.ndarray = np.linalg.lstsq(np.column_stack(past)[first:], y[first:], rcond=_EMPTY)[0]
    return solution[:lags]


def _point(
    chain: Chain, block: BoxJenkins, plant: np.ndarray, u: np.ndarray, y: np.ndarray, c: np.ndarray | None = None
) -> np.ndarray:
    """theta (P,) with this F, and B, the initial state and the offset by least squares; C and D of what they leave.

    c (nc,) where C is given.
    """
    theta, linear = np.zeros(len(chain.names)), chain.index(block)
    J = np.empty((len(u), block.plant.n_parameters))
    part = plant.copy()
    block.plant.propagate(part, u, J, 0)
    enters = np.ones(len(part), dtype=bool)
    enters[block.nb : block.nb + block.nf] = False
    columns = np.column_stack([J[:, enters], np.ones(len(u))])
    solution = np.linalg.lstsq(columns, y, rcond=_EMPTY)[0]
    part[enters] = solution[:-1]
    v = y - columns @ solution
    gain = block.plant.gain(part)
    if linear.start and gain and np.isfinite(gain):
        theta[0] = solution[-1] / gain
        part = block.plant.lowered(part, theta[0])
    theta[linear.start : linear.start + len(part)] = part
    theta[linear.start + len(part) : linear.stop] = (
        _noise(v, block.nc, block.nd) if c is None else np.append(c, _poles(v, c, block.nd))
    )
    return theta


def _noise(v: np.ndarray, nc: int, nd: int) -> np.ndarray:
    """c (nc,) and d (nd,) of v (N,), with the errors of the longest autoregression that the record bears."""
    lags = min(max(_LONG), len(v) // _SAMPLES)
    past = np.column_stack([delay(v, j) for j in range(1, lags + 1)])
    e = v - past @ np.linalg.lstsq(past[lags:], v[lags:], rcond=_EMPTY)[0] if lags else v
    columns = [delay(e, j) for j in range(1, nc + 1)] + [-delay(v, j) for j in range(1, nd + 1)]
    if not columns:
        return np.zeros(0)
    first = lags + max(nc, nd)
    solution = np.linalg.lstsq(np.column_stack(columns)[first:], (v - e)[first:], rcond=_EMPTY)[0]
    return np.concatenate([mirrored(solution[:nc]), mirrored(solution[nc:])])


def _poles(v: np.ndarray, c: np.ndarray, nd: int) -> np.ndarray:
    """d (nd,) of v (N,) for this C: D v / C is nearest to zero."""
    from sysid.block.kernels import all_pole

    w = np.empty_like(v)
    all_pole(c, v, w)
    columns = np.column_stack([np.empty((len(v), 0)), *(-delay(w, j) for j in range(1, nd + 1))])
    return mirrored(np.linalg.lstsq(columns, w, rcond=_EMPTY)[0])
