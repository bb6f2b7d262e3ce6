"""Saved models on a new record: free run, prediction some samples ahead, a table of several, and which is best."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.base.files import versions, write_text
from sysid.data.record import IOData
from sysid.diagnosis.residuals import CLOSE, UNTESTED, ResidualTests, poor
from sysid.estimation.free_run import beyond, quiet
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit
from sysid.workflow.input_run import InputRun, record_of_inputs, run_inputs
from sysid.workflow.record import Record
from sysid.workflow.results import Growing
from sysid.workflow.saved import AnyFit, Reading, Saved, data_for, fell, load_models, remarks, unfit
from sysid.workflow.steps import NextStep

HALF = 50.0  # [%] of fit, from which a free run follows a record

SAME = 1.0  # [%] between the fit of a free run and that of the same run from estimated initial states


@dataclass(frozen=True)
class Prediction:
    """Prediction `horizon` samples ahead: output (N, ny), its fit [%] and error (RMS) of each output, and the fit of
    holding the last output.

    `held` is the fit of y(t - horizon) itself: a prediction that is no better knows nothing.
    """

    horizon: int
    output: np.ndarray
    percents: tuple[float, ...]
    held: tuple[float, ...]
    rmse: tuple[float, ...]


@dataclass(frozen=True)
class ModelRun:
    """A model's free run (N, ny) on `data`, scored after the first `n_init` samples; `percents` one for each output.

    `growth` is the prediction that judges a model that does not settle, whose free run adds up all errors; None of
    others.
    """

    model: Saved
    record: Record
    data: IOData
    output: np.ndarray
    percents: tuple[float, ...]
    rmse: tuple[float, ...]
    n_init: int
    ahead: Prediction | None
    tests: ResidualTests | None
    notes: tuple[str, ...]
    next: NextStep | None = None
    growth: Growing | None = None

    @property
    def percent(self) -> float:
        """Mean fit [%] over the outputs."""
        return float(np.mean(self.percents))

    @property
    def judged_fit(self) -> float:
        """The fit [%] that a judgement takes: of the free run, or of the prediction where there is a `growth`."""
        return self.percent if self.growth is None else self.growth.fit

    @property
    def judged(self) -> str:
        """What `judged_fit` is the fit of, in words."""
        return "free run" if self.growth is None else f"prediction {self.growth.ahead}"

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal run`, ready for JSON."""
        summary = {
            "model": self.model.as_dict(),
            "read": self.record.as_dict(),
            "fit_percent": {"free_run": self.percent, "outputs": list(self.percents), "judged": self.judged_fit},
            "rmse": list(self.rmse),
            "not_scored": self.n_init,
            "residuals": self.tests.as_dict() if self.tests else None,
            "notes": list(self.notes),
            "next": self.next.as_dict() if self.next else None,
            "versions": versions(),
        }
        if self.ahead is not None:
            summary["prediction"] = {
                "horizon": self.ahead.horizon,
                "fit_percent": float(np.mean(self.ahead.percents)),
                "outputs": list(self.ahead.percents),
                "fit_percent_of_the_last_output_held": float(np.mean(self.ahead.held)),
            }
        return summary


def run_file(
    model: str, reading: Reading, horizon: int | None = None, running: Callable[[], None] = lambda: None
) -> ModelRun | InputRun:
    """The model saved at `model` on a record, with the prediction `horizon` samples ahead if that is given.

    A file with inputs alone gives the run from rest.

    Raises InputError for files that cannot be read, do not belong together, or are too short.
    """
    if horizon is not None and horizon < 1:
        raise InputError(f"--horizon is {horizon}; give a number of samples of at least 1")
    (model_file,) = load_models([model])
    reading, table = reading.named_by([model_file.fit])
    try:
        record = reading.record(table)
    except InputError:
        inputs = record_of_inputs(model_file.fit, reading, table)
        if inputs is None:
            raise
        running()
        return run_inputs(model_file, inputs, reading, horizon)
    del table  # a long record has no room beside it
    data, notes = data_for(model_file.fit, record, reading)
    running()
    return on_record(model_file, record, data, notes, reading, horizon)


