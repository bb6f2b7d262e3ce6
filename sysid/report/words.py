"""Words shared by the figures and tables of a report."""

from sysid.base.quantities import percent
from sysid.diagnosis.residuals import ResidualTests
from sysid.nlarx.result import ONE_STEP, NlarxFit
from sysid.uncertainty.information import UNEXCITED
from sysid.workflow.results import Evaluation


def one_step(evaluation: Evaluation) -> bool:
    """Whether the criteria and residuals of a fit refer to one-step-ahead prediction instead of free run."""
    return isinstance(evaluation.fit, NlarxFit) and evaluation.fit.criteria_of == ONE_STEP


def tests_in_words(evaluation: Evaluation) -> str:
    """Both test results, the joint test with how likely chance is."""
    t = evaluation.tests
    if t is None:
        return "The validation data are too short for residual tests."
    subject = "The one-step-ahead residuals" if one_step(evaluation) else "The residuals"
    outside = f" ({t.whiteness_outside} of {len(t.lags) - 1} lags outside)"
    together = f" (all lags together: {_likely(t.independence_p)})"
    return f"{subject} are {verdict(t, outside, together)}.{_no_voucher(evaluation)}"


def verdict(tests: ResidualTests, outside: str = "", together: str = "") -> str:
    """Colour and dependence of residuals, each with its numbers; no "not" that could be read over both."""
    colour = f"white{outside}" if tests.white else f"coloured{outside}"
    if tests.independent:
        return f"{colour}{' and' if tests.white else ', but'} independent of the input{together}"
    return f"{colour}, {'but' if tests.white else 'and'} depend on the input{together}"


def noted(what: str, note: str) -> str:
    """A sentence from a note of the intervals of `what`, such as "a pole"."""
    return f"The record does not excite {what}." if note == UNEXCITED else f"{what[0].upper()}{what[1:]} {note}."


NO_VOUCHER = 50.0  # [%] of fit in validation, below which passed tests need a word of warning


def _no_voucher(evaluation: Evaluation) -> str:
    """That a passed test does not vouch for a poor model; where both pass and some fit is left, noise is the reason."""
    t, fit = evaluation.tests, evaluation.validation_fit
    passed = [] if t is None else [name for name, ok in (("whiteness", t.white), ("independence", t.independent)) if ok]
    if not passed or fit >= NO_VOUCHER or (len(passed) == 2 and fit > 0.0):
        return ""
    return (
        f" That does not vouch for the model: at a fit of {percent(fit)} the {' and '.join(passed)} test"
        f"{'s have' if len(passed) == 2 else ' has'} little power, because the residuals are as large as the output."
    )


def _likely(p: float) -> str:
    """How often chance alone gives such correlations."""
    return f"chance gives such correlations in {_share(p)} of records" if p >= 1e-4 else "chance does not explain it"


def _share(p: float) -> str:
    """A probability in percent with two digits that count."""
    return f"{100.0 * p:.0f} %" if p >= 0.095 else f"{100.0 * p:.2g} %"
