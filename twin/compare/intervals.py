"""Intervals of what a search found, which allow for residuals that are coloured because the twin is not the leg."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from sysid.estimation.noise_model import long_run_covariance_root
from twin.compare.search import Search, Trials, differences, stiffness

LEVEL = 0.95
_BLIND = 1e-10  # of the largest: a direction in which the record is as good as constant


@dataclass(frozen=True)
class Value:
    """A value with its interval of level `LEVEL`; low and high are None where the record does not determine it."""

    name: str
    value: float
    low: float | None
    high: float | None
    unit: str

    def holds(self, truth: float) -> bool:
        """Whether the interval contains `truth`; False if there is none."""
        return self.low is not None and self.high is not None and self.low <= truth <= self.high


def values(
    trials: Trials, search: Search, y: np.ndarray, doubts: Mapping[str, float] | None = None, level: float = LEVEL
) -> tuple[Value, ...]:
    """What `search` found, by knob.

    Covariance A^-1 B A^-1 with A = J'J and B the long-run covariance of the scores J_t e_t (Newey and West,
    Econometrica 55, 1987), which needs no white residuals. `doubts` are standard uncertainties of knobs that the search
    did not move: a wrong one moves the result by A^-1 J'J_n, which adds to the covariance.
    """
    doubtful = {name: std for name, std in (doubts or {}).items() if name not in search.knobs}
    (J,) = differences(trials, [replace(search, knobs=(*search.knobs, *doubtful), last=None)])
    n_free = 1 + len(search.free)
    scales = [std / trials.knobs[name].typical for name, std in doubtful.items()]
    spread = sandwich(J[:, 1:n_free], y - J[:, 0], J[:, n_free:] * scales, stiffness(trials, search))
    factor = float(norm.ppf(0.5 + level / 2))
    results = []
    for name, std in zip(search.free, spread, strict=True):
        knob = trials.knobs[name]
        value, half = search.state.get(name, knob.nominal), factor * std * knob.typical
        # An interval from bound to bound tells the bounds, not the value.
        known = bool(np.isfinite(half)) and (value - half > knob.lower or value + half < knob.upper)
        low, high = (max(value - half, knob.lower), min(value + half, knob.upper)) if known else (None, None)
        results.append(Value(name, value, low, high, knob.unit))
    return tuple(results)


def sandwich(
    J: np.ndarray, e: np.ndarray, doubts: np.ndarray | None = None, stiff: np.ndarray | None = None
) -> np.ndarray:
    """Standard deviations (P,) from derivatives J (N, P) and residuals e (N,); infinite where undetermined.

    doubts (N, q): changes of the response by one standard uncertainty of what is not among the P. stiff (P,): what
    expected sizes add to J'J (see `stiffness`); they are readings like the others, with errors of their own.
    """
    size = np.linalg.norm(J, axis=0)
    prior = np.zeros(J.shape[1]) if stiff is None else stiff
    active = (size > _BLIND * max(float(size.max()), 1e-300)) | (prior > 0.0)
    out = np.full(J.shape[1], np.inf)
    if not active.any():
        return out
    J, prior = J[:, active], prior[active]
    long = np.linalg.norm(J, axis=0)
    long[long == 0.0] = 1.0
    root = long[:, None] * long_run_covariance_root(e, J / long, [len(e)], "auto")[0]
    full = np.sqrt(np.sum(J**2, axis=0) + prior)
    design = np.vstack([J, np.diag(np.sqrt(prior))]) / full
    _, s, right = np.linalg.svd(design, full_matrices=False)
    kept = s > 1e-6 * s[0]
    inverse = (right[kept].T / s[kept] ** 2) @ right[kept]  # of the scaled J'J + stiff
    # An expected size of n is a reading with variance noise; noise times stiff is what it adds to the scores' variance.
    noise = float(np.mean(e**2))
    parts = [root / full[:, None], np.diag(np.sqrt(noise * prior) / full)]
    if doubts is not None and doubts.size:
        parts.append((J.T @ doubts) / full[:, None])
    std = np.linalg.norm(inverse @ np.hstack(parts), axis=1) / full
    lost = np.abs(right[~kept]).max(axis=0, initial=0.0) > 1e-3
    std[lost] = np.inf
    out[active] = std
    return out


def by_name(results: tuple[Value, ...]) -> Mapping[str, Value]:
    """The values by name."""
    return {value.name: value for value in results}
