"""The delay from an input to an output of a record, before any model."""

from dataclasses import dataclass

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.diagnosis import response
from sysid.diagnosis.whitening import whiten


@dataclass(frozen=True)
class DelayEstimate:
    """Delay nk and its interval low..high in samples of Ts [s]; nk is None where no lag of the input has an effect.

    `p` is the probability that chance explains all lags together, `level` the confidence of the interval.
    """

    nk: int | None
    low: int
    high: int
    p: float
    Ts: float
    level: float

    def __str__(self) -> str:
        if self.nk is None:
            said = f"no response within {self.high} samples (p = {self.p:.2g} without any)"
            return f"{said}; check that the columns belong together"
        between = "" if self.low == self.high else f", {self.low} to {self.high} with {100 * self.level:g} % confidence"
        return f"nk = {self.nk} ({self.nk * self.Ts:g} s){between}"


@checked(late=True)
def delay(data: IOData, input: int = 0, output: int = 0, level: float = 0.99) -> DelayEstimate:
    """The delay nk of a model from input to output, both numbered from 0, with an interval of the confidence `level`.

    nk 1 is the least of a plant that is sampled before its input changes. Low-order models of every delay are compared,
    their errors whitened, so that slow noise neither hides nor feigns a delay. The first 20,000 samples are used.
    Raises InputError for a channel that is not there, for a level that is no probability, and for a record that is too
    short or constant.
    """
    for what, k, n in (("input", input, data.u.shape[1]), ("output", output, data.y.shape[1])):
        if not 0 <= k < n:
            raise InputError(f"{what} is {k}; the record has {n}, numbered from 0")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a probability between 0 and 1, for example 0.99")
    with one_blas_thread():
        white = whiten(data, output)
        if white is None:
            raise InputError(f"{data.N} samples are too few, or constant, to see a delay; record more")
        found = response.delay(white, input, 1.0 - level)
    return DelayEstimate(found.nk, found.low, found.high, found.p, data.Ts, level)
