"""fit_nlarx(model, data): normal units, starts from the data, the common search loop, the best result."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.criteria import criteria
from sysid.base.errors import InputError, TooFewSamplesError
from sysid.base.parallel import one_blas_thread
from sysid.block.symmetry import direction
from sysid.data.record import IOData, check_magnitudes
from sysid.estimation.normal import largest_unit, observed_samples, unit_of
from sysid.estimation.origin import FREE_RUN, ONE_STEP, Origin
from sysid.nlarx.choice import RIDGES, choices, choose_size
from sysid.nlarx.model import Network, Nlarx
from sysid.nlarx.problem import Piece, SimulationProblem, limit
from sysid.nlarx.result import Choice, NlarxFit
from sysid.nlarx.starts import Run, linear_start, runs_of
from sysid.solver.covariance import Covariance, covariance
from sysid.solver.iterate import Options
from sysid.solver.linearisation import Linearisation
from sysid.solver.searches import search as make_search

ITERATIONS = 100  # of each search, at most
_FREE = 2.0  # times the least mean square of a free run, above which a start is out


@dataclass(frozen=True)
class Units:
    """u = a u and y = b y in normal units; powers of two or their negatives, so that nothing is rounded."""

    a: float
    b: float

    @classmethod
    def of(cls, data: IOData) -> "Units":
        """The units that bring the spread of a record of one input and one output near 1, and its signs to one side."""
        u, (y,) = data.u[:, 0], observed_samples(data)
        return cls(direction(u) * unit_of(u), direction(y) * largest_unit(data))

    def normal(self, data: IOData) -> IOData:
        """The record in normal units."""
        return replace(data, u=data.u / self.a + 0.0, y=data.y / self.b + 0.0)

    def factors(self, network: Network) -> np.ndarray:
        """theta (P,) of the network by theta in normal units: its units see coordinates, which have none."""
        scale = np.ones(network.size)
        scale[0] = self.b
        scale[1 : 1 + network.n] = self.b / self._regressors(network)
        scale[network.dilations - 1] = self.b
        return scale

    def network(self, network: Network) -> Network:
        """A network of normal units for regressors in those of the record."""
        r = self._regressors(network)
        return replace(network, mu=network.mu * r, T=np.ascontiguousarray(network.T / r))

    def covariance(self, cov: Covariance, network: Network) -> Covariance:
        """The covariance of theta in the units of the record."""
        f = self.factors(network)
        return Covariance(cov.cov * np.outer(f, f), cov.unidentifiable, cov.noise_variance * self.b**2)

    def choices(self, sizes: tuple[Choice, ...]) -> tuple[Choice, ...]:
        """The errors of each size in the unit of the output."""
        size = abs(self.b)
        return tuple(replace(c, error=c.error * size, free=c.free * size) for c in sizes)

    def _regressors(self, network: Network) -> np.ndarray:
        model = network.model
        return np.repeat([self.b, self.a], [model.na, model.nb])


@checked
def fit_nlarx(
    model: Nlarx,
    data: IOData,
    search: str = "lm",
    starts: int = 3,
    seed: int = 0,
    options: Options | None = None,
    ridge: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> NlarxFit:
    """Fit a nonlinear ARX model to a record of one input and one output; its focus selects the errors.

    search: a name of `sysid.solver.searches.TABLE`; starts: number of initial networks, the first on a dyadic grid, the
    others on points drawn with `seed`; a simulation focus adds the linear output-error model. ridge: penalty on large
    weights (see `PredictionProblem`); None means 1e-2, and with units='auto' the best of three on held-back blocks,
    which also select the units (see `choice` of the fit): a size whose free run on them is poor is out. Each experiment
    has its own initial samples; missing samples do not count. Raises InputError for records that are too short or
    constant.
    """
    began = time.perf_counter()
    options = (options or Options(max_iterations=ITERATIONS)).begun()
    make_search(search)
    check_magnitudes(data)
    pieces = Piece.of(data)
    check(model, pieces, starts)
    if ridge is not None and not 0.0 <= ridge < np.inf:
        raise InputError(f"ridge is {ridge}; give 0 or a positive number")
    units = Units.of(data)
    normal_data, square = units.normal(data), units.b**2
    with one_blas_thread():
        choice: tuple[Choice, ...] = ()
        sized_model, weight = model, RIDGES[0] if ridge is None else ridge
        if model.units == "auto":
            choice = choices(model, normal_data, RIDGES if ridge is None else (ridge,), search, options.deadline)
            best_choice = choose_size(choice)
            sized_model, weight = replace(model, units=best_choice.units), best_choice.ridge
        linear = linear_start(sized_model, normal_data)
        runs = runs_of(sized_model, normal_data, search, starts, seed, options, weight, linear)
        best = _best(runs, Piece.of(normal_data), model.lag)
        if best.network.units:  # its ridge, or a limit of its dilations, may leave a network above the linear model
            flat = runs_of(
                replace(sized_model, units=0), normal_data, search, 1, seed, options, weight, linear, leaders=1
            )
            best = min(best, *flat, key=lambda run: run.loss)
        if not np.isfinite(best.loss):
            raise InputError(
                f"the free run of each of {len(runs)} start(s) diverges; use focus='prediction' or other orders"
            )
        if progress is not None:
            progress(f"{model.structure}: loss {best.loss * square:.4g} with {best.network.units} units")
        theta = best.outcome.p
        e, J = best.problem.linearise(theta)
        N, d = best.problem.N, len(theta)
        cov = covariance(Linearisation.of(e[:N], J[:N]), np.zeros((d, 0)), np.eye(d), d)
    fit = NlarxFit(
        model=model,
        network=units.network(best.network),
        theta=theta * units.factors(best.network),
        Ts=data.Ts,
        criteria=criteria(best.loss * square, N, d),
        criteria_of=FREE_RUN if model.focus == "simulation" else ONE_STEP,
        covariance=units.covariance(cov, best.network),
        stop=best.outcome.stop,
        history=tuple({**row, "loss": row["loss"] * square} for row in best.outcome.history),
        warnings=(),
        losses=tuple(run.loss * square for run in runs),
        seconds=0.0,
        search=search,
        n_init=model.lag,
        limit=limit(pieces),
        ridge=weight,
        choice=units.choices(choice),
        u_span=(float(data.u.min()), float(data.u.max())),
        y_span=(float(data.y.min()), float(data.y.max())),
        u_offset=data.u_offset.copy(),
        y_offset=data.y_offset.copy(),
    )
    origin = Origin.of(data, fit.fit_percent(data))
    return replace(fit, warnings=_warnings(fit, data), seconds=time.perf_counter() - began, origin=origin)


def _best(runs: list[Run], pieces: tuple[Piece, ...], lag: int) -> Run:
    """The least loss among those whose free run on the record itself is not far worse than the best one's."""
    finished = [run for run in runs if run.ended] or runs
    free = []
    for run in finished:
        e = SimulationProblem(run.network, pieces, lag).residual(run.outcome.p)
        free.append(np.inf if e is None else float(np.mean(e**2)))
    least = min(free)
    stable = [run for run, f in zip(finished, free, strict=True) if f <= _FREE * least or not np.isfinite(least)]
    return min(stable, key=lambda run: run.loss)


