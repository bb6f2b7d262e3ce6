"""Whether a record speaks for the parts of a joint at all: the odds of the joint with them against the plain one.

Each part that a record leaves open may be a little off, and on another input many such parts add up. The odds are those
of Bayes: what the parts gain in the height of the posterior, times the volume that the record leaves of what was usual
(Laplace's approximation; MacKay, Neural Computation 4, 1992). With even odds before the record, the likelier joint is
taken. A part of which the record says nothing has the same volume before and after, and changes nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.full import linearised
from sysid.joint.parts import words_of


@dataclass(frozen=True)
class _Peak:
    """A posterior at its top: names (n,) of free parameters, minus the logarithm of its height, and the precisions
    (n, n) that the record and the prior give; `target` (n, ) is the prior's precision times its centre."""

    names: list[str]
    fall: float
    record: np.ndarray
    prior: np.ndarray
    target: np.ndarray

    @classmethod
    def of(cls, fit: Fit, data: IOData, level: float) -> "_Peak":
        chain, prior = fit.model, fit.prior
        assert prior is not None
        e, J = linearised(fit, data)
        free = np.flatnonzero(chain.free)
        J, W = J[:, : len(free)] / level, prior.weight[:, None] * prior.rows[:, free] / level
        fall = 0.5 * (float(e @ e) + float(np.sum(prior.errors(fit.theta) ** 2))) / level**2
        names = [chain.names[k] for k in free]
        return cls(names, fall, J.T @ J, W.T @ W, W.T @ (prior.weight * prior.target / level))

    def known(self, by: np.ndarray) -> set[str]:
        """The parameters of which a precision says something."""
        return {name for name, size in zip(self.names, np.diag(by), strict=True) if size > 0.0}

    def block(self, matrix: np.ndarray, names: list[str]) -> np.ndarray:
        """The rows and columns of these parameters."""
        rows = [self.names.index(name) for name in names]
        return matrix[np.ix_(rows, rows)]


def log_odds_of_parts(full: Fit, plain: Fit, data: IOData, level: float) -> float:
    """Logarithm of the odds of `full` against `plain`, both fitted to `data` under the prior of a joint.

    `level` [y] is the deviation of white noise that acts like the residuals. Initial states and what gives a part its
    shape are left as they are: where the part is small, the posterior of a shape has no top that says how wide it is.
    """
    with_parts, without = _Peak.of(full, data, level), _Peak.of(plain, data, level)
    begins = set(np.array(full.model.names)[full.model.initial])
    both = sorted(with_parts.known(with_parts.record) & without.known(without.record) - begins)
    parts = sorted(with_parts.known(with_parts.prior) & {*words_of(full.model)})
    if not parts:
        return 0.0
    after = with_parts.block(with_parts.record + with_parts.prior, both + parts)
    before = with_parts.block(with_parts.prior, parts)
    alone = without.block(without.record + without.prior, both)
    places = [with_parts.names.index(name) for name in parts]
    usual = np.linalg.solve(before, with_parts.target[places])
    odds = without.fall - with_parts.fall + 0.5 * (_log_det(before) + _log_det(alone) - _log_det(after))
    columns = [full.model.names.index(name) for name in parts]
    found, least = full.theta[columns], full.model.limits[0][columns]
    spreads = _spreads(after)[len(both) :], _spreads(before)
    above = [norm.logcdf((centre - least) / spread) for centre, spread in zip((found, usual), spreads, strict=True)]
    return float(odds + np.sum(above[0] - above[1]))


def log_odds_of_bends(loose: Fit, triangle: Fit, data: IOData, level: float) -> float:
    """Logarithm of the odds of a linkage with many bends against a triangle with few, of joints alike otherwise."""
    heights = []
    for fit in (loose, triangle):
        peak, begins = _Peak.of(fit, data, level), set(np.array(fit.model.names)[fit.model.initial])
        names = sorted(peak.known(peak.record + peak.prior) - begins)
        bends = [name for name in names if name.startswith("map.d")]
        before, after = peak.block(peak.prior, bends), peak.block(peak.record + peak.prior, names)
        heights.append(0.5 * (_log_det(before) - _log_det(after)) - peak.fall)
    return heights[0] - heights[1]


def _log_det(precision: np.ndarray) -> float:
    size, correlations = _by_its_size(precision)
    return float(np.linalg.slogdet(correlations)[1] + 2.0 * np.sum(np.log(size)))


def _spreads(precision: np.ndarray) -> np.ndarray:
    """Deviations (n,) of a normal density of this precision."""
    size, correlations = _by_its_size(precision)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(correlations))) / size)


def _by_its_size(precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The roots (n,) of its diagonal, and the matrix in their units: a joint that runs away has some of 1e19."""
    size = np.sqrt(np.diag(precision))
    return size, precision / np.outer(size, size)
