"""NIST's StRD nonlinear regression sets through the solver of this library, from both published starts.

National Institute of Standards and Technology, Statistical Reference Datasets, nonlinear regression: data, starts and
certified values as published, in nist/. The solver is that of `sysid.fit`; here it gets a function in place of a chain.
"""

import csv
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sysid.bench.certificate.digits import digits, fewest
from sysid.bench.certificate.functions import FUNCTIONS, LOGARITHM, Function
from sysid.solver.covariance import covariance
from sysid.solver.iterate import Options, iterate
from sysid.solver.linearisation import Linearisation
from sysid.solver.searches import search as make_search

FOLDER = Path(__file__).with_name("nist")
STEP = 1e-30  # of a complex number: its square is below rounding, so the derivative has no error of its own
LEVELS = ("lower", "average", "higher")
# To the last digit: no rounding of points, and a step while a drop of the loss of 1e-15 of itself is expected. Below
# that, sums of squares of doubles cannot tell which of two points is lower.
EXACT = Options(max_iterations=5000, tolerance=1e-13, grain=0.0)


@dataclass(frozen=True)
class Reference:
    """A set: predictors x (k, N), y (N,), starts (2, P), certified parameters and standard deviations (P,), and rss."""

    name: str
    level: str
    x: np.ndarray
    y: np.ndarray
    starts: np.ndarray
    parameters: np.ndarray
    deviations: np.ndarray
    rss: float

    @cached_property
    def problem(self) -> "Regression":
        """The set for the solver."""
        return Regression(FUNCTIONS[self.name], self.x, self.y)


@dataclass(frozen=True)
class Regression:
    """A function and its data as a problem of `sysid.solver.iterate`, without bounds."""

    function: Function
    x: np.ndarray
    y: np.ndarray

    @property
    def size(self) -> float:
        return float(self.y @ self.y)

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        with np.errstate(all="ignore"):
            e = self.y - self.function(p, self.x)
        return e if np.all(np.isfinite(e)) else None

    def repair(self, p: np.ndarray) -> np.ndarray:
        return p

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        return np.zeros(len(p), dtype=bool)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(all="ignore"):
            e = self.y - self.function(p, self.x)
            columns = [self.function(p + 1j * STEP * unit, self.x).imag / STEP for unit in np.eye(len(p))]
        return e, np.nan_to_num(np.column_stack(columns), nan=np.inf)


@dataclass(frozen=True)
class StaticGrade:
    """Digits of parameters, standard deviations and rss, the worst of each, and why the search ended."""

    name: str
    level: str
    start: int
    search: str
    parameters: float
    deviations: float
    rss: float
    iterations: int
    stop: str


def references() -> dict[str, Reference]:
    """All sets by name."""
    table = json.loads((FOLDER / "certified.json").read_text(encoding="ascii"))
    return {name: _reference(name, facts) for name, facts in table.items()}


def _reference(name: str, facts: dict) -> Reference:
    with (FOLDER / f"{name}.csv").open(encoding="ascii", newline="") as file:
        y, *x = np.array(list(csv.reader(file))[1:], dtype=float).T
    starts = np.array([facts["start1"], facts["start2"]], dtype=float)
    values, deviations = (np.array(facts[key], dtype=float) for key in ("parameters", "deviations"))
    y = np.log(y) if name in LOGARITHM else y
    return Reference(name, facts["level"], np.array(x), y, starts, values, deviations, float(facts["rss"]))


def grade(reference: Reference, start: int, search: str = "auto", options: Options = EXACT) -> StaticGrade:
    """The solver's digits on one set from start 1 or 2."""
    problem, P = reference.problem, len(reference.parameters)
    outcome = iterate(problem, reference.starts[start - 1], make_search(search), options)
    stop = outcome.stop
    if not np.isfinite(outcome.cost):
        return StaticGrade(reference.name, reference.level, start, search, 0.0, 0.0, 0.0, 0, stop.reason)
    lin = Linearisation.of(*problem.linearise(outcome.p))
    spread = covariance(lin, np.zeros((P, 0)), np.eye(P), P).std()
    return StaticGrade(
        reference.name,
        reference.level,
        start,
        search,
        fewest(outcome.p, reference.parameters),
        fewest(spread, reference.deviations),
        digits(outcome.cost, reference.rss),
        stop.iterations,
        stop.reason,
    )
