"""Words shared by the figures and tables of a report."""

from sysid.nlarx.result import ONE_STEP, NlarxFit
from sysid.workflow.evaluation import Evaluation


def one_step(evaluation: Evaluation) -> bool:
    """Whether the criteria and residuals of a fit refer to one-step-ahead prediction instead of free run."""
    return isinstance(evaluation.fit, NlarxFit) and evaluation.fit.criteria_of == ONE_STEP


def tests_in_words(evaluation: Evaluation) -> str:
    """Both test results with their counts."""
    t = evaluation.tests
    if t is None:
        return "The validation data are too short for residual tests."
    white = "white" if t.white else "not white"
    independent = "independent of the input" if t.independent else "not independent of the input"
    subject = "The one-step-ahead residuals" if one_step(evaluation) else "The residuals"
    return (
        f"{subject} are {white} ({t.whiteness_outside} of {len(t.lags) - 1} lags outside) and {independent} "
        f"({t.independence_outside} of {len(t.cross_lags)} lags outside)."
    )
