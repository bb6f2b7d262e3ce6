"""The first screen of `qpal identify`: how much of unseen data the model explains, and what to do next."""

import numpy as np

from sysid.base.poles import Motion
from sysid.base.quantities import capital, number, percent
from sysid.data.record import IOData
from sysid.diagnosis import residuals
from sysid.diagnosis.finding import Advice
from sysid.diagnosis.relation import COMPUTED, without_effect
from sysid.diagnosis.signals import NO_VALUE
from sysid.diagnosis.worth import worth
from sysid.drawing.figure import Figure
from sysid.joint.values import distinct_values
from sysid.plots.free_runs import runs_figure
from sysid.report import figures, sections, verdict
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word, short
from sysid.report.gain import gain_rows
from sysid.report.page import Grid, Picture
from sysid.workflow.next_step import INCOMPLETE
from sysid.workflow.remarks import WRONG
from sysid.workflow.results import Evaluation, Identification
from sysid.workflow.what_is_left import LARGER, rounded, systematic

SLOWEST = 3  # time constants


def answer(result: Identification, model: str = "") -> Answer:
    """The first screen; `model` is the saved model as a command names it."""
    e = result.evaluation
    return Answer(
        percent(e.judged_fit),
        f"of the {e.part} explained by the model's {e.judged}",
        word(result),
        sentence(result),
        Picture.of("answer", run_figure(e), _caption(result)),
        values=values(e),
        next=following(result, model),
    )


def word(result: Identification) -> Word:
    """As `worth` says; sound on unseen data if nothing is left to try and no error is systematic; poor also where it
    goes against its record.

    A prediction some steps ahead that is poor, but misses less than half of its data, is usable.
    """
    e = result.evaluation
    if _bad(e) or _wrong(e) or _spoilt(result) or _without_effect(result):
        return POOR
    is_sound = result.next is None and e.unseen and not verdict.no_joint(e)
    is_sound = is_sound and not _computed(result) and not systematic(e)
    if is_sound and e.judged_fit >= residuals.POOR and rounded(e):
        return GOOD
    found = worth(e.judged_fit, e.tests, is_sound)
    return USABLE if found == POOR else found


def _without_effect(result: Identification) -> Advice | None:
    """The finding that the input shows no effect, beside a model that is not good; None of others."""
    return without_effect(result.advice) if result.evaluation.judged_fit < residuals.POOR else None


def _computed(result: Identification) -> str:
    """What is said of an input that a controller computes from the output; empty of others."""
    return next((a.sentence for a in result.advice if COMPUTED in a.sentence), "")


def _bad(e: Evaluation) -> bool:
    """Whether the model misses its data: a prediction some steps ahead, which noise adds up in, by more than half."""
    return verdict.bad(e) and (e.growing is None or e.growing.misses)


def _wrong(e: Evaluation) -> list[str]:
    """The notes on a model that goes against its record."""
    return [note for note in e.notes if WRONG in note]


def _spoilt(result: Identification) -> bool:
    """Whether numbers that stand for none are in the record of a model that explains little of it.

    The rest is then white, as the numbers are, but not because noise limits the fit.
    """
    return result.evaluation.judged_fit < residuals.POOR and any(NO_VALUE in a.sentence for a in result.advice)


def sentence(result: Identification) -> str:
    """Why the word: of a model that is not good, what is wrong with it; else what is left."""
    e, wrong = result.evaluation, _wrong(result.evaluation)
    if verdict.no_joint(e) and e.joint is not None:
        return e.joint.sentence()
    if (none := _without_effect(result)) is not None:
        return f"{capital(none.sentence)}."
    if wrong:
        return f"Do not use this model: {wrong[0].partition(';')[0]}."
    if _bad(e) or _spoilt(result):
        return f"Do not use this model: {_reason(result)}."
    if not e.unseen:
        return "All of the record was used for the fit, so no fit to unseen data is known."
    if said := _computed(result):
        return f"{capital(said)}."
    left = systematic(e) or ("what is left is the rounding of the readings" if rounded(e) else "")
    left = left or verdict.left_in_words(e.tests, e.notes)
    why = result.next.why if result.next is not None else ""
    is_new = bool(why) and why.partition(" (")[0] not in left  # such as that the search did not converge
    if why == INCOMPLETE and e.tests is not None and not e.tests.independent:  # which says no more
        is_new = False
    left = left.removesuffix(f"; {LARGER}") if is_new else left  # one remedy
    return f"{capital(left)}{f'; {why}' if is_new else ''}."