@quiet()
def on_record(
    saved: Saved,
    record: Record,
    data: IOData,
    notes: tuple[str, ...],
    reading: Reading,
    horizon: int | None = None,
    compared: bool = False,
) -> ModelRun:
    """Free run and prediction on `data`, which `data_for` gave; models that are `compared` are judged by free runs, or
    by their predictions `horizon` ahead.
    """
    from sysid.workflow.evaluation import growth

    fit = saved.fit
    growing = growth(fit, data) if isinstance(fit, Fit) and fit.predicts and not compared else None
    horizon = growing.horizon if growing is not None and horizon is None else horizon
    n = fit.n_init
    counts = scored(data, n)
    y = fit.simulate(data).reshape(data.y.shape)
    percents = _percents(data, y, counts)
    by_run = growing is None and not (compared and horizon is not None)
    tests, sentences = None, [*notes, *remarks(fit, data, y, counts=by_run)]
    try:
        tests = _tests(fit, data)
    except InputError as error:
        sentences.append(f"{UNTESTED}{error}")
    fall = None if not by_run else fell(saved.estimation, float(np.mean(percents)))
    sentences += [fall] if fall else []
    prediction = None if horizon is None else _predict_ahead(saved, data, counts, horizon)
    if prediction is not None and (gone := beyond(prediction.output, fit.remedy, f"the prediction {horizon} ahead")):
        sentences.append(gone)
    if compared and prediction is not None:
        growing = Growing(prediction.horizon, float(np.mean(prediction.percents)))
    result = ModelRun(
        saved, record, data, y, percents, _rmse(data, y, counts), n, prediction, tests, tuple(sentences), growth=growing
    )
    return ModelRun(**{**vars(result), "next": _next(result, reading)})


def _tests(fit: AnyFit, data: IOData) -> ResidualTests:
    """The tests of the residuals; of several inputs or outputs the worst count."""
    if isinstance(fit, NlarxFit) or fit.model.channels == (1, 1):
        return fit.residual_tests(data)
    from sysid.workflow.evaluation import tests_of_outputs, worst_tests

    return worst_tests(tests_of_outputs(fit, data))


def scored(data: IOData, n: int) -> np.ndarray:
    """True (N, ny) for measured outputs after the first n samples of each experiment.

    Raises InputError where an experiment has none.
    """
    if min(data.lengths) < n + 2:
        raise InputError(
            f"the record has {min(data.lengths)} samples and {n} of them give the initial state; give a longer one"
        )
    after_start = np.concatenate([np.arange(k) >= n for k in data.lengths])
    return np.asarray(after_start[:, None] & data.observed)


def rms(e: np.ndarray) -> float:
    """Root mean square (n,); infinite where a run diverges."""
    with quiet():
        return float(np.sqrt(np.mean(e**2))) if np.all(np.isfinite(e)) else np.inf


def write_outputs(result: ModelRun | InputRun, path: Any) -> None:
    """The record and the model's outputs as a table: time [s], inputs, measured if any, free run, prediction."""
    data = result.data
    columns: dict[str, np.ndarray] = {"time_s": data.t}
    columns |= _columns_of(data.u, data.u_name or "u", data.u_unit)
    if isinstance(result, ModelRun):
        columns |= _columns_of(data.y, data.y_name or "y", data.y_unit)
    columns |= _columns_of(result.output, data.y_name or "y", data.y_unit, "_free_run")
    if isinstance(result, ModelRun) and result.ahead is not None:
        columns |= _columns_of(result.ahead.output, data.y_name or "y", data.y_unit, f"_ahead_{result.ahead.horizon}")
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    text = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    write_text(path, "\n".join(text) + "\n")


def _columns_of(values: np.ndarray, name: str, unit: str, suffix: str = "") -> dict[str, np.ndarray]:
    end = suffix + (f"_{unit}" if unit.isalpha() else "")
    many = values.shape[1] > 1
    return {f"{name}{j + 1 if many else ''}{end}": column for j, column in enumerate(values.T)}


def _percents(data: IOData, y: np.ndarray, counts: np.ndarray) -> tuple[float, ...]:
    percents = []
    numbers = data.experiment_numbers
    for measured, run, k in zip(data.y.T, y.T, counts.T, strict=True):
        if np.ptp(measured[k]) == 0.0:
            raise InputError("the output does not move in the scored part of the record, so a fit says nothing")
        percents.append(fit_percent(measured[k], run[k], numbers[k]) if np.all(np.isfinite(run[k])) else -np.inf)
    return tuple(percents)


def _rmse(data: IOData, y: np.ndarray, counts: np.ndarray) -> tuple[float, ...]:
    return tuple(rms(column[k]) for column, k in zip((data.y - y).T, counts.T, strict=True))


def _predict_ahead(saved: Saved, data: IOData, counts: np.ndarray, horizon: int) -> Prediction:
    y = saved.fit.predict(data, horizon).reshape(data.y.shape)
    starts = np.repeat(np.cumsum(data.lengths) - data.lengths, data.lengths)
    held = data.y[np.maximum(np.arange(data.N) - horizon, starts)]
    return Prediction(horizon, y, _percents(data, y, counts), _percents(data, held, counts), _rmse(data, y, counts))


def _next(result: ModelRun, reading: Reading) -> NextStep | None:
    """A fit to this record, where the model does not follow it: of the same structure, if that followed its own."""
    if not poor(result.judged_fit, result.tests) or (result.growth is not None and not result.growth.misses):
        return None
    structure = result.model.fit.model.structure
    words = ["qpal", "identify", reading.path, *result.record.options]
    from sysid.structures import TABLE, NonlinearStateSpace

    is_its_own = _is_its_own(result)
    if is_its_own or unfit(result.model.fit):
        is_single = result.data.u.shape[1] == result.data.y.shape[1] == 1  # as a search needs
        other = "auto" if is_single else NonlinearStateSpace.name
        reason = "this model was fitted to this record and does not follow it"
        reason = reason if is_its_own else "this model did not follow its own record and does not follow this one"
        return NextStep(f"{reason}; search for another structure", shlex.join([*words, "--structure", other]))
    if structure in TABLE:
        words += ["--structure", structure]
    kind = "network" if isinstance(result.model.fit, NlarxFit) else "model"
    return NextStep(f"this {kind} does not follow the record; fit one to it", shlex.join(words))


