"""A fitted model as files: to load again, to compile, to import."""

from dataclasses import dataclass
from pathlib import Path

from sysid.base.errors import InputError
from sysid.estimation.result import Fit
from sysid.estimation.saving import save
from sysid.export import c as export_c
from sysid.export import python as export_python
from sysid.workflow.evaluation import Evaluation

SAVED = ("model.json", "the fit for sysid.load, on the scale of the preprocessed data")


@dataclass(frozen=True)
class Exports:
    """Names and contents of the files, and why others are missing."""

    files: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def export(evaluation: Evaluation, folder: Path) -> Exports:
    """model.json, model.c and model.py in `folder`; the last two use the scale of the record, means included.

    A nonlinear ARX model has no such files yet; `notes` says so.
    """
    fit, data = evaluation.fit, evaluation.estimation
    if not isinstance(fit, Fit):
        return Exports(notes=("a nonlinear ARX model cannot be saved or exported yet: no model files were written",))
    u0, y0 = data.u_offset, data.y_offset
    try:
        save(fit, folder / "model.json")
        export_c.write(fit, folder / "model.c", u_offset=u0, y_offset=y0)
        export_python.write(fit, folder / "model.py", u_offset=u0, y_offset=y0)
    except InputError as error:
        return Exports(notes=(f"no model files: {error}",))
    return Exports(
        (
            SAVED,
            ("model.c", "C99 with a state and a step function, on the scales of the recorded input and output"),
            ("model.py", "the same in Python; imports only math"),
        )
    )
