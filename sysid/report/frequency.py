"""The page of `qpal identify` on a frequency response."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity, number, percent, ratio
from sysid.diagnosis.worth import worth
from sysid.estimation.frequency_fit import GIVEN
from sysid.plots.frequency import response_fit_figure
from sysid.report import sections
from sysid.report.answer import Answer, Word
from sysid.report.page import Grid, Page, Picture, Section
from sysid.workflow.frequency import FrequencyIdentification


def page(result: FrequencyIdentification, files: Sequence[tuple[str, str]], model: str) -> Page:
    """The whole report; `files` beside it with what they are, `model` the saved model as a command names it."""
    data, fit = result.data, result.result.fit
    rows = [
        [p.name, number(p.value, 6), "fixed" if not p.free else number(p.std, 3), p.unit]
        for p, initial in zip(fit.parameters, fit.model.initial, strict=True)
        if not initial
    ]
    parts = [
        Section("Values", tables=[values(result)]),
        Section("All parameters", details=[Grid(("parameter", "value", "deviation", "unit"), rows, last_text=True)]),
        Section("Files", tables=[Grid(("file", "what it is"), files, last_text=True)]),
    ]
    low, high = data.w[0], data.w[-1]
    return Page(
        f"{result.setting.recipe.in_words()} of {result.path.name}",
        f"frequency response: {len(data.w)} frequencies, {low:.4g} to {high:.4g} rad/s",
        sentences(result),
        parts,
        versions(),
        answer=answer(result, model),
    )


def answer(result: FrequencyIdentification, model: str = "") -> Answer:
    """The first screen."""
    r = result.result
    caption = "Data and model with its 95 % band; below, what is left. What to see: errors that look like noise."
    return Answer(
        percent(100.0 * r.share),
        "middle error of the model's frequency response, as a share of the response",
        word(result),
        f"{capital(left(result))}.",
        Picture.of("answer", response_fit_figure(r), caption),
        values=values(result),
        next=f"Next: {following(result, model)}",
    )


@dataclass(frozen=True)
class _Left:
    """What is left of a frequency response, which has no input beside it: like noise, or not."""

    white: bool

    @property
    def independent(self) -> bool:
        """Whether nothing of the plant is in it."""
        return self.white


def word(result: FrequencyIdentification) -> Word:
    """As `worth` says of the share of the response that the model gives; sound where the fit has no warnings."""
    r = result.result
    return worth(100.0 * (1.0 - r.share), _Left(r.random), not r.fit.warnings)


def left(result: FrequencyIdentification) -> str:
    """What the errors look like."""
    if result.result.fit.warnings:
        return result.result.fit.warnings[0]
    if result.result.random:
        return "the errors of neighbouring frequencies have nothing in common: what is left is noise"
    return "the errors of neighbouring frequencies are alike: the model lacks something"


def following(result: FrequencyIdentification, model: str) -> str:
    """The next command: a larger kind of process where the errors are alike, else an export."""
    if result.result.random or result.setting.recipe.name != "process":
        return f"qpal export {model} --control"
    return f"qpal identify {result.path} --structure process --kind {_larger(result.setting.recipe.kind)}"  # type: ignore[attr-defined]


def _larger(kind: str) -> str:
    """The kind with one time constant more, up to three, then with a zero."""
    count = int(kind[1])
    if "U" not in kind and count < 3:
        return kind.replace(str(count), str(count + 1))
    return kind if "Z" in kind else f"{kind}Z"


def sentences(result: FrequencyIdentification) -> list[str]:
    """What was fitted, and what the deviations of the data were taken for."""
    r = result.result
    taken = (
        "The data say their deviations"
        if r.errors == GIVEN
        else f"The data do not say their deviations: of the two that were tried, {r.errors} is the likelier"
    )
    size = ", whose size is that of what is left" if r.data.std is None or not r.data.absolute else ""
    hold = f"samples of {r.data.Ts:g} s with a held input" if r.data.Ts else "continuous signals, without a hold"
    lines = [f"{taken}{size}.", f"The response is one of {hold}."]
    if not r.data.Ts:
        lines.append(f"The saved model runs on records of {r.fit.Ts:.4g} s; its times are in seconds.")
    return [*lines, *(f"{capital(text)}." for text in r.fit.warnings)]


def values(result: FrequencyIdentification) -> Grid:
    """The values that engineers name, with intervals."""
    rows = [(sections.WORDS.get(v.name, v.name), *sections.value_cells(v)) for v in result.values]
    errors = np.abs(result.result.misfit * result.result.std)
    q = display_quantity("", ratio(result.data.y_unit, result.data.u_unit))
    rows.append(("error of response, middle", number(q.factor * float(np.median(errors)), 3), "–", q.unit))
    return Grid(("", "value", "95 % interval", "unit"), rows, last_text=True)
