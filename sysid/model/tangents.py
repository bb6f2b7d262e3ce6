"""The tangent of a chain at a steady state, and its steady-state curve, each with the exact gradient in theta.

The chain's poles, zeros, gain and responses all follow from B and F here, and none of them depends on the gauge.
"""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.base.poles import ROUNDING
from sysid.block.block import StaticBlock
from sysid.blocks import Innovations, Process, StateSpace, TransferFunction
from sysid.model.chain import Chain

_STEP = 1e-6  # of the signal's size: step of the central difference that gives the gradient of a slope


@dataclass(frozen=True)
class Rational:
    """B/F in powers of q^-1: B (n,) with delays as zeros, F (m,) from its leading 1; their gradients (n, P), (m, P)."""

    B: np.ndarray
    F: np.ndarray
    B_gradient: np.ndarray
    F_gradient: np.ndarray

    def times(self, other: "Rational") -> "Rational":
        """The two transfer functions in series."""
        return Rational(
            np.convolve(self.B, other.B),
            np.convolve(self.F, other.F),
            _product(self.B, self.B_gradient, other.B, other.B_gradient),
            _product(self.F, self.F_gradient, other.F, other.F_gradient),
        )

    @property
    def gain(self) -> float:
        """B(1)/F(1); infinite with a pole at 1."""
        F1 = self.F.sum()
        return float(self.B.sum() / F1) if abs(F1) > ROUNDING else np.inf

    @property
    def gain_gradient(self) -> np.ndarray:
        """Gradient (P,) of a finite gain."""
        return (self.B_gradient.sum(axis=0) - self.gain * self.F_gradient.sum(axis=0)) / self.F.sum()


@np.errstate(over="ignore", invalid="ignore")  # far from all data: what is no number there is not determined
def tangent(chain: Chain, theta: np.ndarray, u: float = 0.0) -> Rational:
    """B/F from du to dy at the steady state of the constant input u, static slopes included.

    Raises InputError for blocks other than transfer functions, state spaces of one channel and maps, and for an
    integrator followed by a nonlinear map: such a chain has no steady state.
    """
    P = len(theta)
    total = Rational(np.ones(1), np.ones(1), np.zeros((1, P)), np.zeros((1, P)))
    x, J = np.array([float(u)]), np.zeros((1, P))
    for b in chain.blocks:
        part = chain.index(b)
        if isinstance(b, TransferFunction | Process):
            factor = transfer(chain, theta, b)
            total = total.times(factor)
            gain = factor.gain
            if np.isfinite(gain):
                x, J = gain * x, gain * J + x * factor.gain_gradient
            else:  # the level is undefined here; maps with slope one do not need it
                x, J = np.full_like(x, np.nan), np.full_like(J, np.nan)
        elif isinstance(b, StateSpace) and b.channels == (1, 1) and np.all(np.isfinite(x)):
            factor, x, J = _linearise(b, theta, part, x, J)
            total = total.times(factor)
        elif isinstance(b, StaticBlock):
            if not np.all(np.isfinite(x)) and b.n_parameters:
                raise InputError("the chain integrates before a static map, so a constant input has no steady state")
            slope, d_slope = _slope(b, theta, part, x, J) if np.all(np.isfinite(x)) else (1.0, np.zeros(P))
            total = total.times(Rational(np.array([slope]), np.ones(1), d_slope[None, :], np.zeros((1, P))))
            x, J = _map_output(b, theta, part, x, J) if np.all(np.isfinite(x)) else (x, J)
        else:
            raise InputError(
                f"block {b.role!r} is neither a transfer function nor a static map; it has no tangent here"
            )
    return total


def transfer(chain: Chain, theta: np.ndarray, block: TransferFunction | Process) -> Rational:
    """One transfer function of the chain, with gradients in the whole theta."""
    part, P = chain.index(block), len(theta)
    if isinstance(block, Process):
        B, F, own_B, own_F = block.rational(theta[part])
        dB, dF = np.zeros((len(B), P)), np.zeros((len(F), P))
        dB[:, part], dF[:, part] = own_B, own_F
        return Rational(B, F, dB, dF)
    B, F = block.padded(theta[part])
    dB, dF = np.zeros((len(B), P)), np.zeros((len(F), P))
    for i in range(block.nb):
        dB[block.nk + i, part.start + i] = 1.0
    for j in range(block.nf):
        dF[j + 1, part.start + block.nb + j] = 1.0
    return Rational(B, F, dB, dF)


