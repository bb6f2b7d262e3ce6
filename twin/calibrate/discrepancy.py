"""What a simulation lacks, as random functions of its own response: a departure that repeats with place and direction.

A residual of a missing effect is not noise: it comes back whenever the joint passes the same place in the same
direction, so it does not average out over a long record, and part of it has moved the estimate. It is modelled as a
random function with a Gaussian prior (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001), whose size is estimated
from the residual by restricted maximum likelihood (Patterson and Thompson, Biometrika 58, 1971): restricted to what
the parameters could not absorb.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

# Names of the groups, in order.
GROUPS = ("place", "place and direction", "time", "speed")
WIDTHS = (0.06, 0.12, 0.25)  # of the range of the response: lengths over which a departure may change
STILL = 0.02  # of the fastest speed: below it the response is at rest
AT_END = 0.01  # of the range from its ends: there a stop holds the joint, if it rests


@dataclass(frozen=True)
class Sizes:
    """Standard deviations of white noise and of each group of departures, their restricted log likelihood, and the
    length over which the departures change [range of the response]."""

    noise: float
    groups: tuple[float, ...]
    likelihood: float = 0.0
    width: float = 0.0


def bumps(place: np.ndarray, low: float, high: float, width: float) -> np.ndarray:
    """Smooth functions of `place` (N,) as columns (N, bumps), whose squares sum to 1 everywhere.

    Independent standard normal weights on the columns give a function of variance 1 with covariance
    exp(-d^2 / (2 width^2)) over a distance d in ranges.
    """
    x = (place - low) / (high - low)
    centres = np.linspace(0.0, 1.0, int(np.ceil(1.5 / width)) + 1)
    shape = np.exp(-(((x[:, None] - centres) / width) ** 2))
    return shape / np.sqrt(np.sum(shape**2, axis=1, keepdims=True))


def directions(y: np.ndarray, Ts: float) -> tuple[np.ndarray, np.ndarray]:
    """Direction (N,) of the last motion of y (N,), -1 or 1, and whether it moves."""
    speed = np.gradient(y, Ts)
    moves = np.abs(speed) > STILL * np.abs(speed).max(initial=1e-12)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(y)), 0))
    way = np.sign(speed[last])
    return np.where(way == 0.0, 1.0, way), moves


@dataclass(frozen=True)
class Frame:
    """Range and fastest speed of the responses over which departures are functions."""

    low: float
    high: float
    fastest: float

    @classmethod
    def of(cls, responses: Sequence[np.ndarray], Ts: Sequence[float]) -> "Frame":
        """The frame of these responses (N,)."""
        fastest = max(float(np.abs(np.gradient(y, step)).max()) for y, step in zip(responses, Ts, strict=True))
        return cls(float(min(map(np.min, responses))), float(max(map(np.max, responses))), fastest)


def repeating(responses: Sequence[np.ndarray], Ts: Sequence[float], width: float, frame: Frame) -> list[np.ndarray]:
    """Departures that depend on place, on place and direction, and in time (of a moving joint) on both: three groups.

    Each group is (N, columns) over all records. Weights of the third are in seconds.
    """
    low, high = frame.low, frame.high
    groups: tuple[list, list, list] = ([], [], [])
    for y, step in zip(responses, Ts, strict=True):
        shape, (way, moves) = bumps(y, low, high, width), directions(y, step)
        rates = shape * (np.gradient(y, step) * moves)[:, None]
        for group, columns in zip(
            groups, (shape, shape * way[:, None], np.hstack([rates, rates * way[:, None]])), strict=True
        ):
            group.append(columns)
    return [np.vstack(group) for group in groups]


def drifting(responses: Sequence[np.ndarray], Ts: Sequence[float], width: float, frame: Frame) -> list[np.ndarray]:
    """Departures of speed by place and direction, and by speed and direction, summed up since the last end stop.

    Their weights are in the unit of the response per second.
    """
    low, high, fastest = frame.low, frame.high, frame.fastest
    out = []
    for y, step in zip(responses, Ts, strict=True):
        speed, (way, moves) = np.gradient(y, step), directions(y, step)
        direction = moves * way
        # up and down apart: the sum and the difference of the two
        rate = np.hstack([bumps(y, low, high, width), bumps(np.abs(speed), 0.0, fastest, 0.25)]) * moves[:, None]
        rate = np.hstack([rate, rate * direction[:, None]]) / np.sqrt(2.0)
        end = ~moves & ((y < low + AT_END * (high - low)) | (y > high - AT_END * (high - low)))
        out.append(_sum_since_reset(rate * step, end))
    return [np.vstack(out)]


def departures(responses: Sequence[np.ndarray], Ts: Sequence[float], width: float, frame: Frame) -> list[np.ndarray]:
    """All groups, in the order of `GROUPS`, each (N, columns) over all records."""
    return [*repeating(responses, Ts, width, frame), *drifting(responses, Ts, width, frame)]


def _sum_since_reset(change: np.ndarray, reset: np.ndarray) -> np.ndarray:
    """Running sums of change (N, columns) that begin anew wherever `reset` (N,)."""
    total = np.cumsum(change, axis=0)
    last = np.maximum.accumulate(np.where(reset, np.arange(len(reset)), -1))
    offset = np.where(last[:, None] >= 0, total[np.maximum(last, 0)], 0.0)
    return total - offset


def sizes(e: np.ndarray, J: np.ndarray, groups: Sequence[np.ndarray]) -> Sizes:
    """Sizes of noise and departures from residuals e (N,) at the optimum, with Jacobian J (N, n).

    e = (I - J J+) (sum of Phi_g a_g + noise) with a_g ~ N(0, s_g^2), noise ~ N(0, s^2): the restricted likelihood of e.
    """
    Q = np.linalg.qr(J)[0]
    residual = e - Q @ (Q.T @ e)
    Phi = np.hstack(groups)
    Phi = Phi - Q @ (Q.T @ Phi)
    owner = np.repeat(np.arange(len(groups)), [g.shape[1] for g in groups])
    # In the span of Phi the problem is small: R = the triangular factor, z the residual's part, rest the other part.
    basis, R = np.linalg.qr(Phi)
    z = basis.T @ residual
    rest, n_left = float(residual @ residual - z @ z), len(e) - J.shape[1] - R.shape[0]

    n_groups, member = len(groups), np.eye(len(groups))[owner]

    def cost(logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus twice the log likelihood and its gradient, by logarithms of the sizes."""
        s2, g2 = np.exp(2.0 * logs[0]), np.exp(2.0 * logs[1:])
        L = np.linalg.cholesky((R * g2[owner]) @ R.T + s2 * np.eye(len(z)))
        inverse = solve_triangular(L, np.eye(len(z)), lower=True)
        v, W = inverse.T @ (inverse @ z), inverse @ R
        value = 2.0 * np.sum(np.log(np.diag(L))) + z @ v + rest / s2 + 2.0 * n_left * logs[0]
        slopes = np.empty(n_groups + 1)
        slopes[0] = 2.0 * s2 * (np.sum(inverse**2) - v @ v) - 2.0 * rest / s2 + 2.0 * n_left
        slopes[1:] = 2.0 * g2 * ((np.sum(W**2, axis=0) - (R.T @ v) ** 2) @ member)
        return float(value) / len(e), slopes / len(e)

    white = np.sqrt(max(rest, 1e-12 * float(residual @ residual), 1e-100) / max(n_left, 1))
    # A group that is as good as zero gets a size that is a number.
    rms = [max(float(np.sqrt(np.mean(g**2) * g.shape[1])), 1e-6 * white) for g in groups]
    first = np.log([white, *(0.3 * white / size for size in rms)])
    limits = [(a - 10.0, a + 6.0) for a in first]
    best = minimize(cost, first, jac=True, method="L-BFGS-B", bounds=limits)
    estimates = np.exp(best.x)
    return Sizes(float(estimates[0]), tuple(float(v) for v in estimates[1:]), -0.5 * float(best.fun) * len(e))


