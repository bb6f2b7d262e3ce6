"""Linear block B(q)/A(q) whose output a state estimator predicts: an ARMAX model in innovations form."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.base.checks import checked
from sysid.block.block import Law, Slot
from sysid.block.symmetry import block_diagonal
from sysid.block.writing import Writer
from sysid.blocks._predictor import Predictor
from sysid.blocks.transfer_function import TransferFunction


@checked(deferred=("nb", "nf", "nk"))
@dataclass(frozen=True)
class Innovations(Predictor):
    """A y = B w + C e with white e: the f of A, as many c of C, and a full initial state, as in `TransferFunction`.

    Its free run is that of B/A, with poles anywhere. Its predictor C yhat = B w + (C - A) y is stable wherever the
    poles are, since the roots of C stay inside the unit circle or at 1: those of the state estimator, whose steady
    Kalman gain in observer form is c - f (Ljung, System Identification, 2nd ed. 1999, sections 4.2 and 4.3).
    """

    stability: str = "free"

    @cached_property
    def _estimator(self) -> TransferFunction:
        """B/C with the initial state."""
        return TransferFunction(self.nb, self.nf, self.nk)

    @cached_property
    def _feedback(self) -> TransferFunction:
        """(C - A)/C."""
        return TransferFunction(max(self.nf, 1), self.nf, 1, initial_state=False)

    def _of_estimator(self, theta: np.ndarray) -> np.ndarray:
        """Parameters of `_estimator`: C takes the place of A."""
        b, _, x0 = self.split(theta)
        return np.concatenate([b, theta[self.states.stop :], x0])

    def slots(self) -> tuple[Slot, ...]:
        return (*super().slots(), *(Slot(f"c{j + 1}") for j in range(self.nf)))

    def admissible(self, theta: np.ndarray) -> bool:
        return self._estimator.admissible(self._of_estimator(theta))

    def basis(self) -> np.ndarray:
        plain = super().basis()[: self.states.stop, : self.states.stop]
        f = slice(self.nb, self.nb + self.nf)
        return block_diagonal(plain, plain[f, f])

    def at_low(self, theta: np.ndarray) -> np.ndarray:
        low = self._estimator.at_low(self._of_estimator(theta))
        f = slice(self.nb, self.nb + self.nf)
        return np.concatenate([np.zeros(self.states.stop, dtype=bool), low[f]])

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """A real root of C beyond 1 is moved to 1."""
        repaired = self._estimator.repair(self._of_estimator(theta))
        return np.concatenate([theta[: self.states.stop], repaired[self.nb : self.nb + self.nf]])

    def predict_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int, y: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The prediction of y (N, 1) one step ahead, and its tangent."""
        J, n, own = Js[0], self.nf, Js[0].shape[1] > 0
        f, c = self.split(theta)[1], theta[self.states.stop :]
        yhat = self._estimator.propagate(self._of_estimator(theta), xs[0], J, q)
        if n:
            K = np.empty((len(yhat), 2 * n if own else 0))
            measured = np.ascontiguousarray(y[:, 0])
            yhat = yhat + self._feedback.propagate(np.concatenate([c - f, c]), measured, K, 0)
            if own:
                J[:, q + self.states.stop : q + self.n_parameters] = (
                    J[:, q + self.nb : q + self.nb + n] + K[:, :n] + K[:, n:]
                )
                J[:, q + self.nb : q + self.nb + n] = -K[:, :n]
        return [yhat], Js

    def noise(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.append(1.0, theta[self.states.stop :]), np.append(1.0, self.split(theta)[1])

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        C = w.sum([(1.0, ""), *((value, f"z^-{j}") for j, value in enumerate(theta[self.states.stop :], 1))])
        return [*super().equations(theta, w), f"  C(z) = {C}, of the estimator; no part of this free run"]

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        sizes = np.repeat([b[0] / a[0], 1.0, b[0], 1.0], [self.nb, self.nf, self.n_state, self.nf])
        return Law(self, np.diag(sizes))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The same plant with an estimator of other roots."""
        fresh = theta.copy()
        other = self._estimator.vary(self._of_estimator(theta), rng)
        fresh[self.states.stop :] = other[self.nb : self.nb + self.nf]
        return fresh
