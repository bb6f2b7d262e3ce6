"""A plant with known truth: a chain, its parameters and their source."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import IOData
from sysid.excitations import Aprbs
from sysid.model.chain import Chain


@dataclass(frozen=True)
class System:
    """A chain with true parameters theta (P,), sampled every Ts [s]; `span` [u] shows its maps."""

    name: str
    chain: Chain
    theta: np.ndarray
    Ts: float
    span: float
    source: str

    @property
    def poles(self) -> np.ndarray:
        """True poles in z, complex."""
        return self.chain.linear.poles(self.chain.part(self.theta, self.chain.linear))

    def record(self, N: int, noise: float, rng: np.random.Generator, hold: tuple[float, float] = (1.0, 20.0)) -> IOData:
        """N samples under an aprbs of this span, holds in samples; white noise of `noise` times the output's std."""
        u = Aprbs(self.span, hold[0] * self.Ts, hold[1] * self.Ts).generate(N, self.Ts, rng)
        y = self.chain.simulate(self.theta, u)
        return IOData(u, y + noise * y.std() * rng.standard_normal(N), self.Ts)

    def truth(self, u: np.ndarray) -> np.ndarray:
        """Noise-free output (N,) for the input u (N,)."""
        return self.chain.simulate(self.theta, u)
