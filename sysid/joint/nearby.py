"""Searches of a joint from several points, and from points beside an optimum."""

from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import shake_theta, trade_lag_for_delay
from sysid.estimation.objective import Objective
from sysid.estimation.result import Fit
from sysid.estimation.search import SearchContext, set_curvature_weight
from sysid.joint.parts import again
from sysid.model.chain import Chain
from sysid.solver.iterate import Options

SHAKES = 12  # places near an optimum that are tried
_USUAL, _LAST = (4, 3), (15, 8)  # iterations at each of these places, and how many go on; for the whole joint
_MANY = 3  # points beyond which only the best after a glance go on


def searched(
    chain: Chain, points: np.ndarray, data: IOData, options: dict[str, Any], limit: Options | None = None
) -> Fit | None:
    """The fit from these points (K, P); None if the chain diverges at every one of them."""
    if len(points) > _MANY:
        points = glanced(chain, points, data, *_USUAL)
    if not len(points):
        return None
    try:
        return fit_chain(chain, data, start=points, options=limit, **options)
    except (InputError, np.linalg.LinAlgError):  # a motor that runs away has derivatives too large for numbers
        return None


def glanced(chain: Chain, points: np.ndarray, data: IOData, iterations: int, finalists: int) -> np.ndarray:
    """The best of these points (K, P) after a few iterations at each, the best first."""
    context = SearchContext(chain, data, Objective(), "lm", Options(max_iterations=iterations).begun(), None)
    problems = set_curvature_weight(context, [context.problem(with_initial_states(chain, p, data)) for p in points])
    outcomes = [context.iterate(problem, problem.start, context.options) for problem in problems]
    order = np.argsort([o.cost for o in outcomes], kind="stable")[:finalists]
    return np.array([problems[k].thetas(outcomes[k].p)[0] for k in order if np.isfinite(outcomes[k].cost)])


def better(
    fit: Fit, points: list[np.ndarray], data: IOData, options: dict[str, Any], glance: int = 4, finalists: int = 3
) -> Fit:
    """The fit, or that from the most promising points: `glance` iterations at each, the `finalists` to the end."""
    leaders = glanced(fit.model, np.array(points), data, glance, finalists)
    other = searched(fit.model, leaders[:finalists], data, options)
    return other if other is not None and other.criteria.loss < fit.criteria.loss else fit


def beside(fit: Fit, data: IOData, options: dict[str, Any], grown: tuple[str, ...] = ()) -> Fit:
    """The fit, or a better one from nearby starts: whether a stop is reached in time is discrete and blocks the search.

    Several `grown` parts are started again from their initial values, because each was added to a simpler joint.
    """
    chain, rng = fit.model, np.random.default_rng([options["seed"], len(fit.theta)])
    points = [np.clip(shake_theta(chain, fit.theta, rng), *chain.limits) for _ in range(SHAKES)]
    if len(grown) > 1:
        points += [point for name in grown for point in again(name, fit, data)]
    return better(fit, points + trade_lag_for_delay(chain, fit.theta), data, options, *(_LAST if grown else _USUAL))