def check(model: Nlarx, pieces: tuple[Piece, ...], starts: int) -> None:
    """Raises InputError for a constant signal, a record that is too short, and fewer than one start."""
    if starts < 1:
        raise InputError(f"starts is {starts}; give at least 1")
    for name in ("u", "y"):
        signal = np.concatenate([getattr(p, name) for p in pieces])
        if np.ptp(signal) == 0.0:
            label = {"u": "input", "y": "output"}[name]
            raise InputError(
                f"the {label} is constant ({signal[0]:g}) over all {len(signal)} samples; record one that varies"
            )
    if min(len(p.y) for p in pieces) < model.lag + 2:
        raise InputError(
            f"an experiment of {min(len(p.y) for p in pieces)} samples is too short for lags of {model.lag}; "
            f"give at least {model.lag + 2} or lower the orders"
        )
    units = 0 if model.units == "auto" else int(model.units)
    m = len(model.regressors if model.nonlinear is None else model.nonlinear)
    minimum = 2 + len(model.regressors) + units * (m + 2)
    N = sum(len(p.y) - model.lag for p in pieces)
    if minimum > N:
        raise TooFewSamplesError(
            f"{N} samples after the first {model.lag} are too few for {minimum - 1} parameters; "
            f"give at least {minimum + model.lag} samples or lower orders and units",
            *(minimum - 1, minimum + model.lag, model.structure),
        )


def _warnings(fit: NlarxFit, data: IOData) -> tuple[str, ...]:
    """Warnings on the search, on a free run that runs away, and on what the data do not determine."""
    warnings = []
    if not fit.stop.converged:
        warnings.append(f"the search did not converge: {fit.stop.reason}")
    departure = fit.divergence(data) or fit.excursion(data)
    if departure is not None:
        warnings.append(f"on the estimation record {departure}")
    held_errors = [c.free for c in fit.choice if (c.units, c.ridge) == (fit.network.units, fit.ridge)]
    if departure is None and held_errors and not held_errors[0] <= float(np.std(data.y)):
        warnings.append(
            "on blocks held back from the choice of units the free run is worse than the mean of the output: the model "
            "predicts one step ahead only; use focus='simulation', other orders or a longer record"
        )
    undetermined_names = [n for n, bad in zip(fit.network.names, fit.covariance.unidentifiable, strict=True) if bad]
    if undetermined_names:
        text = ", ".join(undetermined_names[:6]) + (
            f" and {len(undetermined_names) - 6} more" if len(undetermined_names) > 6 else ""
        )
        warnings.append(f"the data do not determine {text}; use fewer units or orders")
    return tuple(warnings)
