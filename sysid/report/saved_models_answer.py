"""The first screen of `qpal run`: how much of a record a saved model explains, or which of several does best."""

from sysid.base.quantities import capital, percent
from sysid.diagnosis.worth import worth
from sysid.report import saved_models_parts as parts
from sysid.report.answer import POOR, Answer, Word, short
from sysid.report.page import Picture
from sysid.report.verdict import left_in_words
from sysid.workflow.input_run import InputRun
from sysid.workflow.model_run import ModelRun, Models
from sysid.workflow.saved import fell, unfit


def of_run(result: ModelRun | InputRun) -> Answer:
    """Of one model."""
    (values,) = parts.run_tables(result)
    if isinstance(result, InputRun):
        return Answer(
            f"{result.data.N} samples",
            "of the model's run from rest",
            None,
            "The file has no measured output, so no fit is known.",
            Picture.of("free-run", parts.input_run_figure(result), "The input, and the model's run from rest."),
            values=values,
        )
    figure = short(parts.run_figure(result), len(result.percents))
    return Answer(
        percent(result.percent),
        "of the record explained by the model's free run",
        word(result),
        sentence(result),
        Picture.of("free-run", figure, _CAPTION.format(result.n_init)),
        values=values,
        next=_next(result),
    )


_CAPTION = (
    "Measured and free run; below, what is left. The first {} outputs give the initial state and are not scored: a "
    "good model leaves what looks like noise."
)


def word(result: ModelRun) -> Word:
    """As `worth` says; sound where the fit does not fall behind that of the estimation data, and the file does not warn
    of the model."""
    is_sound = fell(result.model.estimation, result.percent) is None and not unfit(result.model.fit)
    return worth(result.percent, result.tests, is_sound)


def sentence(result: ModelRun) -> str:
    """Why the word."""
    fall = fell(result.model.estimation, result.percent)
    text = result.next.why if result.next is not None else fall or left_in_words(result.tests, result.notes)
    return f"{capital(text)}."


def _next(result: ModelRun) -> str:
    return "" if result.next is None else f"Next: {result.next.command}"


def of_models(result: Models) -> Answer:
    """Of several models."""
    best, smaller = result.best, result.smaller
    says = sentence(best)
    if smaller is not None and word(best) != POOR:
        says = f"{smaller.model.name} is as good with fewer parameters: prefer it."
    figure = short(parts.overlay_figure(result), len(best.percents))
    (table,) = parts.models_tables(result)
    return Answer(
        percent(best.percent),
        f"of the record explained by {best.model.name}, the best of {len(result.runs)} models",
        word(best),
        says,
        Picture.of("overlay", figure, "Measured output and the free runs of the models, best first."),
        values=table.only("", "model", "structure", "orders", "d", "this record"),
        next=_next(best),
    )
