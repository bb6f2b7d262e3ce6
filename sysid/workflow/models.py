"""Several saved models on one record, as in `qpal models`: free runs, a table, and which one is best."""

from dataclasses import dataclass
from typing import Any

from sysid.base.errors import InputError
from sysid.base.versions import versions
from sysid.nlarx.result import NlarxFit
from sysid.workflow.model_run import ModelRun, on_record
from sysid.workflow.record import Record
from sysid.workflow.saved import Reading, data_for, load_models

CLOSE = 0.5  # points of fit within which a smaller model is as good


@dataclass(frozen=True)
class Models:
    """Runs of several models on one record, from the best free run to the worst."""

    record: Record
    runs: tuple[ModelRun, ...]
    notes: tuple[str, ...]

    @property
    def best(self) -> ModelRun:
        """The model with the best free run."""
        return self.runs[0]

    @property
    def smaller(self) -> ModelRun | None:
        """The smallest model that is as good as the best one, within CLOSE points; None if that is the best one."""
        near = [run for run in self.runs if run.percent >= self.best.percent - CLOSE]
        least = min(near, key=lambda run: run.model.fit.criteria.d)
        return None if least.model.fit.criteria.d >= self.best.model.fit.criteria.d else least

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal models`, ready for JSON."""
        return {
            "read": self.record.as_dict(),
            "best": self.best.model.name,
            "models": [
                {
                    "name": run.model.name,
                    **run.model.as_dict(),
                    "fit_percent": run.percent,
                    "outputs": list(run.percents),
                    "criteria": run.model.fit.criteria.as_dict(),
                    "criteria_of": criteria_of(run),
                    "notes": list(run.notes),
                }
                for run in self.runs
            ],
            "notes": list(self.notes),
            "next": vars(self.best.next) if self.best.next else None,
            "versions": versions(),
        }


def run_models(paths: list[str], reading: Reading) -> Models:
    """Every model saved at `paths` on the record; a model of another sampling time gets a resampled one if asked for.

    Raises InputError where a model and the record do not belong together.
    """
    saved = load_models(paths)
    record = reading.record()
    runs, common = [], tuple(record.notes)
    for model in saved:
        try:
            data, notes = data_for(model.fit, record, reading)
            runs.append(on_record(model, record, data, notes, reading))
        except InputError as error:
            raise InputError(f"{model.path}: {error}") from None
    runs.sort(key=lambda run: (-run.percent, run.model.fit.criteria.d))
    for run in runs:
        common = tuple(note for note in common if note in run.notes)
    return Models(record, tuple(runs), common)


def criteria_of(run: ModelRun) -> str:
    """Which errors the criteria of the model's file refer to; those of two kinds are not comparable."""
    return run.model.fit.criteria_of if isinstance(run.model.fit, NlarxFit) else "free run"


def comparable(result: Models) -> bool:
    """Whether FPE and AIC of all models refer to errors of one kind on records of one length and unit."""
    kinds = {(criteria_of(run), run.model.fit.criteria.N, run.model.fit.Ts, _unit(run)) for run in result.runs}
    return len(kinds) == 1


def _unit(run: ModelRun) -> str:
    origin = run.model.fit.origin
    return "" if origin is None else origin.y_unit
