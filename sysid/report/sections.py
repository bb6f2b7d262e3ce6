"""Tables and sentences that several reports share, from final numbers."""

import re
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from sysid.base.criteria import TABLE as CRITERIA
from sysid.base.poles import time_constant
from sysid.base.quantities import SHARE, capital, display_quantity, estimate, number, percent, pole
from sysid.estimation.origin import ONE_STEP
from sysid.joint.values import WORDS, JointValue, distinct_values
from sysid.plots.responses import note_sentences
from sysid.report.page import Grid
from sysid.uncertainty.intervals import Interval, Root
from sysid.workflow.results import Evaluation

T = TypeVar("T")
NOT_KNOWN = "not determined"
FIXED = "fixed"
_ACTION = re.compile(r"[:;] (?=(?:record|reverse|sample) )")  # what to record stands behind the reason


def higher_in_words(evaluation: Evaluation) -> str:
    """One sentence for each test for a missing nonlinearity."""
    h = evaluation.higher
    if h is None:
        return ""
    if h.passed:
        coloured = evaluation.tests is not None and not evaluation.tests.white
        doubt = ", but this is not conclusive because the residuals are coloured" if coloured else ""
        return f"Correlations of higher order (e with u², e² with u², e with e u) show no missing nonlinearity{doubt}."
    return " ".join(sentence(a).replace("^2", "²") for a in h.advice)


def values_grid(evaluation: Evaluation, caption: str = "Physical values with 95 % intervals") -> Grid | None:
    """Physical values of an actuated joint in display units; None for other structures."""
    if not evaluation.values:
        return None
    rows = [(WORDS.get(v.name, v.name), *value_cells(v)) for v in distinct_values(evaluation.values)]
    return Grid(("", "value", "95 % interval", "unit"), rows, caption, last_text=True)


def value_cells(v: JointValue) -> tuple[str, str, str]:
    """Value, interval and unit of a physical value; angles in degrees. What the record does not determine is a dash."""
    quantity = display_quantity(v.name, v.unit)
    factor, unit = quantity.factor, quantity.unit
    if not v.determined:
        said = v.why.split(" (")[0] if v.why.startswith(("not reached", "below")) else NOT_KNOWN
        return number(None), said.removesuffix(f" {unit}") if said.startswith("below") else said, unit
    if v.low is None or v.high is None:
        return number(v.value * factor, 4), NOT_KNOWN, unit
    if v.low == v.high == v.value:
        return number(v.value * factor, 4), FIXED, unit
    value, low, high = estimate(*(x * factor for x in (v.value, v.low, v.high)))
    return value, f"{low} to {high}", unit


def undetermined_in_words(evaluation: Evaluation) -> str:
    """The values that the record does not determine, each reason once, and what to record, once for all."""
    names, actions = dict[str, list[str]](), dict[str, None]()
    for v in evaluation.values:
        name, reason = WORDS.get(v.name, v.name), v.why or "this record does not show it"
        if v.name.startswith("moving_friction"):
            name = WORDS[v.name.replace("moving_friction", "breakaway")]
            reason = reason.rpartition("break-away is not determined: ")[2]
            name += _shown_at_rest(evaluation, v.name)
        elif v.determined:
            continue
        reason, *action = _ACTION.split(reason)
        names.setdefault(reason, []).append(name)
        actions |= dict.fromkeys(action)
    lines = [f"{capital(' and '.join(these))}: {reason}." for reason, these in names.items()]
    lines += [f"What to do: {'; '.join(actions)}."] if actions else []
    return " ".join(["Not determined.", *lines]) if lines else ""


def _shown_at_rest(evaluation: Evaluation, name: str) -> str:
    """That a record shows friction at rest to be higher, without showing how high; empty where it shows neither."""
    way = f"{name.rpartition('_')[2]}ward"
    parts = () if evaluation.joint_fit is None else evaluation.joint_fit.parts
    is_shown = any(part.verdict == "shown" and part.words == f"higher friction at rest {way}" for part in parts)
    return " (above the moving friction, but not by how much)" if is_shown else ""


def pole_grid(evaluation: Evaluation) -> Grid | None:
    """Poles with 95 % intervals of modulus and time constant, then zeros; None if there is no linear block."""
    if not evaluation.linear:
        return None
    Ts = evaluation.fit.Ts
    roots: Sequence[Root | None] = evaluation.roots or [None] * len(evaluation.poles)
    rows = [
        (
            "pole",
            pole_exact(z),
            *_size(abs(z), r.modulus if r else None),
            *_size(time_constant(abs(z), Ts), r.time_constant if r else None),
        )
        for z, r in zip(evaluation.poles.tolist(), roots, strict=True)
    ]
    rows += [("zero", pole_exact(z), number(abs(z), 5), "–", "–", "–") for z in evaluation.zeros.tolist()]
    headings = ("", "z", "|z|", "95 % interval", "time constant [s]", "95 % interval")
    return Grid(headings, rows, "Poles and zeros of the linear block")


def intervals_in_words(evaluation: Evaluation) -> str:
    """The assumptions of the pole intervals, and their warnings."""
    if not evaluation.roots:
        return ""
    notes = dict.fromkeys(r.note or r.modulus.note for r in evaluation.roots)
    notes.pop("", None)
    coloured = evaluation.tests is not None and not evaluation.tests.white
    assumption = "allow for coloured residuals" if coloured else "assume white residuals"
    words = (
        f"The intervals apply to this structure on this record and {assumption}; they do not include errors of the "
        "structure."
    )
    return " ".join([words, *(words for note in notes for words in note_sentences("a pole", note))])


