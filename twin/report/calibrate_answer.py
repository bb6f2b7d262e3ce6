"""The first screen of `qpal calibrate`: how much of a log the calibrated twin explains, and what it determines."""

from sysid.base.quantities import display_quantity, estimate, percent
from sysid.diagnosis.worth import worth
from sysid.report.answer import POOR, Answer, Word
from sysid.report.page import Grid, Picture
from twin.calibrate import advice
from twin.calibrate.result import Calibration, Score


def answer(result: Calibration, picture: Picture, next_step: str) -> Answer:
    """The first screen; `picture` is that of the `judged_run`."""
    score = judged(result)
    kind = "held out" if score.held_out else "used for the fit"
    return Answer(
        percent(score.fit_after),
        f"of {score.log} ({kind}) explained by the calibrated twin; {percent(score.fit_before)} before",
        word(result),
        sentence(result),
        picture,
        values=values(result),
        next=next_step,
    )


def judged(result: Calibration) -> Score:
    """The worst score of those that count: of the held-out logs if there are any."""
    held_out = [score for score in result.scores if score.held_out]
    return min(held_out or result.scores, key=lambda score: score.fit_after)


def judged_run(result: Calibration) -> int:
    """The number of its run."""
    score = judged(result)
    return next(k for k, run in enumerate(result.runs) if (run.name, run.held_out) == (score.log, score.held_out))


def word(result: Calibration) -> Word:
    """As `worth` says; sound on a held-out log if all is determined; poor also as the exit code says, or worse on a
    held-out log."""
    score = judged(result)
    if not result.converged or advice.useless(result) or _worse(score):
        return POOR
    is_open = bool(advice.undetermined_rows(result) or result.differing)
    return worth(score.fit_after, result.runs[judged_run(result)].tests, score.held_out and not is_open)


def _worse(score: Score) -> bool:
    return score.held_out and score.fit_after < score.fit_before


def sentence(result: Calibration) -> str:
    """Why the word."""
    names = [name.rpartition(".")[2].replace("_", " ") for name in advice.undetermined_rows(result)]
    if not result.converged:
        return "The search did not converge: do not use the file."
    if advice.useless(result):
        return "These logs determine none of the parameters: do not use the file."
    if _worse(judged(result)):
        return f"On {judged(result).log}, which was held out, the twin is worse than before: do not use the file."
    if word(result) == POOR:
        score = judged(result)
        return f"The twin follows {score.log} to {percent(score.fit_after)} only: it lacks something that the leg has."
    if result.differing:
        return f"The logs do not agree in {result.differing[0].name}: each has a value of its own."
    if names:
        return f"Not determined: {', '.join(names)}; do not use the file for {'these' if names[1:] else 'it'}."
    doubt = "" if judged(result).held_out else "; no log was held out (--hold-out) to judge the twin"
    kept = len(result.fixed)
    if kept:
        others = (
            f"{kept} other{'s keep their values' if kept > 1 else ' keeps its value'}, which these logs cannot tell"
        )
        return f"Every calibrated parameter is determined; {others}{doubt}."
    return f"Every parameter is determined{doubt}."


def values(result: Calibration) -> Grid:
    """The calibrated values, determined ones first."""
    open_names = advice.undetermined_rows(result)
    rows = []
    for v in sorted(result.values, key=lambda v: v.name in open_names):
        q = display_quantity(v.name, v.unit)
        shown, low, high = estimate(*(q.factor * x for x in (v.value, v.low, v.high)))
        interval = "not determined" if v.name in open_names else f"{low} to {high}"
        rows.append((v.name.rpartition(".")[2].replace("_", " "), shown, interval, q.unit))
    return Grid(("", "calibrated", f"{100 * result.level:g} % interval", "unit"), rows, last_text=True)
