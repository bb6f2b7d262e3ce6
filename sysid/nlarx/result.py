"""NlarxFit: an identified nonlinear ARX model. Free run and one-step-ahead prediction are always separate."""

from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.criteria import Criteria, fit_percent
from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.data.record import IOData
from sysid.data.trends import restore_offsets, with_offsets
from sysid.diagnosis.residuals import ResidualTests, residual_tests
from sysid.estimation.free_run import PREDICT, beyond
from sysid.estimation.origin import FREE_RUN, FitMethods, Origin, check_same_kind
from sysid.estimation.result import Parameter, check_horizon
from sysid.nlarx.model import Network, Nlarx
from sysid.nlarx.problem import Piece
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Stop

FORMAT, VERSION = "sysid nlarx fit", 2  # version 1 stored no offsets and no origin: they stay unknown (None)
AWAY = 0.5  # spans of the estimation data's output beyond its range, which no model of the plant reaches


@dataclass(frozen=True)
class Choice:
    """One tried size: rms error on the held-back blocks, of the kind that the focus selects, and that of the free run;
    inf if diverged."""

    units: int
    ridge: float
    error: float
    free: float = 0.0


@dataclass(frozen=True, repr=False)
class NlarxFit(FitMethods):
    """An identified nonlinear ARX model: theta (P,) of `network`, and criteria on the estimation record.

    `criteria_of` says which errors `criteria`, `covariance` and `residuals` refer to: 'one step ahead' (the model uses
    all measured outputs up to the last sample) or 'free run' (it uses only inputs and its own past).

    `u_offset` (1,) and `y_offset` (1,) are what was removed from the estimation data, None if unknown. Records run at
    absolute levels and results come back at the level of the record, as in `sysid.Fit`.
    """

    model: Nlarx
    network: Network
    theta: np.ndarray
    Ts: float
    criteria: Criteria
    criteria_of: str
    covariance: Covariance
    stop: Stop
    history: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]
    losses: tuple[float, ...]
    seconds: float
    search: str
    n_init: int
    limit: float  # |yhat| beyond which a free run counts as diverged
    ridge: float = 0.0
    choice: tuple[Choice, ...] = ()  # how units='auto' was decided
    u_span: tuple[float, float] = field(default=(0.0, 0.0))  # ranges of input and output in the estimation data
    y_span: tuple[float, float] = field(default=(0.0, 0.0))
    u_offset: np.ndarray | None = None  # [u] removed from the estimation data; None: not known
    y_offset: np.ndarray | None = None
    origin: Origin | None = None  # names, units and fit of the estimation data; None in a file of an earlier version

    predicts = True
    remedy = f"use focus='simulation', fewer units or other orders, or {PREDICT}"

    @checked
    def own_level(self, data: IOData) -> IOData:
        """The record counted from the offsets of the estimation data; the same one if it is, or if they are unknown.

        Raises InputError for a record of another sampling time or in other units.
        """
        check_same_kind(data, self.Ts, self.origin)
        return with_offsets(data, self.u_offset, self.y_offset)

    @checked
    def simulate(self, data: IOData | np.ndarray, n_init: int | None = None) -> np.ndarray:
        """Free run (N,) from u and its own past. It uses the first `n_init` outputs (at least max(na, nb+nk-1)) of each
        experiment and returns them unchanged; for u (N,) alone it starts from rest, all earlier signals zero.

        Infinite after the run diverges, see `divergence`. An array u is counted from `u_offset`.
        """
        if isinstance(data, IOData):
            levelled = self.own_level(data)
            runs = [self._run(p.u, p.y, self._first(p, n_init))[0] for p in Piece.of(levelled)]
            return restore_offsets(np.concatenate(runs), levelled, data)
        u = np.asarray(data, dtype=float).ravel()
        lag = self.model.lag
        return self._run(np.concatenate([np.zeros(lag), u]), np.zeros(lag + len(u)), lag)[0][lag:]

    @checked(deferred=("horizon",))
    def predict(self, data: IOData, horizon: int = 1) -> np.ndarray:
        """Each output (N,) from the measured ones up to `horizon` samples before it, by default one step ahead.

        The first max(na, nb+nk-1) are y; the next horizon - 1 are predicted from these. Infinite where it diverges.
        Raises InputError for a horizon below 1.
        """
        check_horizon(horizon)
        levelled = self.own_level(data)
        return restore_offsets(
            np.concatenate([self._predict_steps(p, horizon) for p in Piece.of(levelled)]), levelled, data
        )

    def _predict_steps(self, p: Piece, horizon: int) -> np.ndarray:
        """y(t | t-horizon) (N,), from y(t | t-1), y(t | t-2) and so on in turn."""
        model, rows = self.model, np.arange(self.model.lag, len(p.y))
        predictions = [p.y]  # the k-th entry: y(t | t-k)
        for k in range(1, horizon + 1):
            past = [predictions[max(k - i, 0)][rows - i] for i in range(1, model.na + 1)]
            Phi = np.column_stack([*past, *(p.u[rows - model.nk - i] for i in range(model.nb))])
            yhat = p.y.copy()
            with np.errstate(over="ignore", invalid="ignore"):
                yhat[rows] = self.network.predict(self.theta, Phi)[0]
            yhat[~np.isfinite(yhat)] = np.inf
            yhat[: model.lag + k - 1] = predictions[-1][: model.lag + k - 1]
            predictions = [*predictions, yhat]
            predictions[: max(k - model.na, 0)] = [p.y[:0]] * max(k - model.na, 0)  # no longer needed
        return predictions[-1]

    @checked
    def fit_percent(self, data: IOData, n_init: int | None = None) -> float:
        """Free-run fit [%], the first n_init samples of each experiment are not scored; -inf if the run diverges."""
        data = self.own_level(data)
        counts = self._scored_samples(data, n_init)
        return fit_percent(data.y[counts, 0], self.simulate(data, n_init)[counts], data.experiment_numbers[counts])

    @checked
    def fit_percents(self, data: IOData, n_init: int | None = None) -> np.ndarray:
        """Free-run fit [%] of each output (1,), as a chain has it."""
        return np.array([self.fit_percent(data, n_init)])

    @checked
    def prediction_percent(self, data: IOData, n_init: int | None = None) -> float:
        """One-step fit [%]. It is near 100 for any smooth, finely sampled y and says little about the model."""
        data = self.own_level(data)
        counts = self._scored_samples(data, n_init)
        return fit_percent(data.y[counts, 0], self.predict(data)[counts], data.experiment_numbers[counts])

    @checked
    def divergence(self, data: IOData, n_init: int | None = None) -> str | None:
        """A sentence if the free run on this record diverges, else None."""
        for k, p in enumerate(self._pieces(data), 1):
            place = f" of experiment {k}" if len(data.lengths) > 1 else ""
            if sentence := beyond(self._run(p.u, p.y, self._first(p, n_init))[0], self.remedy, place=place):
                return sentence
        return None

    @checked
    def excursion(self, data: IOData, n_init: int | None = None) -> str | None:
        """A sentence if the free run on this record leaves the estimation data's range of outputs by far, else None.

        A network has no data there; its output may be anything.
        """
        data = self.own_level(data)
        low, high = self.y_span
        far = AWAY * max(high - low, 1e-300)
        run = self.simulate(data, n_init)
        beyond = np.maximum(low - run, run - high)
        if not np.max(beyond) > far:
            return None
        return (
            f"the free run leaves the range of the estimation data from sample {int(np.argmax(beyond > far))} on "
            f"(output {low:.4g} to {high:.4g}), where the network has no data; use focus='simulation', fewer units, or "
            "estimation data that cover these levels"
        )

    @checked
    def residuals(self, data: IOData) -> np.ndarray:
        """e = y - yhat of the kind `criteria_of`, without each experiment's first n_init samples and missing ones."""
        data = self.own_level(data)
        counts = self._scored_samples(data, None)
        yhat = self.simulate(data) if self.criteria_of == FREE_RUN else self.predict(data)
        return data.y[counts, 0] - yhat[counts]

    @checked
    def residual_tests(self, data: IOData, max_lag: int = 25, level: float = 0.99) -> ResidualTests:
        """Whiteness of the residuals (see `residuals`) and their independence of the input."""
        data = self.own_level(data)
        e = self.residuals(data)
        if not np.all(np.isfinite(e)):
            raise InputError(f"no residuals to test: {self.divergence(data)}")
        return residual_tests(e, data.u[self._scored_samples(data, None), 0], max_lag, level)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters with value and standard deviation; L.y1 has the unit of y per unit of y, L.u1 of y per u."""
        std = self.covariance.std()
        return tuple(
            Parameter(name, float(v), float(s) if np.isfinite(s) else None, "", True, -np.inf, np.inf)
            for name, v, s in zip(self.network.names, self.theta, std, strict=True)
        )

    @checked
    def save(self, path: str | PathLike) -> Path:
        """Write the fit as readable JSON; `sysid.load` reads it again."""
        from sysid.estimation.codec import write

        return write(self, self.network.names, {"format": FORMAT, "version": VERSION}, path)

    def summary(self) -> dict[str, Any]:
        """A summary ready for JSON: values that are not finite become None."""
        model = self.model
        return json_value(
            {
                "structure": model.structure,
                "orders": {"na": model.na, "nb": model.nb, "nk": model.nk},
                "focus": model.focus,
                "units": {"wavelets": self.network.wavelets, "scaling": self.network.scaling},
                "ridge": self.ridge,
                "choice": [vars(c) for c in self.choice],
                "search": self.search,
                "criteria": self.criteria.as_dict(),
                "criteria_of": self.criteria_of,
                "poles": [],  # a nonlinear ARX model has poles only at an operating point, see sysid.nlarx.linearize
                "zeros": [],
                "parameters": [vars(p) for p in self.parameters],
                "stop": vars(self.stop),
                "starts": {"losses": list(self.losses)},
                "warnings": list(self.warnings),
                "seconds": self.seconds,
            }
        )

    def _run(self, u: np.ndarray, y: np.ndarray, first: int) -> tuple[np.ndarray, int]:
        yhat, _, end = self.network.free_run(self.theta, u, y, first, self.limit)
        return yhat, end

    def _pieces(self, data: IOData) -> tuple[Piece, ...]:
        return Piece.of(self.own_level(data))

    def _first(self, piece: Piece, n_init: int | None) -> int:
        """Number of an experiment's samples that start a free run."""
        first = max(self.model.lag, self.n_init if n_init is None else n_init)
        if first + 2 > len(piece.y):
            raise InputError(
                f"an experiment has {len(piece.y)} samples and {first} of them start the free run; give a longer one"
            )
        return first

    def _scored_samples(self, data: IOData, n_init: int | None) -> np.ndarray:
        """True (N,) for the samples that count."""
        pieces = self._pieces(data)
        return np.concatenate([p.seen & (np.arange(len(p.y)) >= self._first(p, n_init)) for p in pieces])