def _size(value: float, interval: Interval | None) -> tuple[str, str]:
    """A quantity that is not negative, and its interval."""
    text = number(value) if np.isfinite(value) else "–"
    if interval is None or not np.isfinite(interval.std):
        return text, "not known"
    if interval.std == 0.0:
        return text, FIXED
    found, low, high = estimate(value, max(interval.lower, 0.0), interval.upper)
    return found if np.isfinite(value) else "–", f"{low} to {high}"


def lasting(root: Root) -> tuple[str, str]:
    """The time constant of a root [s], and its interval."""
    return _size(root.time_constant.value, root.time_constant)


def pole_exact(z: complex) -> str:
    """One pole, with ± for a complex pair."""
    sign = "−" if z.imag < 0 else "+"
    return pole(complex(z.real)) if abs(z.imag) < 5e-5 else f"{pole(complex(z.real))} {sign} {abs(z.imag):.4f}i"


def parameter_grid(evaluation: Evaluation, caption: str = "All parameters") -> Grid:
    """Name, value, standard deviation and unit of every parameter."""
    rows = [
        (p.name, number(p.value, 5), number(p.std, 2), p.unit or "–", "free" if p.free else "fixed")
        for p in evaluation.fit.parameters
    ]
    return Grid(("parameter", "value", "std", "unit", ""), rows, caption)


def criteria_grid(evaluation: Evaluation) -> Grid:
    """Fit of both parts, and every criterion of the estimation data with its meaning."""
    c = evaluation.fit.criteria
    unit = evaluation.estimation.y_unit.replace(SHARE, "")  # a number
    unit = f" [({unit})²]" if "/" in unit else f" [{unit}²]" if unit else ""
    rows = [
        ("fit, free run, validation data", percent(evaluation.validation_fit), "the whole output from only the input"),
        ("fit, free run, estimation data", percent(evaluation.estimation_fit), "the same on the estimation data"),
        *(
            (f"the same of {o.name}, validation data", percent(o.validation_fit), "of one output")
            for o in evaluation.outputs[: len(evaluation.outputs) * (len(evaluation.outputs) > 1)]
        ),
        *_one_step_rows(evaluation),
        (f"loss V, mean squared error{unit}", number(c.loss), "what the search minimised"),
        *(
            (f"{entry.label}{unit if entry.squared else ''}", number(entry.formula(c)), entry.meaning)
            for entry in CRITERIA.values()
        ),
        ("effective number of parameters d / samples N", f"{c.d} / {c.N}", "what the fit adapts to the record"),
    ]
    *others, last = (entry.label for entry in CRITERIA.values())
    caption = f"{', '.join(others)} and {last} use one-step-ahead errors" if one_step(evaluation) else ""
    if not evaluation.unseen:
        rows = [row for row in rows if not row[0].endswith("validation data")]
    return Grid(("criterion", "value", "meaning"), rows, caption, last_text=True)


def _one_step_rows(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    prediction = evaluation.one_step
    if prediction is None:
        return []
    meaning = "each sample from all previous measured samples"
    rows = [
        ("fit, ONE STEP ahead, validation data", percent(prediction.validation_fit), meaning),
        ("fit, ONE STEP ahead, estimation data", percent(prediction.estimation_fit), meaning),
    ]
    if prediction.growth is not None:
        ahead = f"fit, {prediction.growth.ahead.upper().replace('AHEAD', 'ahead')}, validation data"
        meaning = "each sample from measured samples at least so long before"
        rows.append((ahead, percent(prediction.growth.fit), meaning))
    return rows


def search_sentence(evaluation: Evaluation) -> str:
    """The stopping reason and effort of the search."""
    stop, s = evaluation.fit.stop, evaluation.setting
    plural = "" if s.starts == 1 else f" from the best of {s.starts} starts"
    end = " converged" if stop.converged else f", which did not converge: {stop.reason}"
    return (
        f"Search {s.search}{plural}{end} ({stop.iterations} iterations, {stop.evaluations} evaluations, "
        f"{evaluation.fit.seconds:.2g} s)."
    )


def unfinished_search(evaluation: Evaluation) -> list[str]:
    """The same of a search that did not converge; nothing of others."""
    return [] if evaluation.fit.stop.converged else [search_sentence(evaluation)]


def setting_in_words(evaluation: Evaluation) -> str:
    """Structure, orders and maps as one phrase."""
    return evaluation.setting.recipe.in_words(evaluation.fit)


def model_in_words(evaluation: Evaluation) -> str:
    """The same as the subject of a sentence."""
    return evaluation.setting.recipe.as_subject(evaluation.fit)


def one_step(evaluation: Evaluation) -> bool:
    """Whether the criteria and residuals of a fit refer to one-step-ahead prediction instead of free run."""
    return evaluation.fit.criteria_of == ONE_STEP


def sentence(phrase: str) -> str:
    """The phrase with a capital letter and a full stop."""
    return f"{capital(phrase)}."


def only(things: Sequence[T | None]) -> list[T]:
    """Those that exist."""
    return [thing for thing in things if thing is not None]
