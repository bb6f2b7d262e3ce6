"""Information of a record on the quantities of a fit: standard deviations, or a reason why there is none.

A quantity g(theta) has the variance g' cov g (delta method). Two kinds of directions have no variance and are not
certain either: the gauge (a gain may move between blocks) and directions that the record does not excite. `Information`
stores both separately, so that a quantity that depends on one of them gets a reason and no interval. So does one at a
bound: it cannot move, but the record does not say that it is there exactly.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import null_space
from scipy.special import stdtrit

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.base.rates import same_rate
from sysid.blocks._shape import is_named
from sysid.data.record import IOData, siso
from sysid.estimation.finer_maps import held_scales, slope_changes
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.noise_model import NoiseModel, long_run_covariance_root, noise_model
from sysid.estimation.prior import Prior
from sysid.model.chain import Chain
from sysid.solver.covariance import cancels

if TYPE_CHECKING:
    from sysid.estimation.result import Fit

GAUGE = "depends on how gain and offset are shared between the blocks, which no record determines"
UNEXCITED = "the record does not excite it"
BOUND = "is held at the bound of its range: the record alone would put it beyond, so it has no interval"
TESTED = "tested"
_BEYOND = 1.0  # deviation of a map's slope beyond the range of its signal, by its mean slope: see docs/intervals.md
_FIRMEST = 1e5  # norm of a sample of the prior; columns of J have unit norm
_EMPTY = 1e-7  # singular values below this share of the largest are zero; columns of J have unit norm
_LEAK = 1e-5  # share of a gradient along an empty direction that makes a quantity undetermined


@dataclass(frozen=True)
class Information:
    """The covariance of theta (P,) from a record: cov = factor factor' over the identifiable directions.

    `gauge` (P, g) and `unexcited` (P, k) are the directions without information, `bound` (P, h) those that a bound
    holds; `weights` (P, n) scales a gradient so that the columns of the Jacobian have unit norm. `lags` is the
    bandwidth of a covariance that is robust to coloured residuals, None for white residuals. `data` is the record that
    maps refer to. `own` (P,) marks the parameters that the fit has too: finer maps have a place more on each side here.
    """

    chain: Chain
    theta: np.ndarray
    data: IOData
    factor: np.ndarray
    gauge: np.ndarray
    unexcited: np.ndarray
    bound: np.ndarray
    weights: np.ndarray
    noise_variance: float
    dof: float
    lags: int | None
    n_init: int
    own: np.ndarray

    @property
    def Ts(self) -> float:
        """Sampling time [s]."""
        return self.data.Ts

    @cached_property
    def cov(self) -> np.ndarray:
        """Covariance (P, P) in the gauge with the smallest norm."""
        return self.factor @ self.factor.T

    def quantile(self, level: float) -> float:
        """Half width of a two-sided interval in standard deviations: Student's t with N - d degrees of freedom."""
        if not 0.0 < level < 1.0:
            raise InputError(f"level is {level}; give a probability between 0 and 1, for example 0.95")
        return float(stdtrit(self.dof, 0.5 + level / 2.0))

    def covariance_of(self, gradient: np.ndarray) -> np.ndarray:
        """Covariance (m, m) of quantities with gradient (m, P)."""
        G = np.atleast_2d(gradient) @ self.factor
        return G @ G.T

    def std_of(self, gradient: np.ndarray) -> np.ndarray:
        """Standard deviation (m,) of quantities with gradient (m, P); nan where the record does not determine them."""
        G = np.atleast_2d(gradient)
        is_undetermined = self._depends_on(G, self.gauge) | self._depends_on(G, self.unexcited) | self._is_at_bound(G)
        return np.where(is_undetermined, np.nan, np.linalg.norm(G @ self.factor, axis=1))

    def std_of_fit(self, gradient: np.ndarray) -> float:
        """The same of one quantity with a gradient over the parameters of the fit."""
        wide = np.zeros(len(self.theta))
        wide[self.own] = gradient
        return float(self.std_of(wide)[0])

    def note_of(self, gradient: np.ndarray) -> str:
        """Why one of the quantities with gradient (m, P) is undetermined; '' if all are determined."""
        G = np.atleast_2d(gradient)
        if np.any(self._depends_on(G, self.gauge)):
            return GAUGE
        if np.any(self._depends_on(G, self.unexcited)):
            return UNEXCITED
        return BOUND if np.any(self._is_at_bound(G)) else ""

    def _is_at_bound(self, G: np.ndarray) -> np.ndarray:
        """True (m,) where a quantity with this gradient moves along what a bound holds, and along nothing else."""
        if not self.bound.shape[1]:
            return np.zeros(len(G), dtype=bool)
        spread = np.linalg.norm(self.factor, axis=1)
        return np.any(G @ self.bound != 0.0, axis=1) & cancels(G, np.linalg.norm(G @ self.factor, axis=1), spread)

    def _depends_on(self, G: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """True (m,) where a gradient has a share along `directions` (P, k).

        The share is relative to the largest of the m gradients: near a value that is known exactly, a gradient is only
        rounding error.
        """
        if not directions.shape[1]:
            return np.zeros(len(G), dtype=bool)
        size = float(np.linalg.norm(G @ self.weights, axis=1).max(initial=0.0))
        return np.linalg.norm(G @ directions, axis=1) > _LEAK * (size or np.inf)


@checked
def information(fit: "Fit", data: IOData, lags: int | str | None = TESTED) -> Information:
    """The information that `data`, the estimation data of `fit`, has on the quantities of the fit.

    lags: None for white residuals, sigma^2 (J'J)^-1; a number for the Newey-West sandwich with a Bartlett window over
    that many lags; 'auto' for residuals whitened by an autoregression and a bandwidth estimated from what is left.
    'tested' is 'auto' if `fit.residual_tests` rejects whiteness, because the plain intervals are then too narrow, and
    None otherwise. Merged experiments count together.
    """
    if not same_rate(data.Ts, fit.Ts):
        raise InputError(f"the record is sampled every {data.Ts} s and the fit every {fit.Ts} s; give the fit's record")
    if lags == TESTED:
        lags = "auto" if _coloured(fit, data) else None
    record = fit.own_level(data)
    return information_at(fit.model, fit.theta, record, lags, fit.n_init, smoothing=fit.smoothing, prior=fit.prior)


def _coloured(fit: "Fit", data: IOData) -> bool:
    """Whether the residuals are not white; False for a record that is too short for the test."""
    try:
        return not fit.residual_tests(data).white
    except InputError:
        return False


def information_at(
    chain: Chain,
    theta: np.ndarray,
    data: IOData,
    lags: int | str | None = None,
    n_init: int = 50,
    noise_variance: float | None = None,
    noise: NoiseModel | None = None,
    smoothing: np.ndarray | None = None,
    prior: Prior | None = None,
) -> Information:
    """The same for any parameters theta (P,); with the true ones and `noise_variance`, the Cramer-Rao bound.

    A known `noise` instead gives the covariance of least squares under its colour. With the `smoothing` (k,) of a fit's
    finer maps, or its `prior`, it is that of the posterior: the prior is a sample for each change of slope or row.
    Beyond the range that the record has shown, the slope of finer maps and of named shapes is uncertain.
    The initial state in theta belongs to the record's first experiment; those of further experiments are fitted.
    """
    siso(data)
    own, named = np.ones(len(theta), dtype=bool), any(map(is_named, chain.blocks))
    smoothing = np.empty(0) if named and smoothing is None else smoothing
    if smoothing is not None:
        chain, theta, beyond, own = _wider(chain, theta)
    with one_blas_thread():
        e, J, mask, initial_count = _stack_experiments(chain, theta, data)
        free = chain.basis[:, chain.free]
        gradient = (J @ free).T @ e
        if prior is not None:
            gradient += prior.jacobian(free).T @ prior.errors(theta)
        at_bound = _bound_mask(chain, theta, gradient)
        basis, redundant = free[:, ~at_bound], _gauge(chain, theta, free, at_bound)
        Jp, rows = J @ basis, np.empty((0, basis.shape[1]))
        moving = np.ones(basis.shape[1], dtype=bool)
        colour = noise_model(e, Jp, data.lengths) if noise is None and lags == "auto" else noise
        level = float(e @ e) / len(e)  # of the noise in the scores of the maps
        if smoothing is not None:
            maps = J[:, np.any(slope_changes(chain), axis=0)]
            if colour is not None and np.any(maps):  # of named shapes alone the record shows no change of slope
                level = colour.level(maps, data.lengths)
            firm = np.divide(np.sqrt(level), beyond, out=np.zeros_like(beyond), where=beyond > 0.0)
            rows = _prior_rows(chain, smoothing, firm) @ basis
            moving = ~held_scales(chain, theta)[chain.free][~at_bound]
        elif prior is not None:
            level = level if colour is None else colour.level(Jp, data.lengths)
            rows = prior.jacobian(basis)
        scale = _unit(Jp)
        rows = _limited(rows / scale)
        R = np.asarray(np.linalg.qr(Jp / scale, mode="r"))
        _, s, Vt = np.linalg.svd(np.vstack([R, rows])[:, moving])
        keep = s > _EMPTY * (np.linalg.norm(R, 2) if R.size else 1.0)
        directions = np.zeros((len(moving), len(Vt)))
        directions[moving] = Vt.T
        redundant = np.linalg.qr(redundant * scale[:, None])[0]
        weights, V = basis / scale, directions[:, : len(s)][:, keep] / s[keep]
        seen = (Jp / scale) @ V
        dof = float(mask.sum()) - float(np.sum(seen**2)) - initial_count  # without a prior its columns have norm 1
        sigma2 = float(e @ e) / max(dof, 1.0) if noise_variance is None else float(noise_variance)
        root, bandwidth = np.sqrt(sigma2) * np.eye(V.shape[1]), None
        if noise is not None:
            root = _with_prior(noise.root(seen, data.lengths), rows @ V, level)
        elif lags is not None:
            root, bandwidth = long_run_covariance_root(e, seen, data.lengths, lags, colour)
            root = _with_prior(np.sqrt(mask.sum() / max(dof, 1.0)) * root, rows @ V, level)
        factor = weights @ V @ root
        null = np.delete(directions, np.flatnonzero(keep), axis=1)
        null_directions, sv, _ = np.linalg.svd(null - redundant @ (redundant.T @ null), full_matrices=False)
    return Information(
        chain=chain,
        theta=theta,
        data=data,
        factor=factor,
        gauge=weights @ redundant,
        unexcited=weights @ null_directions[:, sv > 1e-2],
        bound=free[:, at_bound],
        weights=weights,
        noise_variance=sigma2,
        dof=max(dof, 1.0) if noise_variance is None and noise is None else np.inf,
        lags=bandwidth,
        n_init=n_init,
        own=own,
    )


def _wider(chain: Chain, theta: np.ndarray) -> tuple[Chain, np.ndarray, np.ndarray, np.ndarray]:
    """The chain with places beyond the range of finer maps and shapes, theta there, a deviation (m,) by end, and `own`.

    The record does not show a map's slope beyond its range. It has a normal distribution around the last slope inside.
    A deviation is 0 for a map that is flat everywhere: nothing is known of its slope beyond.
    """
    blocks, parts, beyond, own = [], [], list[float](), []
    for block in chain.blocks:
        part = chain.part(theta, block)
        change = block.wider(part) if chain.free[chain.index(block)].all() else None
        blocks.append(block if change is None else change[0])
        parts.append(part if change is None else change[1])
        beyond += [] if change is None else 2 * [_BEYOND * change[2]]
        own.append(np.pad(np.ones(len(part), dtype=bool), 0 if change is None else 1))
    return replace(chain, blocks=tuple(blocks)), np.concatenate(parts), np.array(beyond), np.concatenate(own)


def _prior_rows(chain: Chain, smoothing: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The samples (k, P) of the prior of all changes of slope; weights inside (k - m,) and at the ends (m,)."""
    weights, k = list[np.ndarray](), 0
    for i, block in enumerate(b for b in chain.blocks if len(b.slope_changes())):
        n = len(block.slope_changes()) - 2
        weights.append(np.concatenate([ends[2 * i : 2 * i + 1], smoothing[k : k + n], ends[2 * i + 1 : 2 * i + 2]]))
        k += n
    return np.concatenate(weights)[:, None] * slope_changes(chain)


def _limited(prior: np.ndarray) -> np.ndarray:
    """Samples (k, n) of a prior, none above `_FIRMEST`: firmer ones leave rounding of the others."""
    size = np.linalg.norm(prior, axis=1, keepdims=True)
    return np.asarray(prior * (np.minimum(size, _FIRMEST) / np.where(size > 0.0, size, 1.0)))


def _with_prior(root: np.ndarray, prior: np.ndarray, noise_variance: float) -> np.ndarray:
    """A root (m, r) of the covariance of scores, with that of the samples (k, m) of a prior."""
    return np.hstack([root, np.sqrt(noise_variance) * prior.T])


def _stack_experiments(chain: Chain, theta: np.ndarray, data: IOData) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """e (N,), J (N, P) of all experiments, which samples count (N,), and the number of further initial states.

    Missing samples are zero rows. The part that a further experiment's own initial state explains is projected out of
    its rows, which leaves exactly the information on the common parameters (Frisch and Waugh 1933).
    """
    errors, rows, masks, initial_count = [], [], [], 0
    for k, record in enumerate(data.experiments):
        observed = record.observed[:, 0]
        own_theta = theta if k == 0 else estimate_initial(chain, theta, record)
        yhat, J = chain.tangent(own_theta, record.u[:, 0], record.y)
        e, J = (record.y[:, 0] - yhat) * observed, J * observed[:, None]
        if k and chain.initial.any():
            Q = np.linalg.qr(J[:, chain.initial])[0]
            e, J = e - Q @ (Q.T @ e), J - Q @ (Q.T @ J)
            J[:, chain.initial], initial_count = 0.0, initial_count + Q.shape[1]
        errors.append(e)
        rows.append(J)
        masks.append(observed)
    return np.concatenate(errors), np.concatenate(rows), np.concatenate(masks), initial_count


def _bound_mask(chain: Chain, theta: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """True (n,) for free directions at a bound beyond which the descent `gradient` (n,) points."""
    low, high = chain.at_limit(theta)
    return (low[chain.free] & (gradient < 0)) | (high[chain.free] & (gradient > 0))


def _gauge(chain: Chain, theta: np.ndarray, free: np.ndarray, at_bound: np.ndarray) -> np.ndarray:
    """The gauge in coordinates of the free directions that are not held (n, g)."""
    G = np.linalg.lstsq(free, chain.gauge(theta), rcond=None)[0]
    if at_bound.any() and G.shape[1]:
        G = G @ null_space(G[at_bound])  # a held direction fixes the gauge that would move it
    return G[~at_bound]


def _unit(J: np.ndarray) -> np.ndarray:
    """Norms of the columns of J; an empty column gets a tiny one, so that dependence on it shows."""
    norm = np.linalg.norm(J, axis=0)
    filled = norm > 1e-30 * norm.max(initial=0.0)
    typical = float(np.median(norm[filled])) if filled.any() else 1.0
    return np.where(filled, norm, 1e-3 * typical)
