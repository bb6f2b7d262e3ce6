"""Sentences on a fit: what it is worth, what its residuals show, and where its free run leaves the data."""

from collections.abc import Sequence

import numpy as np

from sysid.base.quantities import capital, display_quantity, number, percent, poles, probability, unit_of_channel
from sysid.blocks import Polynomial
from sysid.blocks._shape import Shape, is_named
from sysid.diagnosis.residuals import UNTESTED, ResidualTests, poor
from sysid.drawing.departure import departure
from sysid.estimation.result import Fit
from sysid.report.bands import bands
from sysid.report.sections import model_in_words, one_step
from sysid.workflow.evaluation import APART, OVERFITTED
from sysid.workflow.results import Evaluation, Identification
from sysid.workflow.what_is_left import rounded

NO_VOUCHER = 50.0  # [%] of fit in validation, below which passed tests need a word of warning
CLOSE = 90.0  # [%] fit of a free run that is close to the data


def first(result: Identification) -> list[str]:
    """The fit and its tests, where the free run leaves the data, and what its band holds."""
    e = result.evaluation
    leaves = exit_sentence(e) if bad(e) and not e.growing else ""
    fits = f"{model_in_words(e)} {fits_in_words(e)}. {leaves}{stability(e)} {tests_in_words(e)}"
    return [fits, *shapes_in_words(e), *band_in_words(e)]


def fits_in_words(e: Evaluation) -> str:
    """The fits [%] of the free run, or of predictions where the free run adds up all errors."""
    if not e.unseen and e.growing is None:
        return f"has a free-run fit on the {e.part} of {percent(e.estimation_fit)}; no data are left to validate it"
    free = f"free-run fit on the {e.part} of {percent(e.validation_fit if e.unseen else e.estimation_fit)}"
    if e.growing is None:
        return f"has a {free} ({percent(e.estimation_fit)} on the estimation data)"
    return (
        f"predicts the {e.part} {e.growing.ahead} with a fit of {percent(e.growing.fit)}; its "
        f"{free} says little, because a free run adds up every error where the plant itself does not settle"
    )


def no_joint(e: Evaluation) -> bool:
    """Whether the record is not that of a joint, or does not show that it is."""
    return e.joint is not None and not e.joint.joint


def bad(e: Evaluation) -> bool:
    """Whether the free run misses the validation data by more than noise explains."""
    return poor(e.judged_fit, e.tests)


def band_in_words(e: Evaluation) -> list[str]:
    """How much of the validation data the band of the free run holds, and what it is made of; none without a band."""
    if e.band is None:
        return []
    sentence = f"The {100 * e.band.level:g} % band of its free run holds {percent(100 * e.held)} of the validation data"
    with np.errstate(over="ignore"):  # of a run that runs away
        variance = np.nan_to_num(e.band.std, nan=np.inf) ** 2
    noise = float(np.min(variance))  # of the same size everywhere, and alone where the model is sure
    if np.mean(variance) > np.var(e.validation.y[:, 0]):
        wide = "; it is wider than the output itself: the estimation data do not say what the model does on this input"
    elif np.mean(variance) > 2.0 * noise:
        wide = "; most of its width is what the estimation data leave open of the model, not noise"
    else:
        wide = "; most of its width is noise"
    return [f"{sentence}{wide}."]


def shapes_in_words(e: Evaluation) -> list[str]:
    """The shapes that the record names for maps: one sentence each."""
    blocks = e.fit.model.blocks if isinstance(e.fit, Fit) else ()
    return [
        f"The {block.role} map is {block.words}{_corners(e, block)}: BIC prefers it to a map of many break points."
        for block in blocks
        if is_named(block)
    ]


def _corners(e: Evaluation, block: Shape) -> str:
    """Corners of an input map in the unit of the input as recorded; those of others are in no unit that is measured."""
    assert isinstance(e.fit, Fit)
    if e.fit.model.blocks[0] is not block or isinstance(block, Polynomial):
        return ""
    x, zero, texts = display_quantity("", e.estimation.u_unit), float(e.estimation.u_offset[0]), []
    info, names = bands(e).info, e.fit.model.names
    for p, one in zip(e.fit.parameters, np.eye(len(names)), strict=True):
        name = p.name.removeprefix(f"{block.role}.")
        if name != p.name and not name.startswith("gain"):
            reach = np.nan if info is None else info.quantile(0.95) * info.std_of_fit(one)  # coloured residuals counted
            half = "" if np.isnan(reach) else f" ± {number(reach * x.factor, 2)}"
            texts.append(f"{name.replace('_', ' ')} {number((p.value + zero) * x.factor)}{half}")
    return f" ({', '.join(texts)}{' ' * bool(x.unit)}{x.unit}; ± for 95 %)"


