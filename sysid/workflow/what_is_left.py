"""What a free run leaves of the output beside the noise of a reading: a constant, a slow error, or no more than noise.

That the input explains nothing of it does not make a model good: a search that ended early, a model that follows only
the data that it was fitted to, and another zero leave errors that are independent of the input too.
"""

from dataclasses import dataclass

import numpy as np

from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.diagnosis.residuals import CLOSE, ResidualTests
from sysid.estimation.result import Fit
from sysid.joint.stops import reading_noise, rounding_deviation
from sysid.nlarx.result import NlarxFit
from sysid.structures import TABLE
from sysid.workflow.results import Evaluation

MANY = 3.0  # times the noise of a reading: noise is then a ninth of the squared error, and does not limit the fit
WORSE = 2.0  # times the error on the estimation data: what the fit left there is a quarter of the squared error
_CONSTANT = 2.0  # times the rest: a constant is then four fifths of the squared error
ERROR = "the error"
LARGER = "a larger model may explain it"
_ROUNDED = 1.1  # times the deviation of the rounding: a fifth of the squared error at most is something else
_ONLY_NOISE = 1.5  # times the noise of a reading: half of the squared rest at most is something else


@dataclass(frozen=True)
class Left:
    """The error of a free run of the output that is followed worst, in its unit; `output` is its number from 0.

    `noise` is the standard deviation of a reading, `rounding` what its steps alone have, `size` the root mean square of
    the error, `constants` its median in each experiment, and `rest` what is left without them.
    """

    noise: float
    size: float
    constants: tuple[float, ...]
    rest: float
    output: int
    rounding: float = 0.0

    @property
    def times(self) -> float:
        """The error in noises of a reading; infinite of a record without noise."""
        with np.errstate(over="ignore"):
            return float(np.divide(self.size, self.noise)) if self.noise > 0.0 else np.inf if self.size > 0.0 else 0.0

    @property
    def rounded(self) -> bool:
        """Whether the rounding of the readings is the error: a reading depends on the input by it, and a model lacks
        nothing.
        """
        return 0.0 < self.size <= _ROUNDED * self.rounding

    @property
    def many(self) -> bool:
        """Whether noise does not limit the fit."""
        return self.times > MANY

    @property
    def multiple(self) -> str:
        """The error beside the noise, in words."""
        return f"{number(self.times, 2)} times the noise of a reading" if np.isfinite(self.times) else "no noise"

    @np.errstate(over="ignore", invalid="ignore")
    def constant(self, name: str, unit: str, error: str = ERROR) -> str:
        """The sentence on an `error` that is mostly a constant; empty for another one. `name`, `unit` of the output."""
        shift = float(np.sqrt(np.mean(np.square(self.constants))))
        if not shift > _CONSTANT * max(self.rest, self.noise):
            return ""
        q = display_quantity(name, unit)
        low, high = (number(q.factor * end(self.constants), 3) for end in (min, max))
        is_noise = self.rest <= _ONLY_NOISE * self.noise
        only = "only noise" if is_noise else f"{number(q.factor * self.rest, 3)} {q.unit}"
        slow = "" if is_noise else ", or something slow that the model lacks"
        if low == high:
            return f"{error} is a constant {low} {q.unit}: another zero{slow}; apart from it {only}".replace("  ", " ")
        return (
            f"{error} is a constant in each experiment, from {low} to {high} {q.unit}: their zeros differ{slow}; "
            f"apart from them {only}"
        )


