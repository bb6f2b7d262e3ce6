"""A fit is never worse than its own linear start: where a portfolio ends above it, the search goes on from there."""

from dataclasses import replace

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.portfolio.surrogate import is_map
from sysid.estimation.race import Raced, Run
from sysid.estimation.start import longest
from sysid.estimation.starts import starts as make_starts

_SHOWN = 20_000  # samples that give the linear start
_QUICK = 5000  # samples whose linear start takes less than a second: also where the time is over
_CLEAR = 1.0 + 1e-6  # times the mean square of the output, above which a fit explains less than a constant


def guarded(run: Run, raced: Raced, seed: int) -> Raced:
    """The result, or that of a search from the linear start of the chain where it ends lower.

    A portfolio need not contain that start: its candidates come from curves, and a map may not come near to them.
    """
    if not raced.members or not any(is_map(b) for b in run.model.blocks):
        return raced  # a race of starts contains the linear one, and so does the portfolio of a filter without maps
    part = longest(run.data)
    if run.late and part.N > _QUICK:
        return raced
    try:
        first = make_starts(run.model, part.select(0, min(part.N, _SHOWN)), 1, seed)[0]
    except (InputError, np.linalg.LinAlgError):
        return raced
    problem = run.problem(with_initial_states(run.model, first, run.data))
    problem = replace(problem, curvature_weight=raced.problem.curvature_weight)
    e = problem.residual(problem.start)
    if e is None or not np.all(np.isfinite(e)) or not float(e @ e) < raced.outcome.cost:
        return raced
    outcome = run.iterate(problem, problem.start, run.options)
    members, costs = (*raced.members, "linear"), (*raced.costs, outcome.cost)
    return replace(raced, problem=problem, outcome=outcome, members=members, costs=costs, agreed=1)


def worse_than_constant(data: IOData, mse: float) -> tuple[str, ...]:
    """A warning where the free run with this mean square error is further from the output than its own mean."""
    parts = [column[seen] for column, seen in zip(data.y.T, data.observed.T, strict=True)]
    squares = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
    if not mse * data.observed.sum() > _CLEAR * squares:
        return ()
    return (
        "the free run is further from the output than the output's own mean: remove the offsets of the record "
        "(sysid.data.preprocess.detrend), or choose another structure or other orders",
    )
