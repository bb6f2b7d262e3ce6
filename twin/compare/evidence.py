"""How much a better fit is worth: Schwarz's criterion, chance, and samples that coloured errors are worth."""

import numpy as np
from scipy.stats import chi2

CHANCE = 0.01  # probability of naming a cause where there is none, over all causes together


def schwarz(cost: float, n_values: int, N: int) -> float:
    """Schwarz's criterion of a mean square error with n values; the least is the best."""
    return N * float(np.log(cost)) + n_values * float(np.log(N))


def beyond_chance(before: float, after: float, n_values: int, count: int, N: int) -> bool:
    """Whether n further values, the best of `count` choices, lower the mean square error more than chance does.

    A likelihood ratio with Bonferroni's correction.
    """
    return bool(N * np.log(before / after) > chi2.isf(CHANCE / count, n_values))


def independent_samples(e: np.ndarray, N: int) -> float:
    """What N errors e (N,) or (N, c), NaN where there is none, are worth in samples without memory."""
    e = e - np.nanmean(e)
    memory = float(np.clip(np.nansum(e[1:] * e[:-1]) / max(float(np.nansum(e**2)), 1e-300), 0.0, 0.99))
    return N * (1.0 - memory) / (1.0 + memory)
