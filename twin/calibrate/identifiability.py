"""Which parameters records can tell, before the search: expected intervals, and parameters that act alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.calibrate.problem import Free, Simulations

# Of its scale: a parameter with a larger expected standard deviation is not told. Expected are white residuals; what
# the twin lacks makes the true deviation several times larger.
LIMIT = 0.15
ALIKE = 0.9  # correlation from which two parameters are said to act alike


@dataclass(frozen=True)
class Identifiability:
    """A parameter, the standard deviation that the records promise [unit], its scale, and those that act alike.

    `told` is false where the deviation is above `LIMIT` of the scale, with all parameters kept so far free, and for the
    row of an end that no log strikes (`missed`).
    """

    name: str
    unit: str
    expected: float
    scale: float
    told: bool
    alike: tuple[str, ...] = ()
    missed: bool = False

    def sentence(self) -> str:
        """Why it is not told; empty for a parameter that is."""
        if self.told:
            return ""
        if self.missed:
            return f"No log rests at the end stop that {self.name} places, under a voltage towards it: not calibrated."
        if self.alike:
            return (
                f"{self.name} and {' and '.join(self.alike)} act alike in these records; {self.name} keeps its value."
            )
        return f"These records hardly show {self.name}; it keeps its value."


def promised_covariance(J: np.ndarray, noise: float) -> np.ndarray:
    """Covariance (n, n) of coordinates from a Jacobian (N, n) and white noise; infinite variance without any effect."""
    size = np.linalg.norm(J, axis=0)
    acts = size > 1e-9 * size.max(initial=0.0)
    out = np.diag(np.full(J.shape[1], np.inf))
    if acts.any():
        design = J[:, acts] / size[acts]
        inverse = np.linalg.pinv(design.T @ design, rcond=1e-12, hermitian=True)
        out[np.ix_(acts, acts)] = noise**2 * inverse / np.outer(size[acts], size[acts])
    return out


def tell(
    problem: Simulations, J: np.ndarray, noise: float, order: Sequence[str], missed: Sequence[str] = ()
) -> tuple[Identifiability, ...]:
    """What the Jacobian J (N, n) at the start promises for the parameters `order`, for residuals of size `noise`.

    `missed` are rows of ends that no log strikes. They move the response only through limit switches and the other end.

    As long as a parameter is not told, the one that comes last in `order` among those not told is fixed, which may
    leave the others well told.
    """
    p, n_shared = problem.start, len(problem.shared)
    slopes = problem.slopes(p)
    columns = [j for j, f in enumerate(problem.free) if j >= n_shared or (f.name in order and f.name not in missed)]
    verdicts = {
        f.name: Identifiability(f.name, f.unit, np.inf, f.scale, False, missed=True)
        for f in problem.shared
        if f.name in missed
    }
    while True:
        cov = promised_covariance(J[:, columns], noise)
        std = np.sqrt(np.diag(cov))
        rows = [
            _assess_parameter(
                problem.free[j], float(std[i] * slopes[j]), _alike(problem.free, cov, columns, i, n_shared)
            )
            for i, j in enumerate(columns)
            if j < n_shared
        ]
        doubtful = [row for row in rows if not row.told]
        if not doubtful:
            break
        last = max(doubtful, key=lambda row: order.index(row.name))
        verdicts[last.name] = last
        columns = [j for j in columns if problem.free[j].name != last.name]
    verdicts |= {row.name: row for row in rows}
    return tuple(verdicts[name] for name in order)


def _assess_parameter(free: Free, deviation: float, alike: tuple[str, ...]) -> Identifiability:
    return Identifiability(free.name, free.unit, deviation, free.scale, bool(deviation <= LIMIT * free.scale), alike)


def _alike(free: Sequence[Free], cov: np.ndarray, columns: Sequence[int], i: int, n_shared: int) -> tuple[str, ...]:
    """Names of the shared parameters whose estimate would follow that of parameter i."""
    with np.errstate(invalid="ignore", divide="ignore"):
        r = cov[i] / np.sqrt(cov[i, i] * np.diag(cov))
    return tuple(free[j].name for k, j in enumerate(columns) if k != i and j < n_shared and abs(r[k]) > ALIKE)
