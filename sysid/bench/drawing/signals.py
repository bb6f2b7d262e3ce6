"""Inputs and noise drawn at random."""

import numpy as np
from scipy.signal import lfilter

from sysid.excitations import Aprbs, Multisine

INPUTS = ("aprbs", "multisine", "slow noise", "random steps")
NOISES = ("white", "coloured", "growing with the input")
SLOWEST = 40.0
COLOUR = 0.9  # pole of coloured noise


def excitation(kind: str, N: int, rng: np.random.Generator) -> np.ndarray:
    """An input (N,) of standard deviation 1, with parts of up to `SLOWEST` samples, less for short records."""
    slowest = min(SLOWEST, N / 20)
    if kind == "aprbs":
        u = Aprbs(1.0, 1.0, max(3.0, slowest)).generate(N, 1.0, rng)
    elif kind == "multisine":
        u = Multisine(1.0, 1.0 / N, 0.25, phases="random").generate(N, 1.0, rng)
        u = u + 0.5 * lfilter([1.0], [1.0, -0.95], rng.standard_normal(N))
    elif kind == "slow noise":
        pole = float(np.exp(-3.0 / slowest))
        u = lfilter([1.0], [1.0, -pole], rng.standard_normal(N))
    else:
        holds = rng.integers(1, int(2 * slowest) + 3, N)
        u = np.repeat(rng.standard_normal(N), holds)[:N]
    return np.asarray(u / u.std())


def noise(kind: str, u: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise (N,) of variance 1 on average; "growing with the input" is white with a deviation that follows |u|."""
    if kind == "coloured":
        return coloured(len(u), COLOUR, rng)
    e = rng.standard_normal(len(u))
    if kind == "growing with the input":
        size = 0.3 + np.abs(u) / u.std()
        return np.asarray(e * size / np.sqrt(np.mean(size**2)))
    return e


def coloured(N: int, memory: float, rng: np.random.Generator) -> np.ndarray:
    """Noise v (N,) of variance 1 with v(t) = memory v(t-1) + e(t); white at a memory of 0."""
    return np.asarray(np.sqrt(1.0 - memory**2) * lfilter([1.0], [1.0, -memory], rng.standard_normal(N)))
