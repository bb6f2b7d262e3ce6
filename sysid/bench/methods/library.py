"""The structures of this library, with the orders that the scenario tells and otherwise their defaults; and the bar.

The bar is a search of the true structure that begins at the true parameters. It sees what no method may see.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.bench.contract import Data
from sysid.bench.method import FunctionMethod
from sysid.bench.task import Task
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.fitting import fit
from sysid.model.chain import Chain
from sysid.nlarx.model import Nlarx
from sysid.nlarx.result import NlarxFit
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.solver.iterate import Options
from sysid.structures import actuated_joint, hammerstein, hammerstein_wiener, nlarx, output_error, wiener
from sysid.structures.wiener_hammerstein import wiener_hammerstein
from sysid.uncertainty.information import information
from sysid.uncertainty.intervals import poles

ORDERS = (2, 2, 1)  # where the scenario tells none
SHARE = 0.8  # of the time for the searches, which begin after the starts and end with the iteration in hand


@dataclass(frozen=True)
class LibraryModel:
    """A fit as the contract wants it."""

    fit: Fit | NlarxFit
    data: IOData
    chosen: str = ""  # what a search chose, in words
    cut: str = ""  # what a search had no time for, in words

    def simulate(self, u: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Free run (N,); the initial state is fitted to y_init (n,), rest without it."""
        if not len(y_init):
            return self.fit.simulate(u)
        y = np.concatenate([y_init, np.full(len(u) - len(y_init), y_init[-1])])
        return self.fit.simulate(IOData(u, y, self.fit.Ts), len(y_init))

    @property
    def poles(self) -> np.ndarray | None:
        """Poles in z, None for a model without any."""
        return self.fit.poles if isinstance(self.fit, Fit) else None

    @property
    def details(self) -> dict[str, Any]:
        """See `sysid.bench.contract.Model`."""
        details: dict[str, Any] = {"stop": self.cut or self.fit.stop.reason, "loss": self.fit.criteria.mse}
        if isinstance(self.fit, Fit):
            details["structure"] = f"{self.chosen or self.fit.model.structure}, d {self.fit.criteria.d}"
            details["intervals"] = {"pole": _pole_intervals(self.fit, self.data)}
        return details


def _pole_intervals(fit: Fit, data: IOData) -> list[list[float]]:
    """Pole intervals as the contract wants them, robust where the residuals are coloured; none if there are none."""
    try:
        coloured = not fit.residual_tests(data).white
        roots = poles(information(fit, data, lags="auto" if coloured else None))
    except InputError:
        return []
    return [
        [z.real, z.imag, root.real.upper - z.real, root.imag.upper - z.imag]
        for root, z in ((root, root.value) for root in roots)
    ]


def record(data: Data) -> IOData:
    """The estimation data as a record."""
    parts = zip(data.u, data.y, data.missing, strict=True)
    return IOData.merge(*(IOData(u, y, data.Ts, missing=m[:, None]) for u, y, m in parts))


def fit_method(model: Callable[[int, int, int], Chain | Nlarx]) -> Callable[[Data], LibraryModel]:
    """A method of the contract that fits model(nb, nf, nk)."""

    def method(data: Data) -> LibraryModel:
        signals = record(data)
        chain = model(*(data.orders or ORDERS))
        usual = 100 if isinstance(chain, Nlarx) else Options().max_iterations
        options = Options(max_iterations=usual, max_seconds=SHARE * data.seconds)
        return LibraryModel(fit(chain, signals, seed=data.seed, options=options), signals)

    return method


def auto(data: Data) -> LibraryModel:
    """The structure search, on one core; it sees no orders."""
    signals = record(data)
    selection = select(signals, seed=data.seed, jobs=1, seconds=SHARE * data.seconds)
    return LibraryModel(selection.fit, signals, str(selection.chosen.candidate), selection.cut)


def auto_of_two(data: Data) -> LibraryModel:
    """The search of linear and Hammerstein models, to its end: its result does not depend on the machine's speed."""
    signals = record(data)
    maps = ("unit_gain", "piecewise_linear")
    space = Space((1, 2, 4), (1, 2, 4), (0, 1, 2), maps, maps, 1, 2, ("output_error", "hammerstein"), grows=False)
    selection = select(signals, space, seed=data.seed, jobs=1, seconds=math.inf)
    return LibraryModel(selection.fit, signals, str(selection.chosen.candidate), selection.cut)


def from_truth(data: Data, task: Task) -> LibraryModel:
    """The optimum near the truth. Raises InputError for a scenario whose plant is no chain."""
    truth = task.truth
    if truth is None or truth.chain is None:
        raise InputError("the plant of this scenario is no chain, so no search can begin at its parameters")
    raw = record(data)
    return LibraryModel(fit(truth.chain, raw, start=truth.theta), raw)


METHODS = (
    FunctionMethod(
        "output_error", "linear output error with a free offset", fit_method(partial(output_error, offset="free"))
    ),
    FunctionMethod("hammerstein", "Hammerstein, ten free break points", fit_method(hammerstein)),
    FunctionMethod("wiener", "Wiener, ten free break points", fit_method(wiener)),
    FunctionMethod(
        "hammerstein_wiener", "Hammerstein-Wiener, ten free break points a map", fit_method(hammerstein_wiener)
    ),
    FunctionMethod("wiener_hammerstein", "Wiener-Hammerstein, ten free break points", fit_method(wiener_hammerstein)),
    FunctionMethod(
        "nlarx",
        "nonlinear ARX fitted to its free run",
        fit_method(lambda nb, nf, nk: nlarx(na=nf, nb=nb, nk=nk, focus="simulation")),
    ),
    FunctionMethod("actuated_joint", "motor, stops and linkage", fit_method(lambda *_: actuated_joint())),
    FunctionMethod("auto", "structure search without orders", auto),
    FunctionMethod("auto_of_two", "search of output error and Hammerstein, to its end", auto_of_two),
)
FROM_TRUTH = FunctionMethod(
    "from_truth", "the true structure, begun at the truth: the bar", from_truth, sees_truth=True
)
