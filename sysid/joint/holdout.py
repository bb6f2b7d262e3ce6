"""Free runs of a joint over parts of its record that it was not fitted to, and whether a richer one does harm there."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.free_run import resting_theta
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.objective import Objective
from sysid.estimation.prior import Prior
from sysid.estimation.search import SearchContext, set_curvature_weight
from sysid.model.chain import Chain
from sysid.selection.folds import Fold, folds
from sysid.solver.iterate import Options

INITIAL_SAMPLES = 20  # samples that give a free run its initial position
_ITERATIONS = 8  # of the search on a fold: it begins at the optimum of the whole record
_CHUNKS = 24  # of the record, each one a vote
_DIVERGED = 1e100  # error of a free run that diverges
_CHANCE = 2.5  # t of a mean over some twenty chunks that chance exceeds once in a hundred


@dataclass(frozen=True)
class HoldoutErrors:
    """Errors (M,) of free runs over the unseen part of every fold, and the chunk (M,) that each belongs to."""

    errors: np.ndarray
    chunks: np.ndarray
    spread: float  # of the output over these samples, standard deviation

    @property
    def rms(self) -> float:
        """Root mean square of the errors, in the unit of y."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def percent(self) -> float:
        """Free-run fit [%]."""
        return 100.0 * (1.0 - self.rms / self.spread) if self.spread > 0.0 else np.nan


def holdout_folds(data: IOData) -> tuple[Fold, ...]:
    """Two folds that show what the record shows; none for a record that is too short."""
    try:
        pair = folds(data)
    except InputError:
        return ()
    return tuple(Fold(f.estimation, f.unseen, min(INITIAL_SAMPLES, min(f.unseen.lengths) // 4)) for f in pair)


def holdout_errors(
    chain: Chain, theta: np.ndarray, pair: tuple[Fold, ...], prior: Prior | None = None
) -> HoldoutErrors:
    """The chain fitted to each fold from theta (P,), the optimum of the whole record, and run over the other part."""
    errors, chunks, outputs, chunk_count = [], [], [], 0
    with one_blas_thread(), np.errstate(all="ignore"):
        for fold in pair:
            fold_theta = refit(chain, theta, fold.estimation, prior)
            is_judged, y = fold.judged, fold.unseen.y[:, 0]
            run = np.concatenate([_free_run(chain, fold_theta, e) for e in fold.unseen.experiments])
            length = max(1, round(sum(f.unseen.N for f in pair) / _CHUNKS))
            places = np.concatenate([np.arange(n) // length + 1000 * k for k, n in enumerate(fold.unseen.lengths)])
            places, chunk_count = places + chunk_count, chunk_count + int(places.max()) + 1000
            errors.append((y - run)[is_judged])
            chunks.append(places[is_judged])
            outputs.append(y[is_judged])
    e = np.clip(np.nan_to_num(np.concatenate(errors), nan=_DIVERGED), -_DIVERGED, _DIVERGED)
    return HoldoutErrors(e, np.concatenate(chunks), float(np.std(np.concatenate(outputs))))


def refit(chain: Chain, theta: np.ndarray, data: IOData, prior: Prior | None = None) -> np.ndarray:
    """theta (P,) after a few iterations on another record; theta itself where no search is possible there."""
    return refit_with_cost(chain, theta, data, prior)[0]


def refit_with_cost(
    chain: Chain, theta: np.ndarray, data: IOData, prior: Prior | None = None
) -> tuple[np.ndarray, float]:
    """The same and the sum of squared errors [y^2], those of the prior included."""
    context = SearchContext(
        chain, data, Objective(prior=prior), "lm", Options(max_iterations=_ITERATIONS).begun(), None
    )
    rows = [estimate_initial(chain, resting_theta(chain, theta), _first_samples(e)) for e in data.experiments]
    problem = set_curvature_weight(context, [context.problem(np.array(rows))])[0]
    outcome = context.iterate(problem, problem.start, context.options)
    return (problem.thetas(outcome.p)[0] if np.isfinite(outcome.cost) else theta), outcome.cost


def _first_samples(data: IOData) -> IOData:
    """As many samples from the first that is observed as give the initial position."""
    first = int(np.argmax(data.observed[:, 0]))
    return data.select(0, min(data.N, first + INITIAL_SAMPLES))


def _free_run(chain: Chain, theta: np.ndarray, data: IOData) -> np.ndarray:
    with np.errstate(all="ignore"):
        start = estimate_initial(chain, resting_theta(chain, theta), _first_samples(data))
        return chain.outputs(start, data.u)[:, 0]


def harm(plain: HoldoutErrors, richer: HoldoutErrors, floor: float) -> float:
    """t of the mean change of the logarithm of the error from the plain to the richer joint, over the chunks.

    Positive: the richer one is worse. `floor` [unit of y] is the noise, below which an error is none.
    """
    changes = []
    for chunk in np.unique(plain.chunks):
        here = plain.chunks == chunk
        a, b = (np.log(np.mean(x.errors[here] ** 2) + floor**2) for x in (plain, richer))
        changes.append(b - a)
    spread = float(np.std(changes, ddof=1)) if len(changes) > 1 else 0.0
    if spread == 0.0:
        return 0.0
    return float(np.mean(changes)) / (spread / np.sqrt(len(changes)))


def is_harmful(plain: HoldoutErrors, richer: HoldoutErrors, floor: float) -> bool:
    """Whether the richer joint is worse on unseen parts beyond chance."""
    return harm(plain, richer, floor) > _CHANCE
