"""What linear blocks that predict measured outputs have in common: a noise model C/D beside B/F."""

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Piecewise
from sysid.block.symmetry import Symmetry
from sysid.blocks.transfer_function import TransferFunction


@checked(deferred=("nb", "nf", "nk"))
@dataclass(frozen=True)
class Predictor(TransferFunction):
    """y = B/F w + H e with white e and a monic H, which predicts y from all measured outputs before."""

    predicts = True

    @abstractmethod
    def noise(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H as C (n,) and D (m,) in powers of q^-1, each from its leading 1."""

    def ahead(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """y(t | t-horizon) (N,) from w = x (N,) and the measured y (N,); the first samples from the initial state.

        The prediction lacks the white noise of the last `horizon` samples, each times its value of H's impulse
        response, and nothing else (Ljung, System Identification, 2nd ed. 1999, section 3.2).
        """
        from scipy.signal import lfilter  # half a second, which no help text waits for

        e = y - self.predict_all(theta, [x], [np.empty((len(x), 0))], 0, y[:, None])[0][0]
        return np.asarray(y - lfilter(self._response(theta, min(horizon, len(y))), [1.0], e))

    def error_spread(self, theta: np.ndarray, horizon: int) -> np.ndarray:
        """Deviations (horizon,) of the errors of predictions 1, 2, ... samples ahead for e of variance 1."""
        return np.sqrt(np.cumsum(self._response(theta, horizon) ** 2))

    def _response(self, theta: np.ndarray, n: int) -> np.ndarray:
        """The first n values of H's impulse response."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(*self.noise(theta), np.eye(1, n)[0]))

    def piecewise(self, theta: np.ndarray, q: int, P: int) -> Piecewise | None:
        return None  # a search needs predictions, which take the whole record

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """Only the gain can move: a shift of the input moves the prediction, which begins at measured outputs."""
        scaling = np.zeros_like(theta)
        scaling[: self.nb] = theta[: self.nb]
        return [Symmetry(-scaling, in_scale=1.0)]
