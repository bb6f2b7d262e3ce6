"""Bands on simulated outputs: by linear propagation of the covariance, and by Monte Carlo.

Both give the uncertainty of the model's output that comes from its parameters. With noise=True they include the
measurement noise, so they cover a new measurement.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.base.rates import same_rate
from sysid.data.record import IOData, siso
from sysid.data.trends import restore_offsets, with_offsets
from sysid.estimation.free_run import at_rest
from sysid.estimation.initial_state import estimate_initial, filters_only
from sysid.model.chain import Chain
from sysid.uncertainty.information import Information

Follow = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class OutputBand:
    """Free run y (N,) at times t (N,) [s] with its pointwise standard deviation and interval (N,).

    `draws` models were drawn; `dropped` of them were unstable or invalid and not used. Both are 0 for linear
    propagation. `note` is empty or a warning.
    """

    t: np.ndarray
    y: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    level: float
    unit: str = ""
    draws: int = 0
    dropped: int = 0
    note: str = ""


@checked
def linear(
    info: Information,
    record: IOData | np.ndarray | None = None,
    level: float = 0.95,
    noise: bool = False,
    n_init: int | None = None,
) -> OutputBand:
    """Band of the free run by its exact Jacobian; without a record, over the first experiment of the estimation data.

    The first n_init outputs of another record give the initial state, and its uncertainty is included; the band is at
    the level of that record. An input alone (N,) starts from rest, as in `Fit.simulate`.
    """
    record, level_of = _levels(info, record)
    with one_blas_thread():
        chain, theta, u, T, S = _sensitivity(info, record, n_init)
        y = level_of(chain.simulate(theta, u))
        variance = info.std_of(T) ** 2 + info.noise_variance * np.sum(S**2, axis=1)
        note = info.note_of(T)
    std = np.sqrt(variance + noise * info.noise_variance)
    half = np.where(np.isnan(std), np.inf, info.quantile(level) * std)
    return OutputBand(np.arange(len(u)) * info.Ts, y, std, y - half, y + half, level, info.data.y_unit, note=note)


@checked
def monte_carlo(
    info: Information,
    record: IOData | np.ndarray | None = None,
    level: float = 0.95,
    noise: bool = False,
    n_init: int | None = None,
    draws: int = 500,
    seed: int = 0,
) -> OutputBand:
    """The same from `draws` models drawn from the covariance along identifiable directions; needs no linearity.

    Memory grows with draws x N. The initial state of another record follows each draw to first order. A draw beyond a
    bound lies on it.
    """
    if draws < 20:
        raise InputError(f"draws is {draws}; give at least 20, or several hundred for a smooth band")
    rng = np.random.default_rng(seed)
    record, level_of = _levels(info, record)
    with one_blas_thread():
        chain, theta, u, T, S = _sensitivity(info, record, n_init)
        follow = _follow(info, theta, record, S)
        outputs = []
        for _ in range(draws):
            spread = 1.0 if not np.isfinite(info.dof) else np.sqrt(info.dof / rng.chisquare(info.dof))
            step = spread * (info.factor @ rng.standard_normal(info.factor.shape[1]))
            e = np.sqrt(info.noise_variance) * rng.standard_normal(S.shape[1])
            drawn = follow(np.clip(theta + step, *info.chain.limits) - theta, e)
            y = chain.simulate(drawn, u) if chain.admissible(drawn) else np.full(len(u), np.nan)
            if np.all(np.isfinite(y)):
                outputs.append(y + noise * np.sqrt(info.noise_variance) * rng.standard_normal(len(u)))
        note = info.note_of(T)
    dropped = draws - len(outputs)
    if len(outputs) < 20:
        raise InputError(
            f"{dropped} of {draws} drawn models are unstable or invalid; the fit is too uncertain for a band"
        )
    if dropped > 0.05 * draws:
        note = (
            note + "; " if note else ""
        ) + f"{dropped} of {draws} drawn models were unstable or invalid and left out: the band is too narrow"
    Y, tail = np.array(outputs), 50.0 * (1.0 - level)
    lower, upper = (level_of(edge) for edge in np.percentile(Y, [tail, 100.0 - tail], axis=0))
    is_undetermined = np.isnan(info.std_of(T))
    lower, upper, std = (
        np.where(is_undetermined, -np.inf, lower),
        np.where(is_undetermined, np.inf, upper),
        Y.std(axis=0, ddof=1),
    )
    y, t = level_of(chain.simulate(theta, u)), np.arange(len(u)) * info.Ts
    unit = info.data.y_unit
    return OutputBand(t, y, np.where(is_undetermined, np.nan, std), lower, upper, level, unit, draws, dropped, note)


def _levels(
    info: Information, record: IOData | np.ndarray | None
) -> tuple[IOData | np.ndarray | None, Callable[[np.ndarray], np.ndarray]]:
    """The record counted from the offsets of the estimation data, and a function that brings outputs (N,) back."""
    if not isinstance(record, IOData):
        return record, lambda y: y
    original, levelled = record, with_offsets(record, info.data.u_offset, info.data.y_offset)
    return levelled, lambda y: restore_offsets(y, levelled, original)


def _sensitivity(
    info: Information, record: IOData | np.ndarray | None, n_init: int | None
) -> tuple[Chain, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The run's chain, theta (P,) with its initial state, u (N,), dy/dtheta (N, P), and dy/de (N, n) of its outputs."""
    chain, initial = info.chain, info.chain.initial
    if record is None:
        u = info.data.experiments[0].u[:, 0]
        return chain, info.theta, u, chain.tangent(info.theta, u)[1], np.zeros((len(u), 0))
    if isinstance(record, IOData):
        u, _ = siso(record)
        if len(record.experiments) > 1:
            raise InputError(f"the record has {len(record.experiments)} experiments; give one of record.experiments")
        if not same_rate(record.Ts, info.Ts):
            raise InputError(f"the record is sampled every {record.Ts} s and the fit every {info.Ts} s; resample it")
        n = min(info.n_init if n_init is None else n_init, record.N)
        theta = estimate_initial(chain, info.theta, record.select(0, n))
        J = chain.tangent(theta, u)[1]
        if not initial.any():
            return chain, theta, u, J, np.zeros((len(u), 0))
        return chain, theta, u, *initial_state_sensitivity(J, initial, n)
    u = np.ascontiguousarray(record, dtype=float).ravel()
    chain, theta = at_rest(chain, info.theta)
    J = chain.tangent(theta, u)[1]
    J[:, initial] = 0.0
    return chain, theta, u, J, np.zeros((len(u), 0))


