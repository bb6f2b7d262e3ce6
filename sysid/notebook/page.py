"""The page of `qpal identify` for a fit that was made in Python."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from sysid.base.files import write_text
from sysid.channels.mapping import ChannelMap
from sysid.channels.signals import Signals
from sysid.data.record import IOData, siso
from sysid.diagnosis.advice import advise
from sysid.diagnosis.residuals import poor
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit
from sysid.notebook.words import recipe_of
from sysid.report.identify import page
from sysid.workflow.evaluation import check_parts, evaluate_fit
from sysid.workflow.plan import Plan
from sysid.workflow.record import Record
from sysid.workflow.results import Evaluation, Identification, NextStep
from sysid.workflow.saved import Exports
from sysid.workflow.setting import Setting

NO_VALIDATION = (
    "no validation record was given, so what is called validation here is the record of the fit itself and says "
    "nothing of new data; give one: fit.report(path, validation=other)"
)


def write_page(fit: Fit | NlarxFit, path: str | PathLike, data: IOData, validation: IOData | None) -> Path:
    """Writes the page of a fit on `data` and `validation` to `path`, whole or not at all; returns the path."""
    for each in (data, validation):
        if each is not None:
            siso(each)
    found = identified(fit, data, validation)
    what = replace(page(found, Exports()), title=f"Fit of {data.y_name} to {data.u_name}")
    return write_text(path, what.html())


def identified(fit: Fit | NlarxFit, data: IOData, validation: IOData | None) -> Identification:
    """The fit with everything that the page shows."""
    other = data if validation is None else validation
    check_parts(data, other)
    setting = Setting(recipe_of(fit), fit.search, max(len(fit.losses), 1))
    evaluation = evaluate_fit(setting, fit, data, other)
    notes: Sequence[str] = evaluation.notes if validation is not None else (NO_VALIDATION, *evaluation.notes)
    evaluation = replace(evaluation, notes=tuple(notes))
    place = Path("memory")
    record = Record(place, data, data.u_name, data.y_name, None, Signals(place, ChannelMap(), data.Ts, (), ()))
    return Identification(record, Plan(detrend="none"), evaluation, advise(data), next=_next(evaluation))


def _next(e: Evaluation) -> NextStep | None:
    """The call to try next after a poor fit; None after a good one."""
    if not e.fit.stop.converged:
        return NextStep("the search did not converge", "fit.refine(options=sysid.Options(max_iterations=500))")
    if not poor(e.validation_fit, e.tests):
        return None
    return NextStep("this structure does not explain the record", "sysid.select(data, seconds=120).fit")
