"""Words shared by the figures and tables of a report."""

from sysid.nlarx.result import ONE_STEP, NlarxFit
from sysid.workflow.evaluation import Evaluation


def one_step(evaluation: Evaluation) -> bool:
    """Whether the criteria and residuals of a fit refer to one-step-ahead prediction instead of free run."""
    return isinstance(evaluation.fit, NlarxFit) and evaluation.fit.criteria_of == ONE_STEP


def tests_in_words(evaluation: Evaluation) -> str:
    """Both test results, the joint test with how likely chance is."""
    t = evaluation.tests
    if t is None:
        return "The validation data are too short for residual tests."
    white = "white" if t.white else "not white"
    independent = "independent of the input" if t.independent else "not independent of the input"
    subject = "The one-step-ahead residuals" if one_step(evaluation) else "The residuals"
    return (
        f"{subject} are {white} ({t.whiteness_outside} of {len(t.lags) - 1} lags outside) and {independent} "
        f"(all lags together: {_likely(t.independence_p)})."
    )


def _likely(p: float) -> str:
    """How often chance alone gives such correlations."""
    return (
        f"chance gives such correlations in {100.0 * p:.2g} % of records" if p >= 1e-4 else "chance does not explain it"
    )
