"""Integrator between two stops."""

from dataclasses import dataclass

import numpy as np

from sysid.block.block import Block, Slot, Symmetry


@dataclass(frozen=True)
class LimitedIntegrator(Block):
    """x_{t+1} = x_t + gain w_t, held between `lower` and `upper`; x_0 is estimated.

    For a plant whose speed does not remember: where inertia matters a stop also takes the speed away, see `Motor`. The
    derivative at a stop is that of the stop.
    """

    def slots(self) -> tuple[Slot, ...]:
        return (Slot("gain"), Slot("lower"), Slot("upper"), Slot("x0", initial=True))

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        from sysid.block.kernels_motion import limited_integrator

        y = np.empty_like(x)
        gain, lower, upper, start = (float(value) for value in theta)
        limited_integrator(gain, lower, upper, start, x, y, J, q if J.shape[1] else 0)
        return y

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.array([1.0 / max(float(np.abs(x).sum()), 1e-9), -1.0, 1.0, 0.0])

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(theta[1] < theta[2])

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        own = np.array([theta[0], 0.0, 0.0, 0.0])
        return [
            Symmetry(-own, in_scale=1.0),
            Symmetry(theta.copy(), out_scale=1.0),
            Symmetry(np.array([0.0, 1.0, 1.0, 1.0]), out_shift=1.0),
        ]