def _is_its_own(result: ModelRun) -> bool:
    """Whether the record is the one that the model was fitted to, at its beginning or as a whole.

    Then names, units and the fit of the free run there are those that the file of the model holds.
    """
    origin, data = result.model.fit.origin, result.data
    if origin is None or not result.n_init < origin.samples <= data.N:
        return False
    names = (data.u_name, data.y_name, data.u_unit, data.y_unit)
    if names != (origin.u_name, origin.y_name, origin.u_unit, origin.y_unit):
        return False
    counts = data.observed.copy()
    counts[origin.samples :] = False
    try:
        return abs(float(np.mean(_percents(data, result.output, counts))) - origin.fit) < SAME
    except InputError:  # an output that does not move there
        return False


@dataclass(frozen=True)
class Models:
    """Runs of several models on one record, from the best to the worst: by free runs, or all by predictions as far
    ahead where the plant does not settle, so that no free run follows it.
    """

    record: Record
    runs: tuple[ModelRun, ...]
    notes: tuple[str, ...]

    @property
    def best(self) -> ModelRun:
        """The model that explains most."""
        return self.runs[0]

    @property
    def smaller(self) -> ModelRun | None:
        """The smallest model that is as good as the best one, within CLOSE points; None if that is the best one."""
        close_runs = [run for run in self.runs if run.judged_fit >= self.best.judged_fit - CLOSE]
        least = min(close_runs, key=lambda run: run.model.fit.criteria.d)
        return None if least.model.fit.criteria.d >= self.best.model.fit.criteria.d else least

    def as_dict(self) -> dict[str, Any]:
        """The summary of several models, ready for JSON."""
        return {
            "read": self.record.as_dict(),
            "best": self.best.model.name,
            "models": [
                {
                    "name": run.model.name,
                    **run.model.as_dict(),
                    "fit_percent": run.percent,
                    "outputs": list(run.percents),
                    "judged": run.judged_fit,
                    "criteria": run.model.fit.criteria.as_dict(),
                    "criteria_of": criteria_of(run),
                    "notes": list(run.notes),
                }
                for run in self.runs
            ],
            "notes": list(self.notes),
            "next": self.best.next.as_dict() if self.best.next else None,
            "versions": versions(),
        }


def run_models(paths: list[str], reading: Reading) -> Models:
    """Every model saved at `paths` on the record; a model of another sampling time gets a resampled one if asked for.

    Raises InputError where a model and the record do not belong together.
    """
    saved = load_models(paths)
    named, table = reading.named_by([model.fit for model in saved])
    record = named.record(table)
    del table  # a long record has no room beside it
    common = tuple(record.notes)

    def on_all(horizon: int | None) -> list[ModelRun]:
        runs = []
        for model in saved:
            try:
                data, notes = data_for(model.fit, record, reading)
                runs.append(on_record(model, record, data, notes, reading, horizon, compared=True))
            except InputError as error:
                raise InputError(f"{model.path}: {error}") from None
        return runs

    runs = on_all(None)
    horizon = _common_horizon(runs)
    runs = runs if horizon is None else on_all(horizon)
    runs.sort(key=lambda run: (-run.judged_fit, run.model.fit.criteria.d))
    for run in runs:
        common = tuple(note for note in common if note in run.notes)
    return Models(record, tuple(runs), common)


def _common_horizon(runs: list[ModelRun]) -> int | None:
    """Samples ahead by which models of a plant that does not settle are compared: as far as each of those with an
    estimator may be judged. None where a free run explains half of the record, or no model is of such a plant.
    """
    from sysid.workflow.evaluation import growth

    if any(run.percent >= HALF for run in runs):
        return None
    known = [
        growth(run.model.fit, run.data) for run in runs if isinstance(run.model.fit, Fit) and run.model.fit.predicts
    ]
    return min((found.horizon for found in known if found is not None), default=None)


def criteria_of(run: ModelRun) -> str:
    """Which errors the criteria of the model's file refer to; those of two kinds are not comparable."""
    return run.model.fit.criteria_of


def comparable(result: Models) -> bool:
    """Whether FPE and AIC of all models refer to errors of one kind on records of one length and unit."""
    kinds = {(criteria_of(run), run.model.fit.criteria.N, run.model.fit.Ts, _unit(run)) for run in result.runs}
    return len(kinds) == 1


def _unit(run: ModelRun) -> str:
    origin = run.model.fit.origin
    return "" if origin is None else origin.y_unit
