"""The chosen candidate fitted to all the data, and the check that this fit is as good as its fits to the parts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.selection.judge import AnyFit, Effort, fitted
from sysid.selection.table import Row
from sysid.solver.iterate import Options

_FAR = 2.0  # times the error on unseen data, above which the fit to all the data has ended in a poor optimum
_TRIED = 3  # candidates
_USUAL = 0.6  # of the time, for the fit from the usual starts


def final_fit(
    rows: Sequence[Row], chosen: Row, data: IOData, search: str, seed: int, effort: Effort
) -> tuple[Row, AnyFit, tuple[str, ...]]:
    """The row that is handed over, its fit, and notes on rows that were passed over.

    A search on all the data may end in a poor local optimum: the fits to the parts are starts too, and a candidate
    whose fit is nevertheless far below its own score on unseen data gives way to the next one.
    """
    order = [chosen, *(r for r in rows if r is not chosen and r.whole and np.isfinite(r.fit_percent))]
    found: list[tuple[float, Row, AnyFit]] = []
    notes: list[str] = []
    for row in order[:_TRIED]:
        own = row.candidate.scale(data)
        try:
            fit = _fit(row, own, search, seed, replace(effort, seconds=effort.seconds / (1 + len(found))))
            percent = _percent(fit, own)
        except InputError as error:
            notes.append(f"{row.candidate} was passed over: {error}")
            continue
        found.append((percent, row, fit))
        # The parts are short free runs with initial states of their own, so some difference says nothing.
        if 100.0 - percent <= _FAR * (100.0 - row.fit_percent) or percent >= row.fit_percent - 1.0:
            break
        notes.append(
            f"{row.candidate} reaches {percent:.1f} % on all the data and {row.fit_percent:.1f} % on unseen parts: its "
            "search ended in a local optimum, and the next candidate was tried"
        )
    if not found:
        raise InputError(f"none of the best {_TRIED} candidates can be fitted to the whole record: {notes[-1]}")
    _, row, fit = max(found, key=lambda each: each[0])
    return row, fit, tuple(notes)


def _fit(row: Row, data: IOData, search: str, seed: int, effort: Effort) -> AnyFit:
    """The better of a fit from the usual starts and one from the fits to the parts."""
    model = row.candidate.model()
    usual = fitted(row.candidate, data, search, seed, replace(effort, seconds=_USUAL * effort.seconds))
    if not isinstance(model, Chain) or not isinstance(usual, Fit) or not row.thetas:
        return usual
    method = row.candidate.auto if search == "auto" else search
    options = Options(max_iterations=effort.iterations, max_seconds=(1.0 - _USUAL) * effort.seconds)
    points = np.array([theta for theta in row.thetas if len(theta) == len(usual.theta)])
    try:
        again = fit_chain(model, data, search=method, seed=seed, options=options, start=points)
    except InputError:
        return usual
    return again if again.criteria.loss < usual.criteria.loss else usual


def _percent(fit: AnyFit, data: IOData) -> float:
    return fit.fit_percent(data)
