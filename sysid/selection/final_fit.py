"""The fit of the chosen candidate to the whole record, or of the next one where that ends in a poor optimum."""

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

_FAR_OFF = 2.0  # times the error on unseen data, above which the fit to all the data has ended in a poor optimum
_MOST_TRIED = 3  # candidates
_USUAL_SHARE = 0.6  # of the time, for the fit from the usual starts


def final_fit(
    rows: Sequence[Row], chosen: Row, data: IOData, search: str, seed: int, effort: Effort
) -> tuple[Row, AnyFit, tuple[str, ...]]:
    """The row that is handed over, its fit, and notes on rows that were passed over.

    A search on all the data may end in a poor local optimum: the fits to the parts are starts too, and a candidate
    whose fit is nevertheless far below its own score on unseen data gives way to the next one. A model whose free run
    diverges on a part of the record is never handed over.
    """
    order = [chosen, *(r for r in rows if r is not chosen and r.whole and np.isfinite(r.fit_percent))]
    results: list[tuple[float, Row, AnyFit]] = []
    notes: list[str] = []
    for row in order[: 2 * _MOST_TRIED]:
        if len(results) == _MOST_TRIED:
            break
        scaled_data = row.candidate.scale(data)
        try:
            fit = _best_fit(
                row, scaled_data, search, seed, replace(effort, seconds=effort.seconds / (1 + len(results)))
            )
            percent = fit.fit_percent(scaled_data)
        except InputError as error:
            notes.append(f"{row.candidate} was passed over: {error}")
            continue
        if not np.isfinite(percent):
            notes.append(f"{row.candidate} was passed over: its free run over all the data diverges")
            continue
        results.append((percent, row, fit))
        # The parts are short free runs with initial states of their own, so some difference says nothing.
        if 100.0 - percent <= _FAR_OFF * (100.0 - row.fit_percent) or percent >= row.fit_percent - 1.0:
            break
        notes.append(
            f"{row.candidate} reaches {percent:.1f} % on all the data and {row.fit_percent:.1f} % on unseen parts: its "
            "search ended in a local optimum, and the next candidate was tried"
        )
    if not results:
        raise InputError(f"none of the best candidates can be fitted to the whole record and run over it: {notes[-1]}")
    _, row, fit = max(results, key=lambda result: result[0])
    return row, fit, tuple(notes)


def _best_fit(row: Row, data: IOData, search: str, seed: int, effort: Effort) -> AnyFit:
    """The better of a fit from the usual starts and one from the fits to the parts."""
    model = row.candidate.model_of(data)
    usual = fitted(row.candidate, data, search, seed, replace(effort, seconds=_USUAL_SHARE * effort.seconds))
    if not isinstance(model, Chain) or not isinstance(usual, Fit) or not row.thetas:
        return usual
    method = row.candidate.auto if search == "auto" else search
    options = Options(max_iterations=effort.iterations, max_seconds=(1.0 - _USUAL_SHARE) * effort.seconds)
    points = np.array([theta for theta in row.thetas if len(theta) == len(model.names)])
    if not len(points):  # fits of finer maps, whose places differ from part to part
        return usual
    try:
        refit = fit_chain(model, data, search=method, seed=seed, options=options, start=points)
    except InputError:
        return usual
    return refit if refit.criteria.loss < usual.criteria.loss else usual
