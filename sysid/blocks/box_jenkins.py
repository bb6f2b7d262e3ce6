"""Linear block B(q)/F(q) beside noise C(q)/D(q) with roots of its own: a Box-Jenkins model."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot
from sysid.block.symmetry import block_diagonal
from sysid.block.writing import Writer
from sysid.blocks._predictor import Predictor
from sysid.blocks.transfer_function import TransferFunction


@checked(deferred=("nb", "nf", "nk", "nc", "nd"))
@dataclass(frozen=True)
class BoxJenkins(Predictor):
    """y = B/F w + C/D e with white e: nc coefficients of C and nd of D after the parameters of `TransferFunction`.

    The predictor is y - D/C (y - B/F w) (Ljung, System Identification, 2nd ed. 1999, section 4.2), with noise at rest
    before the record. No root of F, C or D leaves the unit circle, and a root at 1 is allowed.
    """

    nc: int = 2
    nd: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(isinstance(k, (int, np.integer)) and k >= 0 for k in (self.nc, self.nd)):
            raise InputError(f"orders nc, nd are {(self.nc, self.nd)}; give integers from 0 up")

    @property
    def orders(self) -> dict[str, int]:
        return {**super().orders, "nc": self.nc, "nd": self.nd}

    @cached_property
    def plant(self) -> TransferFunction:
        """B/F with the initial state."""
        return TransferFunction(self.nb, self.nf, self.nk, stability=self.stability)

    @cached_property
    def _places(self) -> list[tuple[slice, TransferFunction]]:
        """C and D as 1/C and 1/D: a filter of these coefficients knows their limits, and how a search takes them."""
        n = self.states.stop
        ends = ((n, n + self.nc), (n + self.nc, n + self.nc + self.nd))
        return [(slice(a, b), TransferFunction(1, b - a, 0, initial_state=False)) for a, b in ends]

    def slots(self) -> tuple[Slot, ...]:
        names = [f"{letter}{j + 1}" for letter, n in (("c", self.nc), ("d", self.nd)) for j in range(n)]
        return (*super().slots(), *map(Slot, names))

    def noise(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, d = (theta[place] for place, _ in self._places)
        return np.append(1.0, c), np.append(1.0, d)

    def admissible(self, theta: np.ndarray) -> bool:
        roots = (inverse.admissible(np.append(1.0, theta[place])) for place, inverse in self._places)
        return super().admissible(theta) and all(roots)

    def basis(self) -> np.ndarray:
        return block_diagonal(self.plant.basis(), *(inverse.basis()[1:, 1:] for _, inverse in self._places))

    def at_low(self, theta: np.ndarray) -> np.ndarray:
        low = [inverse.at_low(np.append(1.0, theta[place]))[1:] for place, inverse in self._places]
        return np.concatenate([self.plant.at_low(theta[: self.states.stop]), *low])

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """A real root of F, C or D beyond 1 is moved to 1."""
        repaired = super().repair(theta).copy()
        for place, inverse in self._places:
            repaired[place] = inverse.repair(np.append(1.0, repaired[place]))[1:]
        return repaired

    def predict_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int, y: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The prediction of y (N, 1) one step ahead, and its tangent."""
        J, n, own = Js[0], q + self.states.stop, Js[0].shape[1] > 0
        c, d = (theta[place] for place, _ in self._places)
        v = y[:, 0] - self.plant.propagate(theta[: self.states.stop], xs[0], J, q)
        whitening = TransferFunction(self.nd + 1, self.nc, 0, initial_state=False)  # D/C
        K = np.empty((len(v), n + whitening.n_parameters if own else 0))
        K[:, :n] = J[:, :n]  # of the free run: the prediction moves by D/C of what it moves, and e by the opposite
        e = whitening.propagate(np.concatenate([[1.0], d, c]), v, K, n)
        if own:
            J[:, :n] = K[:, :n]
            of_d, of_c = -K[:, n + 1 : n + 1 + self.nd], -K[:, n + 1 + self.nd :]
            J[:, n : n + self.nc], J[:, n + self.nc : n + self.nc + self.nd] = of_c, of_d
        return [y[:, 0] - e], Js

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        C, D = (
            w.sum([(1.0, ""), *((value, f"z^-{j}") for j, value in enumerate(values[1:], 1))])
            for values in self.noise(theta)
        )
        return [
            *super().equations(theta, w),
            f"  C(z) = {C}, D(z) = {D}, of the noise C/D e; no part of this free run",
        ]

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        sizes = np.repeat([b[0] / a[0], 1.0, b[0], 1.0], [self.nb, self.nf, self.n_state, self.nc + self.nd])
        return Law(self, np.diag(sizes))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Other poles of the plant beside the same noise."""
        n = self.states.stop
        return np.concatenate([self.plant.vary(theta[:n], rng), theta[n:]])
