"""What figures and tables of a report say alike."""

from sysid.nlarx.result import ONE_STEP, NlarxFit
from sysid.workflow.evaluation import Evaluation


def one_step(evaluation: Evaluation) -> bool:
    """Whether the criteria and residuals of a fit are about one step ahead instead of its free run."""
    return isinstance(evaluation.fit, NlarxFit) and evaluation.fit.criteria_of == ONE_STEP


def tests_in_words(evaluation: Evaluation) -> str:
    """Both verdicts with their counts."""
    t = evaluation.tests
    if t is None:
        return "The validation part is too short for residual tests."
    white = "white" if t.white else "not white"
    independent = "independent of the input" if t.independent else "not independent of the input"
    subject = "The residuals one step ahead" if one_step(evaluation) else "The residuals"
    return (
        f"{subject} are {white} ({t.whiteness_outside} of {len(t.lags) - 1} lags outside) and {independent} "
        f"({t.independence_outside} of {len(t.cross_lags)} lags outside)."
    )