def too_narrow(e: Evaluation) -> str:
    """Why every interval of this fit is known to be too narrow; empty if nothing says so."""
    if not any(v.low is not None for v in e.values) and not any(np.isfinite(r.modulus.upper) for r in e.roots or ()):
        return ""
    reason = ""
    gap = 0.0 if e.growing or not e.unseen else e.fall
    if not np.isfinite(gap) or gap > (APART if e.values else OVERFITTED):
        reason = (
            f"the fit falls from {percent(e.estimation_fit)} on the estimation data to {percent(e.validation_fit)} on "
            "the validation data"
        )
    elif bad(e):
        reason = f"the {e.judged} explains only {percent(e.judged_fit)} of the {e.part}"
    elif e.tests is not None and not e.tests.independent and not rounded(e):
        reason = "the residuals depend on the input"
    if not reason:
        return ""
    return (
        f"Too narrow: {reason}, so the structure lacks something of the system, which no interval here contains. The "
        "true value may lie outside more often than 5 times in 100."
    )


def stability(e: Evaluation) -> str:
    """Poles, or how the free run behaves where there are none."""
    runs = "Its free run DIVERGES from the data."
    if e.linear:
        runs = f"It {e.motion}: poles {poles(e.poles)}."
    elif e.stable:
        near = min(e.validation_fit if e.unseen else np.inf, e.estimation_fit) >= CLOSE
        runs = (
            f"Its free run stays {'close to the data' if near else 'in the range of the data, but not close to them'}."
        )
    if e.one_step is None:
        return runs
    prediction_fit = percent(e.one_step.validation_fit if e.unseen else e.one_step.estimation_fit)
    return f"{runs} Its one-step-ahead prediction, which uses all earlier outputs, has a fit of {prediction_fit}."


def exit_sentence(e: Evaluation) -> str:
    """Where and how far the free run leaves the validation data first; empty if it stays near them."""
    run = np.asarray(e.validation_output, dtype=float).reshape(e.validation.N, -1) + e.validation.y_offset
    for k in range(run.shape[1]):
        exit = departure(e.validation.y[:, k] + e.validation.y_offset[k], run[:, k])
        if exit is not None:
            y = display_quantity(e.validation.y_name, unit_of_channel(e.validation.y_unit, k))
            return f"{exit.sentence('free run', e.validation.Ts, y)} "
    return ""


def tests_in_words(evaluation: Evaluation) -> str:
    """What is left of the output, with the numbers of both tests."""
    t = evaluation.tests
    if t is None:
        return f"{capital(left_in_words(t, evaluation.notes))}."
    kind = "one-step-ahead residuals" if one_step(evaluation) else "residuals"
    level = f"{100 * t.level:g} % bound"
    outside = f"autocorrelation beyond its {level} at {t.whiteness_outside} of {len(t.lags) - 1} lags"
    return (
        f"{capital(left_in_words(t))} ({kind}: {outside}; with the input, {probability(t.independence_p)})."
        f"{_no_voucher(evaluation)}"
    )


def left_in_words(tests: ResidualTests | None, notes: Sequence[str] = ()) -> str:
    """What is left of the output, with memory where it is coloured; without tests the reason that `notes` give."""
    if tests is None:
        reason = next((note.removeprefix(UNTESTED) for note in notes if note.startswith(UNTESTED)), "")
        return f"what is left is not tested{f': {reason}' if reason else ''}"
    if tests.independent:
        return f"the input's effect is captured; what is left is {'noise' if tests.white else 'noise with memory'}"
    return "what is left still depends on the input"


def _no_voucher(evaluation: Evaluation) -> str:
    """That a passed test does not vouch for a poor model; where both pass and some fit is left, noise is the reason."""
    t, fit = evaluation.tests, evaluation.judged_fit
    names = [] if t is None else [name for name, ok in (("whiteness", t.white), ("independence", t.independent)) if ok]
    if not names or fit >= NO_VOUCHER or (len(names) == 2 and fit > 0.0):
        return ""
    return (
        f" That does not vouch for the model: at a fit of {percent(fit)} the {' and '.join(names)} test"
        f"{'s have' if len(names) == 2 else ' has'} little power, because most of the output is left in the residuals."
    )
