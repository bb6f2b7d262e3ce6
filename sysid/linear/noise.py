"""The colour of a fit's residuals as a model: white noise behind 1/A(q)."""

from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.diagnosis.residuals import chance, residual_tests
from sysid.estimation.noise_model import noise_model as autoregression
from sysid.estimation.result import Fit

_LAGS, _LEVEL = 25, 0.99


@dataclass(frozen=True)
class Noise:
    """A(q) e(t) = w(t) of the residuals e, with w white: A (order + 1,) from its leading 1, and the variance of w.

    `white` says whether a test at 99 % leaves the residuals white; then the order is seldom above 0. `variance` and
    `total`, that of e, are in `unit`, that of the output, squared.
    """

    A: np.ndarray
    variance: float
    total: float
    white: bool
    Ts: float
    unit: str = ""

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.A) - 1

    @property
    def poles(self) -> np.ndarray:
        """Poles of the noise in z (order,), complex."""
        return np.roots(self.A).astype(complex)

    def sentence(self) -> str:
        """What the colour is, and what it means."""
        if self.white or not self.order:
            return "The residuals are white: what the model leaves of the output is noise."
        terms = " ".join(f"{'+' if c >= 0 else '−'} {number(abs(c), 4)} q^-{k}" for k, c in enumerate(self.A[1:], 1))
        q = display_quantity("", self.unit)
        w, e = (number(float(np.sqrt(v)) * q.factor, 3) for v in (self.variance, self.total))
        return (
            f"The residuals are coloured: A(q) e = w with A = 1 {terms}, and w has a standard deviation of {w} where e "
            f"has {e}{f' {q.unit}' if q.unit else ''}. Either the noise is coloured or the model lacks dynamics: try "
            "higher orders, or sysid.select(data)."
        )


@checked
def noise_model(fit: Fit, data: IOData) -> Noise:
    """The noise of one output from the residuals of `fit` on `data`, of the order of the least AIC, up to 8.

    On the record of the fit it counts only what no parameter can follow, so it is not whitened by the fit itself.
    Raises InputError for several outputs and for records too short to test.
    """
    if data.y.shape[1] != 1:
        raise InputError(
            f"the record has {data.y.shape[1]} outputs; a noise model here is that of one: fit one of them"
        )
    e = np.ravel(fit.residuals(data))
    if not np.all(np.isfinite(e)):
        raise InputError(f"no residuals: {fit.divergence(data)}")
    skip = (data.N - len(e)) // len(data.lengths)
    lengths = [n - skip for n in data.lengths]
    V = np.zeros((len(e), 0))
    if data is fit.record and len(lengths) == 1 and fit.model.channels == (1, 1):
        J = fit.model.tangent(fit.theta, data.u[:, 0], data.y)[1][skip:, fit.model.free]
        V = _span(J)
    model = autoregression(e, V, lengths)
    tests = residual_tests(e, np.zeros(len(e)), min(_LAGS, (len(e) - 1) // 2), _LEVEL)
    white = chance(tests.autocorrelation[1:], tests.whiteness_bound, _LEVEL)
    return Noise(model.A, model.variance, float(np.mean(e**2)), bool(white), fit.Ts, data.y_unit)


def _span(J: np.ndarray) -> np.ndarray:
    """Orthonormal columns (N, r) of what the parameters can follow."""
    size = np.linalg.norm(J, axis=0)
    J = J[:, size > 0] / size[size > 0]
    if not J.shape[1]:
        return J
    U, s, _ = np.linalg.svd(J, full_matrices=False)
    directions: np.ndarray = U[:, s > 1e-7 * s[0]]
    return directions
