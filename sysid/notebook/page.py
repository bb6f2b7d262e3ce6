"""The page of `qpal identify` and the words for a fit that was made in Python, and figures for a person."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.base import style
from sysid.base.files import write_text
from sysid.base.looks import for_a_person
from sysid.base.quantities import display_quantity, number
from sysid.blocks import Channels, TransferFunction, TransferMatrix
from sysid.channels.mapping import ChannelMap
from sysid.channels.signals import Signals
from sysid.data.preprocess import retrend
from sysid.data.record import IOData, siso
from sysid.diagnosis.advice import advise
from sysid.diagnosis.residuals import poor
from sysid.estimation.result import Fit
from sysid.model.recipes import Option, Recipe
from sysid.nlarx.result import NlarxFit
from sysid.report.identify import page
from sysid.structures import TABLE
from sysid.workflow.evaluation import check_parts, evaluate_fit
from sysid.workflow.plan import Plan
from sysid.workflow.record import Record
from sysid.workflow.results import Evaluation, Identification
from sysid.workflow.saved import Exports
from sysid.workflow.setting import Setting
from sysid.workflow.steps import NextStep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NO_VALIDATION = (
    "no validation record was given, so what is called validation here is the record of the fit itself and says "
    "nothing of new data; give one: fit.report(path, validation=other)"
)
_COLUMNS = 125  # letters of the sentence on a line


def write_page(fit: Fit | NlarxFit, path: str | PathLike, data: IOData, validation: IOData | None) -> Path:
    """Writes the page of a fit on `data` and `validation` to `path`, whole or not at all; returns the path."""
    for record in (data, validation):
        if record is not None:
            siso(record)
    found = identified(fit, data, validation)
    what = replace(page(found, Exports()), title=f"Fit of {data.y_name} to {data.u_name}")
    return write_text(path, what.html())


def identified(fit: Fit | NlarxFit, data: IOData, validation: IOData | None) -> Identification:
    """The fit with everything that the page shows."""
    test_data = data if validation is None else validation
    check_parts(data, test_data)
    setting = Setting(recipe_of(fit), fit.search, max(len(fit.losses), 1))
    evaluation = evaluate_fit(setting, fit, data, test_data)
    notes: Sequence[str] = evaluation.notes if validation is not None else (NO_VALIDATION, *evaluation.notes)
    evaluation = replace(evaluation, notes=tuple(notes))
    place = Path("memory")
    record = Record(place, data, data.u_name, data.y_name, None, Signals(place, ChannelMap(), data.Ts, (), ()))
    return Identification(record, Plan(detrend="none"), evaluation, advise(retrend(data)), next=_next(evaluation))


def _next(e: Evaluation) -> NextStep | None:
    """The call to try next after a poor fit; None after a good one."""
    if not e.fit.stop.converged:
        return NextStep("the search did not converge", "fit.refine(options=sysid.Options(max_iterations=500))")
    if not poor(e.judged_fit, e.tests):
        return None
    return NextStep("this structure does not explain the record", "sysid.select(data, seconds=120).fit")


def figure(draw: Callable[..., Axes | Sequence[Axes]], *arguments: Any, say: str = "", **options: Any) -> Figure:
    """The figure that `draw` makes of what it is given, and the sentence `say` below it."""
    with for_a_person():
        axes = draw(*arguments, **options)
    first: Any = axes[0] if isinstance(axes, Sequence) else axes
    drawing: Figure = first.figure
    if say:
        drawing.supxlabel(fill(say, _COLUMNS), fontsize=8.0, color=style.SECOND, x=0.01, ha="left")
    return drawing


@dataclass(frozen=True)
class ExistingModel(Recipe):
    """The recipe of a model that exists already: words for a page, and no settings.

    `of` is the structure's name, whose physical values a page may show.
    """

    name: ClassVar[str] = "given"
    words: str = ""
    of: str = ""

    @classmethod
    def options(cls) -> dict[str, Option]:
        return {}

    def model(self) -> None:
        """There is nothing to build."""

    def in_words(self, fit: Any = None) -> str:
        return self.words

    def as_subject(self, fit: Any = None) -> str:
        return f"{'An' if self.words[:1] in 'AEIOU' or self.words.startswith('NLARX') else 'A'} {self.words} model"

    def physics(self) -> dict[str, Any] | None:
        return TABLE[self.of]().physics() if self.of in TABLE else None


def recipe_of(fit: Fit | NlarxFit) -> ExistingModel:
    """What a page needs to know of a model."""
    return ExistingModel(structure_in_words(fit), fit.model.structure)


def structure_in_words(fit: Fit | NlarxFit) -> str:
    """Structure, orders and blocks in one phrase."""
    if isinstance(fit, NlarxFit):
        m = fit.model
        return f"NLARX (na {m.na}, nb {m.nb}, nk {m.nk}), wavelet network of {fit.network.units} units"
    structure = fit.model.structure
    name = TABLE[structure].title() if structure in TABLE else structure.replace("_", "-").title()
    return ", ".join([f"{name}{orders(fit)}", *_other_blocks(fit)])


def orders(fit: Fit) -> str:
    """The orders of a single transfer function in brackets, else nothing."""
    filters = [b for b in fit.model.blocks if isinstance(b, TransferFunction)]
    if len(filters) != 1:
        return ""
    return f" ({_listed(filters[0])})"


def _listed(block: TransferFunction) -> str:
    return ", ".join(f"{name} {value}" for name, value in block.orders.items())


def _other_blocks(fit: Fit) -> list[str]:
    """The other blocks by role."""
    several = sum(isinstance(b, TransferFunction) for b in fit.model.blocks) > 1
    names = []
    for b in fit.model.blocks:
        if isinstance(b, TransferMatrix):
            names.append(f"{b.channels[1]} x {b.channels[0]} transfer functions")
        elif isinstance(b, TransferFunction):
            names += [f"{b.role} ({_listed(b)})"] if several else []
        else:
            kinds = dict.fromkeys(_kind(m) for m in b.maps) if isinstance(b, Channels) else [_kind(b)]
            role = b.role.replace("_", " ")
            kind = "/".join(kinds)
            names.append(kind if role in kind.split() else f"{role} {kind}")
    return names


def _kind(block: Any) -> str:
    """PiecewiseLinear as piecewise linear."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", type(block).__name__).lower()


def rmse_in_words(fit: Fit | NlarxFit) -> str:
    """The root of the mean squared error in the unit in which people read the output."""
    data = fit.record
    q = display_quantity("", data.y_unit if data is not None else "")
    return f"{number(float(np.sqrt(fit.criteria.mse)) * q.factor)} {q.unit}".rstrip()


def criteria_in_words(fit: Fit | NlarxFit) -> str:
    """The criteria that compare models, and what they count."""
    c = fit.criteria
    return ", ".join([*map(" ".join, c.brief().items()), f"d {c.d} of {c.N} samples"])


def search_in_words(fit: Fit | NlarxFit) -> str:
    """How the search ended, and its effort."""
    end = "converged" if fit.stop.converged else fit.stop.reason
    return f"{fit.search}: {end} ({fit.stop.iterations} iterations, {fit.seconds:.2g} s)"