def _follow(info: Information, theta: np.ndarray, record: IOData | np.ndarray | None, S: np.ndarray) -> Follow:
    """A function (step, e) -> drawn theta; its initial state follows the step as a fitted one does.

    States of filters are linear in it; others, as the place of a joint within its backlash, are fitted again.
    """
    chain, initial, n = info.chain, info.chain.initial, S.shape[1]
    same = theta is info.theta
    if n == 0 or not isinstance(record, IOData):
        return lambda step, e: theta + (step if same else np.where(initial, 0.0, step))
    beginning = record.select(0, n)
    if not filters_only(chain):

        def fitted(step: np.ndarray, e: np.ndarray) -> np.ndarray:
            drawn = theta + np.where(initial, 0.0, step)
            return estimate_initial(chain, drawn, replace(beginning, y=beginning.y + e[:, None]))

        return fitted
    X = chain.tangent(theta, beginning.u[:, 0])[1]
    inverse = np.linalg.pinv(X[:, initial], rcond=1e-9)

    def drawn(step: np.ndarray, e: np.ndarray) -> np.ndarray:
        step = np.where(initial, 0.0, step)
        step[initial] = inverse @ (e - X @ step)
        return theta + step

    return drawn


def initial_state_sensitivity(J: np.ndarray, initial: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Error propagation of a fitted initial state: T (N, P) = dyhat/dtheta and S (N, n) = dyhat/de of the first n.

    J (N, P) is the free run's Jacobian with the initial states as separate parameters; `initial` (P,) marks them.
    They solve least squares over the first n samples: to first order dx0 = X+ (e - J dtheta) with X = J[:n, initial].
    """
    X = J[:n, initial]
    inverse = np.linalg.pinv(X / _column_norms(X), rcond=1e-9) / _column_norms(X)[:, None]
    T = J - J[:, initial] @ (inverse @ J[:n])
    T[:, initial] = 0.0
    return T, J[:, initial] @ inverse


def _column_norms(X: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(X, axis=0)
    return np.where(norm > 0, norm, 1.0)
