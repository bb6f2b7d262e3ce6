"""Fit: the result of a search, with simulation, criteria, poles, parameters and tests."""

from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.criteria import Criteria, fit_percent
from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.base.parallel import one_blas_thread
from sysid.blocks import Predictor, Process, StateSpace
from sysid.data.record import IOData, siso
from sysid.data.trends import restore_offsets, with_offsets
from sysid.diagnosis.residuals import ResidualTests, residual_tests
from sysid.estimation.free_run import (
    PREDICT,
    REMEDY,
    FreeRun,
    autoregression,
    divergence,
    forecast,
    free_run,
    initial_theta,
    quiet,
    run_from_rest,
)
from sysid.estimation.origin import FREE_RUN, ONE_STEP, FitMethods, Origin, check_channels, check_same_kind
from sysid.estimation.prior import Prior
from sysid.model.chain import Chain
from sysid.model.tangents import Rational, tangent
from sysid.solver.covariance import Covariance, pole_std
from sysid.solver.iterate import Stop


@dataclass(frozen=True)
class Parameter:
    """One parameter of a fit; std is None if it is fixed or if the data do not determine it."""

    name: str
    value: float
    std: float | None
    unit: str
    free: bool
    lower: float
    upper: float


@dataclass(frozen=True, repr=False)
class Fit(FitMethods):
    """An identified chain: theta (P,), criteria on the estimation record, covariance, and why the search stopped.

    `u_offset` (nu,) and `y_offset` (ny,) are what was removed from the estimation data (`IOData.u_offset`, `y_offset`).
    A record runs at absolute levels: its u + u_offset is what drives the model, whatever was removed from it, and the
    output comes back at the level of the record. So a fit to mean-free data runs on a raw record. An array u has no
    level: it is counted from the fit's own `u_offset`, and its output from `y_offset`. Both are None if they are
    unknown, in a file that an earlier version saved; such a fit takes every record as it is.
    """

    model: Chain
    theta: np.ndarray
    Ts: float
    criteria: Criteria
    covariance: Covariance
    stop: Stop
    history: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]
    losses: tuple[float, ...]  # of every start, to show an optimum that only one start reaches
    seconds: float
    search: str
    n_init: int
    u_span: tuple[float, float] = field(default=(0.0, 0.0))  # ranges of input and output in the estimation data
    y_span: tuple[float, float] = field(default=(0.0, 0.0))
    members: tuple[str, ...] = ()  # where each start of the portfolio came from
    agreed: int = 0  # independent starts of the portfolio that came to this optimum
    u_offset: np.ndarray | None = None  # [u] removed from the estimation data; None: not known
    y_offset: np.ndarray | None = None
    origin: Origin | None = None  # names, units and fit of the estimation data; None in a file of an earlier version
    noise: tuple[tuple[float, ...], ...] | None = None  # autoregression of each output's residuals there, for `predict`
    prior: Prior | None = None  # what was known beside the record, see `Objective.prior`
    smoothing: np.ndarray | None = None  # (k,) deviation of the noise by that of the prior of each change of slope

    @checked
    def simulate(self, data: IOData | np.ndarray, n_init: int | None = None) -> np.ndarray:
        """Free run: (N,) for one output, else (N, ny). For a record, the initial state of each experiment is fitted to
        its first `n_init` outputs, and the result is at the level of the record, see `own_level`; for u alone (N,) or
        (N, nu), counted from `u_offset`, the run starts from rest: filters and speeds at zero, positions where the fit
        has them. Infinite after the run diverges, see `divergence`.
        """
        if isinstance(data, IOData):
            levelled = self.own_level(data)
            y = restore_offsets(np.concatenate([self._run(e, n_init).y for e in levelled.experiments]), levelled, data)
        else:
            u = np.asarray(data, dtype=float)
            y = run_from_rest(self.model, self.theta, u)
        return y[:, 0] if self.model.channels[1] == 1 else y

    @checked(deferred=("horizon",))
    @quiet()
    def predict(self, data: IOData, horizon: int = 1, n_init: int | None = None) -> np.ndarray:
        """Each output from the measured ones up to `horizon` samples before it: (N,) for one output, else (N, ny).

        The free run plus the forecast of its residuals by their autoregression in the estimation data (`noise`; for
        a fit in a file of an earlier version, in this record), see `sysid.estimation.free_run`. With white residuals it
        is the free run. A model that `predicts` has its own state estimator instead. Raises InputError for a horizon
        below 1.
        """
        check_horizon(horizon)
        levelled, predictions = self.own_level(data), []
        if self.predicts:
            ahead = np.concatenate([self._ahead(e, horizon, n_init) for e in levelled.experiments])
            return restore_offsets(ahead, levelled, data)[:, 0]
        runs = [self._run(experiment, n_init).y for experiment in levelled.experiments]
        residuals = np.where(levelled.observed, levelled.y - np.concatenate(runs), 0.0)
        noise = self.noise or [autoregression(residual, levelled.lengths) for residual in residuals.T]
        for experiment, run in zip(levelled.experiments, runs, strict=True):
            columns = zip((experiment.y - run).T, noise, experiment.observed.T, strict=True)
            forecasts = [forecast(residual, a, horizon, observed) for residual, a, observed in columns]
            predictions.append(run + np.column_stack(forecasts))
        y = restore_offsets(np.concatenate(predictions), levelled, data)
        return y[:, 0] if self.model.channels[1] == 1 else y

    @checked
    def own_level(self, data: IOData) -> IOData:
        """The record counted from the offsets of the estimation data; the same one if it is, or if they are unknown.

        Raises InputError for a record of another sampling time, in other units or with other channels.
        """
        self._same_kind(data)
        return with_offsets(data, self.u_offset, self.y_offset)

    @checked
    def fit_percent(self, data: IOData, n_init: int | None = None) -> float:
        """Free-run fit [%] on a record; the first n_init samples give the initial state and are not scored.

        For several outputs it is their mean, see `fit_percents`.
        """
        return float(np.mean(self.fit_percents(data, n_init)))

    @checked
    def fit_percents(self, data: IOData, n_init: int | None = None) -> np.ndarray:
        """Free-run fit [%] of each output (ny,)."""
        return self._percents(data, n_init)

    @property
    def predicts(self) -> bool:
        """Whether the model is fitted to predictions one step ahead, from measured outputs, not to its free run."""
        return self.model.predicts

    @property
    def remedy(self) -> str:
        """What to do where a run diverges."""
        return f"{PREDICT}, or {REMEDY}" if self.predicts else REMEDY

    @property
    def criteria_of(self) -> str:
        """Which errors `criteria`, `covariance` and `residuals` refer to: 'free run', or 'one step ahead'."""
        return ONE_STEP if self.predicts else FREE_RUN

    @checked
    def prediction_percent(self, data: IOData, n_init: int | None = None, horizon: int = 1) -> float:
        """Fit [%] of `predict`, on the samples that `fit_percent` scores.

        One step ahead it is near 100 for any smooth, finely sampled y; never compare it with a free run.
        """
        return float(np.mean(self._percents(data, n_init, horizon)))

    @checked
    def residuals(self, data: IOData) -> np.ndarray:
        """e = y - yhat of the kind `criteria_of`, without each experiment's first n_init samples.

        (M,) for one output, else (M, ny). A missing sample has the residual 0.
        """
        y, yhat, mask = self._scored_samples(data, None, 1 if self.predicts else 0)
        e = np.where(mask, y - yhat, 0.0)
        return e[:, 0] if e.shape[1] == 1 else e

    @checked
    def residual_tests(self, data: IOData, max_lag: int = 25, level: float = 0.99) -> ResidualTests:
        """Whiteness of `residuals` on a record of one input and output, and their independence of the input."""
        siso(data)
        u = np.concatenate([e.u[self._initial_samples(e, None) :, 0] for e in self.own_level(data).experiments])
        e = self.residuals(data)
        if not np.all(np.isfinite(e)):
            raise InputError(f"no residuals to test: {self.divergence(data)}")
        return residual_tests(e, u, max_lag, level, past=self.predicts)

    @checked
    def divergence(self, data: IOData, n_init: int | None = None) -> str | None:
        """A sentence if the free run on this record diverges, from every initial state or from the likely one only.

        The former run is infinite from there on. In the latter case `simulate` begins at another state. Else None.
        """
        return divergence(self.runs(data, n_init), self.remedy)

    @checked
    def runs(self, data: IOData, n_init: int | None = None) -> list[FreeRun]:
        """The free run of each experiment, counted from the fit's own offsets."""
        return [self._run(e, n_init) for e in self.own_level(data).experiments]

    @property
    def poles(self) -> np.ndarray:
        """Poles in z, complex: of the linear block (nf,), or of several blocks in order; of a state space, those of its
        tangent with the input at its centre.
        """
        if self._around_centre is not None:
            return np.roots(self._around_centre.F).astype(complex)
        return np.concatenate([np.empty(0), *(b.poles(self.theta[part]) for part, b in self.model.dynamics)])

    @property
    def zeros(self) -> np.ndarray:
        """Finite zeros in z, complex, in the order of `poles`."""
        if self._around_centre is not None:
            return np.roots(self._around_centre.B).astype(complex)
        return np.concatenate([np.empty(0), *(b.zeros(self.theta[part]) for part, b in self.model.dynamics)])

    @cached_property
    def pole_std(self) -> np.ndarray:
        """Standard deviation of each pole; nan if the data do not determine it, and of a pole on the unit circle."""
        deviations = [np.empty(0)]
        if self._around_centre is not None:
            F, G = self._around_centre.F, self._around_centre.F_gradient[1:]
            return pole_std(F[1:], G @ self.covariance.cov @ G.T)
        for part, b in self.model.dynamics:
            f = slice(part.start + b.nb, part.start + b.nb + b.nf)
            held = bool((self.covariance.bounded | self.covariance.unidentifiable)[f].any())
            deviations.append(pole_std(self.theta[f], self.covariance.cov[f, f], held))
        return np.concatenate(deviations)

    @property
    def settles(self) -> bool:
        """Whether all poles are inside the unit circle by two standard deviations: else a free run adds up errors."""
        return bool(np.all(np.abs(self.poles) + 2.0 * np.nan_to_num(self.pole_std) < 1.0))

    @cached_property
    def _around_centre(self) -> Rational | None:
        """The tangent of a process, or of a chain that begins with a state space of one channel.

        None for other chains, and where the input's centre gives no steady state.
        """
        first = self.model.blocks[0]
        is_space = isinstance(first, StateSpace) and first.channels == (1, 1)
        if not is_space and not any(isinstance(b, Process) for b in self.model.blocks):
            return None
        try:
            return tangent(
                self.model, self.theta, float(first.scales()[0][0]) if isinstance(first, StateSpace) else 0.0
            )
        except InputError:
            return None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters with value, standard deviation, unit and bounds."""
        std = self.covariance.std()
        rows = zip(self.model.names, self.model.slots, self.theta, std, self.model.free, strict=True)
        return tuple(
            Parameter(
                n, float(v), float(s) if f and np.isfinite(s) else None, slot.unit, bool(f), slot.lower, slot.upper
            )
            for n, slot, v, s, f in rows
        )

    @checked
    def curve(self, role: str, x: np.ndarray) -> np.ndarray | None:
        """The static map with this role ('input' or 'output') at x (N,); None if the chain has no such map."""
        block = self.model.block(role)
        if block is None or block.n_parameters == 0:
            return None
        if x.ndim != 1:
            raise InputError(f"x is {short_text(x)}; give the places of the curve as one row of numbers")
        return block.output(self.model.part(self.theta, block), x)

    @checked
    def save(self, path: str | PathLike) -> Path:
        """Write the fit as readable JSON; `sysid.load` reads it again."""
        from sysid.estimation.codec import save

        return save(self, path)

    def summary(self) -> dict[str, Any]:
        """A summary ready for JSON: values that are not finite become None."""
        poles = [
            {"re": z.real, "im": z.imag, "std": s}
            for z, s in zip(self.poles.tolist(), self.pole_std.tolist(), strict=True)
        ]
        return json_value(
            {
                "structure": self.model.structure,
                "search": self.search,
                "criteria": self.criteria.as_dict(),
                **({"criteria_of": self.criteria_of} if self.predicts else {}),
                "poles": poles,
                "zeros": [{"re": z.real, "im": z.imag} for z in self.zeros.tolist()],
                "parameters": [vars(p) for p in self.parameters],
                "stop": vars(self.stop),
                "starts": {"losses": list(self.losses), "members": list(self.members), "agreed": self.agreed},
                "warnings": list(self.warnings),
                "seconds": self.seconds,
            }
        )

    def _run(self, data: IOData, n_init: int | None) -> FreeRun:
        n = min(self.n_init if n_init is None else n_init, data.N)
        # In the unit of y, also for weighted errors; errors that the fit took for outliers make it cautious.
        c = self.criteria
        mse = c.mse if np.isfinite(c.mse) else c.loss  # a file may lack the one; for most fits they are equal
        if n >= 2 and not np.isfinite(mse):
            raise InputError("the model has neither mse nor loss, which give the initial state; fit it again")
        with one_blas_thread():
            return free_run(self.model, self.theta, data, n, mse * c.N / max(c.N - c.d, 1))

    @quiet()
    def _ahead(self, data: IOData, horizon: int, n_init: int | None) -> np.ndarray:
        """y(t | t-horizon) (N, 1) of a model that predicts, on one experiment at own level."""
        model, block = self.model, self.model.blocks[-1]
        assert isinstance(block, Predictor)
        check_complete(data)
        first = data.select(0, min(self.n_init if n_init is None else n_init, data.N))
        theta = initial_theta(model, self.theta, first) if first.N >= 2 else self.theta
        w = model.through(theta, data.u[:, 0], 0, len(model.blocks) - 1)
        return block.ahead(model.part(theta, block), w, data.y[:, 0], horizon)[:, None]

    def _percents(self, data: IOData, n_init: int | None, horizon: int = 0) -> np.ndarray:
        """Fit [%] of each output (ny,) of the free run, or of the prediction over a `horizon`."""
        y, yhat, mask = self._scored_samples(data, n_init, horizon)
        scored = [e.N - self._initial_samples(e, n_init) for e in data.experiments]
        numbers = np.repeat(np.arange(len(scored)), scored)
        return np.array([fit_percent(a[k], b[k], numbers[k]) for a, b, k in zip(y.T, yhat.T, mask.T, strict=True)])

    def _scored_samples(
        self, data: IOData, n_init: int | None, horizon: int = 0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y, yhat and the mask of scored samples (M, ny), each experiment without its first n_init, at own level.

        yhat is the free run, or with a `horizon` the prediction.
        """
        y, yhat, counts = [], [], []
        for e in self.own_level(data).experiments:
            n = self._initial_samples(e, n_init)
            y.append(e.y[n:])
            ahead = self.predict(e, horizon, n).reshape(e.N, -1) if horizon else self._run(e, n).y
            yhat.append(ahead[n:])
            counts.append(e.observed[n:])
        return np.concatenate(y), np.concatenate(yhat), np.concatenate(counts)

    def _initial_samples(self, data: IOData, n_init: int | None) -> int:
        n = self.n_init if n_init is None else n_init
        if n + 2 > data.N:
            raise InputError(
                f"the record has {data.N} samples and {n} of them give the initial state; give a longer one"
            )
        return n

    def _same_kind(self, data: IOData) -> None:
        check_same_kind(data, self.Ts, self.origin)
        check_channels(self.model, data)


def check_complete(data: IOData) -> None:
    """Raises InputError for a record with missing outputs, which a state estimator cannot go on from."""
    if not data.observed.all():
        raise InputError(
            f"{int((~data.observed).sum())} outputs are missing, and this model predicts each from all before it; "
            "split the record there and merge the parts (IOData.merge), or choose output_error"
        )


def check_horizon(horizon: int) -> None:
    """Raises InputError unless the horizon is a whole number of samples of at least 1."""
    if not isinstance(horizon, (int, np.integer)) or horizon < 1:
        raise InputError(f"the horizon is {horizon!r}; give a whole number of samples of at least 1")
