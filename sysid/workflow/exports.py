"""A fitted model as files: to load again, to compile, to import."""

from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

from sysid.base.errors import InputError
from sysid.base.units import percent
from sysid.diagnosis.residuals import poor
from sysid.estimation.result import Fit
from sysid.export import c as export_c
from sysid.export import python as export_python
from sysid.nlarx.dispatch import save
from sysid.nlarx.result import NlarxFit
from sysid.workflow.evaluation import Evaluation
from sysid.workflow.gain_sign import WRONG

SAVED = ("model.json", "the fit for sysid.load, qpal run and qpal export; it runs on raw records")


@dataclass(frozen=True)
class Exports:
    """Names and contents of the files, and why others are missing."""

    files: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def export(evaluation: Evaluation, folder: Path) -> Exports:
    """model.json, model.c and model.py in `folder`; the last two use the levels of the record, means included."""
    fit = _as_told(evaluation)
    try:
        save(fit, folder / "model.json")
        export_c.write(fit, folder / "model.c")
        export_python.write(fit, folder / "model.py")
    except InputError as error:
        return Exports(notes=(f"no model files: {error}",))
    return Exports(
        (
            SAVED,
            ("model.c", "C99 with a state and a step function, on the scales of the recorded input and output"),
            ("model.py", "the same in Python; imports only math"),
        ),
        ()
        if fit.u_offset is not None
        else ("model.c and model.py take signals that are prepared as those of the fit: no offset undoes that",),
    )


UNFIT = "do NOT use this model: "  # a warning of a saved fit that begins so is repeated wherever it is used


def _as_told(evaluation: Evaluation) -> Fit | NlarxFit:
    """The fit with what was said of it: the percentage, so that `qpal run` repeats it to the last digit, and a warning.

    The record does not travel with the file; whoever takes the model from there would not know.
    """
    fit, told = evaluation.fit, evaluation.estimation_fit
    why = (
        [f"the free run fits the validation data to {percent(evaluation.validation_fit)}"]
        if poor(evaluation.validation_fit, evaluation.tests)
        else []
    )
    why += [note for note in evaluation.notes if WRONG in note and note not in fit.warnings]
    if why:
        fit = replace(fit, warnings=(f"{UNFIT}{'; '.join(why)}", *fit.warnings))
    if fit.origin is None or not isfinite(told):
        return fit
    return replace(fit, origin=replace(fit.origin, fit=told))