def estimator(chain: Chain, theta: np.ndarray, block: Innovations) -> tuple[np.ndarray, np.ndarray]:
    """C (nf + 1,) of a block that predicts, from its leading 1, and its gradient (nf + 1, P)."""
    start = chain.index(block).stop - block.nf
    C, dC = np.ones(block.nf + 1), np.zeros((block.nf + 1, len(theta)))
    C[1:] = theta[start : start + block.nf]
    dC[1:, start : start + block.nf] = np.eye(block.nf)
    return C, dC


def _linearise(
    block: StateSpace, theta: np.ndarray, part: slice, x: np.ndarray, J: np.ndarray
) -> tuple[Rational, np.ndarray, np.ndarray]:
    """B/F of a state space around the steady state of x (1,), its output (1,) and that one's gradient (1, P)."""
    n = block.nx + 1

    def polynomials(values: np.ndarray, level: float) -> np.ndarray:
        A, B, C, D, y = block.linearised(values, np.array([level]))
        F = np.real(np.poly(A))
        return np.concatenate([np.real(np.poly(A - B @ C)) + (D[0, 0] - 1.0) * F, F, y])  # the matrix determinant lemma

    values, level = theta[part], float(x[0])
    value, gradient = polynomials(values, level), np.zeros((2 * n + 1, len(theta)))
    for i in range(len(values)):
        h = _STEP * max(1.0, abs(values[i]))
        e = h * np.eye(len(values))[i]
        gradient[:, part.start + i] = (polynomials(values + e, level) - polynomials(values - e, level)) / (2.0 * h)
    if np.any(J):
        h = _STEP * max(1.0, abs(level))
        gradient += np.outer((polynomials(values, level + h) - polynomials(values, level - h)) / (2.0 * h), J[0])
    rational = Rational(value[:n], value[n : 2 * n], gradient[:n], gradient[n : 2 * n])
    return rational, value[2 * n :], gradient[2 * n :]


def steady_curve(chain: Chain, theta: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steady-state output (n,) for constant inputs u (n,), and its gradient (n, P)."""
    x, J = np.ascontiguousarray(u, dtype=float), np.zeros((len(u), len(theta)))
    for b in chain.blocks:
        if isinstance(b, TransferFunction | Process):
            factor = transfer(chain, theta, b)
            if not np.isfinite(factor.gain):
                raise InputError("the chain integrates, so a constant input has no steady state")
            x, J = factor.gain * x, factor.gain * J + x[:, None] * factor.gain_gradient
        elif isinstance(b, StateSpace) and b.channels == (1, 1):
            levels = [_linearise(b, theta, chain.index(b), x[i : i + 1], J[i : i + 1])[1:] for i in range(len(x))]
            x, J = np.concatenate([y for y, _ in levels]), np.concatenate([G for _, G in levels])
        elif isinstance(b, StaticBlock):
            x, J = _map_output(b, theta, chain.index(b), x, J)
        else:
            raise InputError(
                f"block {b.role!r} is neither a transfer function nor a static map; it has no steady state"
            )
    return x, J


def _map_output(
    block: StaticBlock, theta: np.ndarray, part: slice, x: np.ndarray, J: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Output (n,) of a map and its gradient (n, P), for an input x (n,) with gradient J (n, P)."""
    P, p = len(theta), block.n_parameters
    wide = np.zeros((len(x), P + p))
    wide[:, :P] = J
    y = block.propagate(theta[part], np.ascontiguousarray(x), wide, P)
    gradient = wide[:, :P].copy()
    gradient[:, part] += wide[:, P:]
    return y, gradient


def _slope(
    block: StaticBlock, theta: np.ndarray, part: slice, x: np.ndarray, J: np.ndarray
) -> tuple[float, np.ndarray]:
    """Slope of a map at x (1,) and its gradient (P,), x itself moving by J (1, P)."""
    probe = np.ones((1, 1 + block.n_parameters))
    block.propagate(theta[part], x.copy(), probe, 1)
    h = _STEP * max(1.0, abs(float(x[0])))
    _, up = _map_output(block, theta, part, x + h, J)
    _, down = _map_output(block, theta, part, x - h, J)
    return float(probe[0, 0]), (up - down)[0] / (2.0 * h)


def _product(a: np.ndarray, da: np.ndarray, b: np.ndarray, db: np.ndarray) -> np.ndarray:
    """Gradient (n, P) of the product of two polynomials."""
    out = np.zeros((len(a) + len(b) - 1, da.shape[1]))
    for i, v in enumerate(a):
        out[i : i + len(b)] += v * db
    for j, v in enumerate(b):
        out[j : j + len(a)] += v * da
    return out