def left_of(data: IOData, run: np.ndarray, n_init: int) -> Left:
    """What a run (N,) or (N, ny) leaves of the record after the first `n_init` samples of each experiment."""
    scored = data.observed & np.concatenate([np.arange(n) >= n_init for n in data.lengths])[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.where(scored, data.y - np.reshape(run, data.y.shape), np.nan)
        rms = np.sqrt(np.nanmean(error**2, axis=0))
    rms = np.nan_to_num(rms, nan=np.inf)
    ends = np.cumsum(data.lengths)[:-1]
    noises = [reading_noise(data, j) for j in range(data.y.shape[1])]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        k = int(np.argmax(np.nan_to_num(rms / np.array(noises), nan=0.0, posinf=np.inf)))
    parts = [part[np.isfinite(part)] for part in np.split(error[:, k], ends)]
    parts = [part for part in parts if len(part)]
    medians = [float(np.median(part)) for part in parts]
    deviations = np.concatenate([np.abs(part - m) for part, m in zip(parts, medians, strict=True)] or [[np.inf]])
    rounding = rounding_deviation(data.y[data.observed[:, k], k])
    return Left(noises[k], float(rms[k]), tuple(medians or [0.0]), _spread(deviations), k, rounding)


def _spread(deviations: np.ndarray) -> float:
    """Standard deviation by the median: the start, where the zero of the model still acts, does not count."""
    return 1.4826 * float(np.median(deviations))


def systematic(e: Evaluation) -> str:
    """Why an error that noise does not explain keeps a model from being good; empty where nothing says so."""
    if _close(e):
        return ""
    left = _left(e)
    return _constant(e, left) or _unexplained(e, left)


def unexplained(e: Evaluation) -> str:
    """What another search or another structure may take from the error on the validation data; empty if hardly any."""
    if _close(e) or _constant(e, left := _left(e)):
        return ""
    return _unexplained(e, left)


def _left(e: Evaluation) -> Left:
    return left_of(e.validation, _runs(e)[1], e.fit.n_init)


def _runs(e: Evaluation) -> tuple[np.ndarray, np.ndarray]:
    """The runs that are judged on both parts: the prediction one step ahead where a free run adds up every error."""
    if e.growing is not None and e.one_step is not None:
        return e.one_step.estimation_output, e.one_step.validation_output
    return e.estimation_output, e.validation_output


def _close(e: Evaluation) -> bool:
    """Whether an error is not judged: within `CLOSE` points of all, or of data that were fitted."""
    return not e.unseen or e.judged_fit >= 100.0 - CLOSE


def zeros_differ(e: Evaluation) -> bool:
    """Whether the errors of the logs are apart by more than the rest of the error."""
    left = _left(e)
    return max(left.constants) - min(left.constants) > left.rest


def rounded(e: Evaluation) -> bool:
    """Whether the rounding of the readings is all that the model leaves."""
    return e.growing is None and e.unseen and _left(e).rounded


def _constant(e: Evaluation, left: Left) -> str:
    """That the error on the validation data is mostly a constant; empty of another one."""
    output = e.outputs[left.output] if e.outputs else None
    name, unit = (output.name, output.unit) if output else (e.validation.y_name, e.validation.y_unit)
    return left.constant(name, unit, _error(e))


def _error(e: Evaluation) -> str:
    return ERROR if e.growing is None else f"{ERROR} one step ahead"


def _unexplained(e: Evaluation, left: Left) -> str:
    """The sentence of `unexplained` on an error that is no constant."""
    if not left.many:
        return ""
    error = f"{_error(e)} is {left.multiple}"
    if not (e.fit.stop.converged or e.joint_fit is not None):
        return f"the search did not converge, and {error}"
    seen = left_of(e.estimation, _runs(e)[0], e.fit.n_init)
    if left.size > WORSE * seen.size:
        return f"{error} and {number(left.size / seen.size, 2)} times that on the estimation data"
    return slow(left, e.fit, e.tests, _error(e))


def slow(left: Left, fit: Fit | NlarxFit, tests: ResidualTests | None, error: str = ERROR) -> str:
    """That a model may lack something: its `error` has memory and is many times the noise of a reading.

    A joint's residuals are rarely white, and no other structure fits better; the free run of a model that predicts
    leaves the noise of the plant, whose memory it predicts.
    """
    recipe = TABLE.get(fit.model.structure)
    accounted = (recipe is not None and recipe.with_parts) or (fit.predicts and error == ERROR)
    if accounted or tests is None or tests.white or not left.many:
        return ""
    return f"{error} is slow and {left.multiple}; {LARGER}"


def lasts(e: Evaluation) -> bool:
    """Whether the slowest time constant is longer than the record."""
    return float(np.abs(e.poles).max(initial=0.0)) > np.exp(-1.0 / max(e.estimation.lengths))