def by_size(groups: Sequence[np.ndarray], size: Sizes) -> np.ndarray:
    """All departures side by side (N, k), each times the standard deviation of its weights."""
    return np.hstack([s * Phi for s, Phi in zip(size.groups, groups, strict=True)])


def estimate(
    e: np.ndarray,
    J: np.ndarray,
    responses: Sequence[np.ndarray],
    Ts: Sequence[float],
    scored_samples: np.ndarray,
    more: Sequence[np.ndarray] = (),
) -> tuple[list[np.ndarray], Sizes]:
    """Departures at the scored samples, and their sizes, at the width with the largest restricted likelihood.

    `more` are further groups (N, columns) beside them.
    """
    candidates, frame = [], Frame.of(responses, Ts)
    for width in WIDTHS:
        groups = [*(g[scored_samples] for g in departures(responses, Ts, width, frame)), *more]
        candidates.append((groups, replace(sizes(e, J, groups), width=width)))
    return max(candidates, key=lambda candidate: candidate[1].likelihood)


def covariance(J: np.ndarray, groups: Sequence[np.ndarray], size: Sizes) -> np.ndarray:
    """Covariance (n, n) of the least-squares estimate: G (s^2 I + sum of s_g^2 Phi_g Phi_g') G' with G = J+."""
    G = np.linalg.pinv(J)
    total = size.noise**2 * (G @ G.T)
    for s, Phi in zip(size.groups, groups, strict=True):
        projection = G @ Phi
        total += s**2 * (projection @ projection.T)
    return total
