"""Whether the runs of a calibration agree: the values that each run asks for, and a test of their differences.

One parameter at a time has a value of its own in each run, one Gauss-Newton step from the common one, beside all others
that the runs share. The residual is noise and the departures of `twin.calibrate.discrepancy`, which all runs of a leg
share; a change of one scale is plausible before a run is seen (the prior).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, norm

from twin.calibrate import discrepancy
from twin.calibrate.problem import Free, Simulations

CHANCE = 0.01  # probability of calling runs different where they are not, over all parameters
_BLIND = 1e-9  # of the largest: a direction in which no two runs tell a parameter


@dataclass(frozen=True)
class Agreement:
    """A parameter [unit] in all runs together, and in each run with its interval (runs,).

    `told`: whether a run says more of it than was plausible before (runs,). `chance`: probability of such differences
    between runs of one leg, from the size `squares` of the differences over their errors. `differ`: they are no chance,
    over all parameters together, and move a response by more than matters. `odd`: number of the run that is farthest
    from the others, None without a difference or with two runs; `rest_agrees`: whether the others agree. A value that
    was searched as the cause (`twin.calibrate.rivals`) leaves residuals `rms` [rad], is `behind` the best in log
    likelihood, and is a `rival` if that leaves it possible.
    """

    name: str
    unit: str
    value: float
    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    told: np.ndarray
    chance: float
    squares: float
    differ: bool
    odd: int | None = None
    rest_agrees: bool = True
    rms: float | None = None
    behind: float = np.inf
    rival: bool = False


def agreement(
    task: Simulations,
    p: np.ndarray,
    e: np.ndarray,
    J: np.ndarray,
    level: float,
    least: float = 0.0,
    offset: Free | None = None,
) -> tuple[Agreement, ...]:
    """The values of each run of `task` at its optimum p (n,), for every shared parameter; empty for one run.

    e (N,) are the residuals and J (N, n) their Jacobian; differences that change the response of a run by less than
    `least` RMS matter to nobody. `offset` of the reading, which is 0 at the optimum, is asked for like the others.
    Values and covariance are those of generalised least squares.
    """
    if len(task.records) < 2:
        return ()
    runs = np.repeat(np.arange(len(task.lengths)), task.lengths)[:, None] == np.arange(len(task.lengths))
    scored = np.concatenate([record.scored for record in task.records])
    steps = [record.Ts for record in task.records]
    spreads = task.spreads(p)  # the priors are 1 where a column counts in scales
    J = J * spreads
    candidates = [
        (free, z, spread, J[:, [j]], np.delete(J, j, axis=1))
        for j, (free, z, spread) in enumerate(zip(task.shared, p, spreads, strict=False))
    ]
    if offset is not None:
        candidates.append((offset, 0.0, 1.0, np.full((len(e), 1), offset.scale), J))
    split = np.hstack([column * runs for _, _, _, column, _ in candidates])
    own = J[:, len(task.shared) :]
    groups, size = discrepancy.estimate(e, np.hstack([split, own]), task.responses_at(p), steps, scored)
    rows = []
    for free, z, spread, column, others in candidates:
        columns = column * runs
        change, posterior, sampling = (
            part[: runs.shape[1]] for part in own_steps(e, np.hstack([columns, others]), groups, size)
        )
        sampling, stds = sampling[:, : runs.shape[1]], np.sqrt(np.diag(posterior))
        seen = np.sqrt(np.sum(columns**2, axis=0) / task.lengths)  # RMS of the response per unit
        matters = float(np.max(np.abs(change - np.median(change)) * seen)) > least
        row = _of_parameter(free, float(z), spread, change, stds, sampling, CHANCE / len(candidates), level)
        rows.append(row if matters else replace(row, differ=False, odd=None, rest_agrees=True))
    return tuple(rows)


def own_steps(
    e: np.ndarray, design: np.ndarray, groups: list[np.ndarray], size: discrepancy.Sizes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The steps (m,) of all values, in scales, their covariance beside the prior, and that over runs of one leg.

    The residuals have the covariance noise^2 I + sum of size_g^2 Phi_g Phi_g', inverted by Woodbury's formula.
    """
    Phi = discrepancy.by_size(groups, size) / size.noise
    inner = np.linalg.cholesky(np.eye(Phi.shape[1]) + Phi.T @ Phi)

    def weighed(X: np.ndarray) -> np.ndarray:
        half = np.linalg.solve(inner, Phi.T @ X)
        return np.asarray(X - Phi @ np.linalg.solve(inner.T, half)) / size.noise**2

    information = design.T @ weighed(design)
    posterior = np.linalg.inv(information + np.eye(len(information)))
    return posterior @ (design.T @ weighed(e)), posterior, posterior @ information @ posterior


def _of_parameter(
    free: Free,
    z: float,
    spread: float,
    steps: np.ndarray,
    stds: np.ndarray,
    sampling: np.ndarray,
    limit: float,
    level: float,
) -> Agreement:
    """What the runs say of one parameter at coordinate z, whose steps (runs,) count in scales of `spread` each."""
    wide = float(norm.ppf(0.5 + level / 2))
    low, values, high = (free.outer(z + spread * (steps + side * wide * stds)) for side in (-1.0, 0.0, 1.0))
    told = stds**2 < 0.5  # the run's information is larger than that of the prior, whose variance is 1
    squares, chance = differences(steps, sampling)
    row = Agreement(
        free.name, free.unit, float(free.outer(z)), values, low, high, told, chance, squares, chance < limit
    )
    odd, rest = odd_run(steps, sampling, limit) if row.differ else (None, True)
    return replace(row, odd=odd, rest_agrees=rest)


def odd_run(steps: np.ndarray, sampling: np.ndarray, limit: float) -> tuple[int | None, bool]:
    """The run whose value is farthest from the others, None of two, and whether those agree at probability `limit`."""
    if len(steps) < 3:
        return None, True
    runs = np.arange(len(steps))
    others = [differences(steps[runs != k], sampling[np.ix_(runs != k, runs != k)]) for k in runs]
    best = min(runs, key=lambda k: others[k][0])
    return int(best), others[best][1] >= limit


def differences(steps: np.ndarray, sampling: np.ndarray) -> tuple[float, float]:
    """Wald's statistic of the differences between runs, and its probability if their true values are the same."""
    contrasts = np.diff(np.eye(len(steps)), axis=0)
    values, vectors = np.linalg.eigh(contrasts @ sampling @ contrasts.T)
    seen = values > _BLIND * max(float(np.diag(sampling).max()), 1e-300)
    if not seen.any():
        return 0.0, 1.0
    squares = float(np.sum((vectors[:, seen].T @ contrasts @ steps) ** 2 / values[seen]))
    return squares, float(chi2.sf(squares, seen.sum()))


def agreeing(steps: np.ndarray, covariance: np.ndarray) -> list[int]:
    """The runs whose values (runs,) agree, without those that are odd; all of them if no more than half agree."""
    kept = list(range(len(steps)))
    while len(kept) > 1 and differences(steps[kept], covariance[np.ix_(kept, kept)])[1] < CHANCE:
        rests = [[k for k in kept if k != odd] for odd in kept]
        kept = min(rests, key=lambda rest: differences(steps[rest], covariance[np.ix_(rest, rest)])[0])
    return kept if 2 * len(kept) > len(steps) else list(range(len(steps)))