def _reason(result: Identification) -> str:
    """Why a model is bad, in a few words."""
    e = result.evaluation
    if result.next is not None:
        return result.next.why
    worse = "" if e.judged_fit >= 0 else ", worse than its constant mean"
    return f"its {e.judged} misses the {e.part}{worse}"


def following(result: Identification, model: str = "") -> str:
    """The next step: a command, or what to record."""
    if result.next is not None and NO_VALUE in result.next.why:  # the same command on the same file is no step
        return f"Next: {result.next.why.rpartition(': ')[2]}; then {result.next.command}"
    if result.next is not None:
        return "\n".join([result.next.line("Next"), *([result.also.line("Or")] if result.also else [])])
    if (none := _without_effect(result)) is not None:
        return f"Next: {none.action}"
    if word(result) == POOR:
        actions = [a.action for a in result.advice if a.severity == "warning" and a.action]
        todo = actions[0] if actions else "record again with an input that shows more of the system"
        return f"Next: {todo}; then qpal info {result.record.path}"
    return f"Next, on another record: qpal run {model} FILE" if model else ""


def run_figure(e: Evaluation) -> Figure:
    """The data that the model is judged by with its run over them, and below what is left of each output."""
    data, run = _judged_run(e)
    figure = runs_figure(data, {"free run" if e.growing is None else "prediction one step ahead": run})
    return short(figure, data.y.shape[1])


def _judged_run(e: Evaluation) -> tuple[IOData, np.ndarray]:
    """The data that the model is judged by, and its free run over them, or its prediction where it does not settle."""
    of = e if e.growing is None or e.one_step is None else e.one_step
    return (e.validation, of.validation_output) if e.unseen else (e.estimation, of.estimation_output)


def _caption(result: Identification) -> str:
    e = result.evaluation
    seen = "The validation data, which the fit has not seen" if e.unseen else "The record that was fitted"
    see = "where the two part: there the model lacks what moves the output"
    if word(result) != POOR:
        is_noise = e.tests is None or e.tests.independent
        see = "errors that look like noise" if is_noise else "errors that come with the input: the model lacks these"
    return f"{seen}: measured and model; below, what is left. What to see: {see}."


def values(e: Evaluation) -> Grid:
    """What people want of a model, with intervals: of a joint its values, of a linear block gain and time constants."""
    rows = [*_physical(e), *([] if e.values else [*gain_rows(e), *_lasting(e)]), *_errors(e)]
    if verdict.too_narrow(e):
        rows = [(name, value, f"wider than {i}" if " to " in i else i, unit) for name, value, i, unit in rows]
    return Grid(("", "value", "95 % interval", "unit"), rows, last_text=True)


def _physical(e: Evaluation) -> list[tuple[str, ...]]:
    known = [v for v in distinct_values(e.values) if v.determined and v.low is not None]
    return [(sections.WORDS.get(v.name, v.name), *sections.value_cells(v)) for v in known]


def _lasting(e: Evaluation) -> list[tuple[str, ...]]:
    """The slowest time constants that are determined, of a pair of poles one; a pole that alternates has none."""
    if e.motion != Motion.STABLE:
        return []
    roots = [r for r in e.roots or () if r.value.imag >= 0 < r.value.real and 0 < r.time_constant.std < np.inf]
    roots = sorted((r for r in roots if r.time_constant.upper < np.inf), key=lambda r: -r.time_constant.value)
    return [("time constant", *sections.lasting(r), "s") for r in roots[:SLOWEST]]


def _errors(e: Evaluation) -> list[tuple[str, ...]]:
    """The mean error of each output in its unit; one step ahead of a model that does not settle."""
    data, run, ahead = *_judged_run(e), "" if e.growing is None else " one step ahead"
    error = np.where(data.observed, data.y - np.reshape(run, data.y.shape), np.nan)[e.fit.n_init :]
    shown, rows = e.outputs or [None], list[tuple[str, ...]]()
    for k, output in enumerate(shown):
        q = figures.signals(e)[1] if output is None else figures.display_quantity(output.name, output.unit)
        with np.errstate(over="ignore", invalid="ignore"):
            rms = float(np.sqrt(np.nanmean(error[:, k] ** 2)))
        rows.append((f"error of {q.name}{ahead}, RMS", number(q.factor * rms, 3), "–", q.unit))
    return rows
