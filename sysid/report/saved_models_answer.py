"""The first screen of `qpal run`: how much of a record a saved model explains, or which of several does best."""

from sysid.base.quantities import capital, percent, unit_of_channel
from sysid.diagnosis.residuals import CLOSE
from sysid.diagnosis.worth import worth
from sysid.report import saved_models_parts as parts
from sysid.report.answer import POOR, USABLE, Answer, Word, short
from sysid.report.page import Picture
from sysid.report.verdict import left_in_words
from sysid.workflow.input_run import InputRun
from sysid.workflow.model_run import ModelRun, Models
from sysid.workflow.saved import fell, unfit
from sysid.workflow.what_is_left import WORSE, Left, left_of, slow


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
    judged_figure = parts.run_figure if result.growth is None else parts.prediction_figure
    figure = short(judged_figure(result), len(result.percents))
    return Answer(
        percent(result.judged_fit),
        f"of the record explained by the model's {result.judged}",
        word(result),
        sentence(result),
        Picture.of("free-run", figure, (_CAPTION if result.growth is None else _AHEAD).format(result.n_init)),
        values=values,
        next=_next(result),
    )


_CAPTION = (
    "Measured and free run; below, what is left. The first {} outputs give the initial state and are not scored: a "
    "good model leaves what looks like noise."
)
_AHEAD = (
    "Measured, and predicted from the outputs measured before: the model does not settle, so its free run adds up all "
    "errors. The first {} outputs are not scored."
)


def word(result: ModelRun) -> Word:
    """As `worth` says; sound where the fit does not fall behind that of the estimation data, no error is systematic,
    and the file does not warn of the model. A prediction that is poor, but does not miss its data, is usable."""
    if result.growth is not None:
        found = worth(result.judged_fit, result.tests, not unfit(result.model.fit))
        return USABLE if found == POOR and not result.growth.misses else found
    is_sound = fell(result.model.estimation, result.percent) is None and not unfit(result.model.fit)
    return worth(result.percent, result.tests, is_sound and not (constant(result) or unexplained(result)))


def sentence(result: ModelRun) -> str:
    """Why the word."""
    if result.growth is not None:
        text = result.next.why if result.next is not None else left_in_words(result.tests, result.notes)
        return f"{capital(text)}."
    text = constant(result) or (result.next.why if result.next is not None else "")
    text = text or fell(result.model.estimation, result.percent) or unexplained(result)
    return f"{capital(text or left_in_words(result.tests, result.notes))}."


def constant(result: ModelRun) -> str:
    """That the error is mostly a constant; empty of others, and where it counts as nothing."""
    several = result.data.y.shape[1] > 1
    left = _left(result)
    name = f"output {left.output + 1}" if several else result.data.y_name
    return (
        "" if result.percent >= 100.0 - CLOSE else left.constant(name, unit_of_channel(result.data.y_unit, left.output))
    )


def unexplained(result: ModelRun) -> str:
    """Why an error that noise does not explain keeps the model from being good here; empty where nothing says so."""
    left, was = _left(result), result.model.estimation
    if result.percent >= 100.0 - CLOSE or not left.many:
        return ""
    if was is not None and 100.0 - result.percent > WORSE * (100.0 - was):
        return f"the error is {left.multiple}, and the fit on the estimation data was {percent(was)}"
    return slow(left, result.model.fit, result.tests)


def _left(result: ModelRun) -> Left:
    return left_of(result.data, result.output, result.n_init)


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
        percent(best.judged_fit),
        f"of the record explained by the {best.judged} of {best.model.name}, the best of {len(result.runs)} models",
        word(best),
        says,
        Picture.of("overlay", figure, f"Measured output and the {best.judged} of each model, best first."),
        values=table.only("", "model", "structure", "orders", "d", parts.this_record(result)),
        next=_next(best),
    )
