"""Linear blocks drawn at random: orders, poles of every kind, zeros, delay."""

import numpy as np

from sysid.blocks import TransferFunction

KINDS = ("real", "complex", "clustered", "near the circle", "negative")
SINGLE = ("real", "negative")  # kinds of a single pole
SLOWEST = 60.0  # samples of the longest time constant, and a tenth of the record at most


def linear(
    rng: np.random.Generator, N: int, nf: int, role: str, nb: int | None = None, nk: int | None = None
) -> tuple[TransferFunction, np.ndarray, str]:
    """A transfer function, its parameters from rest (P,), and the kind of its poles, for records of N samples.

    Of nf poles one pair is of the drawn kind, the others are real. B has up to three coefficients (nb) and its zeros
    within 1.5 of the origin, the delay nk is up to 4 samples; the steady-state gain is 1 in size.
    """
    slowest = min(SLOWEST, N / 10)
    kind = str(rng.choice(KINDS if nf > 1 else SINGLE))
    z = _pair(kind, rng, slowest)[:nf]
    z = np.concatenate([z, [_real(rng, slowest) for _ in range(nf - len(z))]])
    nb = int(rng.integers(1, min(nf + 1, 3) + 1)) if nb is None else nb
    delay = int(rng.integers(0, 5)) if nk is None else nk
    f, b = np.real(np.poly(z))[1:], np.atleast_1d(np.real(np.poly(_zeros(rng, nb - 1))))
    b = b * (1.0 + f.sum()) / b.sum() * rng.choice([-1.0, 1.0])
    block = TransferFunction(nb, nf, delay, role=role)
    return block, np.concatenate([b, f, np.zeros(block.n_state)]), kind


def _real(rng: np.random.Generator, slowest: float) -> complex:
    return complex(np.exp(-1.0 / np.exp(rng.uniform(np.log(1.5), np.log(slowest)))))


def _pair(kind: str, rng: np.random.Generator, slowest: float) -> np.ndarray:
    """Two poles of the kind; one for a negative pole."""
    if kind == "real":
        return np.array([_real(rng, slowest), _real(rng, slowest)])
    if kind == "negative":
        return np.array([-rng.uniform(0.3, 0.85) + 0j])
    if kind == "clustered":
        first = _real(rng, slowest)
        return np.array([first, 1.0 - (1.0 - first) * rng.uniform(1.02, 1.2)])
    radius = np.exp(-1.0 / rng.uniform(0.5, 1.0) / slowest) if kind == "near the circle" else rng.uniform(0.4, 0.95)
    angle = rng.uniform(0.05, 0.6) * np.pi
    return radius * np.exp(1j * np.array([angle, -angle]))


def _zeros(rng: np.random.Generator, count: int) -> np.ndarray:
    """Real zeros, or a complex pair; none nearer than 0.1 to z = 1, where the gain would vanish."""
    if count == 2 and rng.random() < 0.5:
        at = rng.uniform(0.2, 1.3) * np.exp(1j * rng.uniform(0.15, 0.9) * np.pi)
        return np.array([at, at.conjugate()])
    found = rng.uniform(-1.5, 0.9, count)
    return found.astype(complex)
