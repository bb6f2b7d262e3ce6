"""The functions of NIST's StRD nonlinear regression sets, written from their published definitions.

`FUNCTIONS` has y = f(b, x) by set, for b of real or complex numbers (P,) and predictors x (k, N): complex ones give
exact derivatives. https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml
"""

from collections.abc import Callable

import numpy as np

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _bumps(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Gauss1 to Gauss3: two Gaussians on a decaying exponential."""
    x = x[0]
    first, second = (b[k] * np.exp(-(((x - b[k + 1]) / b[k + 2]) ** 2)) for k in (2, 5))
    return b[0] * np.exp(-b[1] * x) + first + second


def _three_decays(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Lanczos1 to Lanczos3."""
    return sum(b[k] * np.exp(-b[k + 1] * x[0]) for k in (0, 2, 4))


def _cubics(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Hahn1 and Thurber: a cubic over a cubic."""
    x = x[0]
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))


def _decay_over_line(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Chwirut1 and Chwirut2."""
    return np.exp(-b[0] * x[0]) / (b[1] + b[2] * x[0])


def _rise(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Misra1a and BoxBOD."""
    return b[0] * (1.0 - np.exp(-b[1] * x[0]))


def _enso(b: np.ndarray, x: np.ndarray) -> np.ndarray:
    waves = [(1, 12.0), (4, b[3]), (7, b[6])]
    angles = [(k, 2.0 * np.pi * x[0] / period) for k, period in waves]
    return b[0] + sum(b[k] * np.cos(angle) + b[k + 1] * np.sin(angle) for k, angle in angles)


FUNCTIONS: dict[str, Function] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x[0]) ** (-1.0 / b[2]),
    "BoxBOD": _rise,
    "Chwirut1": _decay_over_line,
    "Chwirut2": _decay_over_line,
    "DanWood": lambda b, x: b[0] * x[0] ** b[1],
    "ENSO": _enso,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x[0] - b[2]) / b[1]) ** 2),
    "Gauss1": _bumps,
    "Gauss2": _bumps,
    "Gauss3": _bumps,
    "Hahn1": _cubics,
    "Kirby2": lambda b, x: (b[0] + x[0] * (b[1] + x[0] * b[2])) / (1.0 + x[0] * (b[3] + x[0] * b[4])),
    "Lanczos1": _three_decays,
    "Lanczos2": _three_decays,
    "Lanczos3": _three_decays,
    "MGH09": lambda b, x: b[0] * (x[0] ** 2 + x[0] * b[1]) / (x[0] ** 2 + x[0] * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x[0] + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x[0] * b[3]) + b[2] * np.exp(-x[0] * b[4]),
    "Misra1a": _rise,
    "Misra1b": lambda b, x: b[0] * (1.0 - (1.0 + 0.5 * b[1] * x[0]) ** -2.0),
    "Misra1c": lambda b, x: b[0] * (1.0 - (1.0 + 2.0 * b[1] * x[0]) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x[0] / (1.0 + b[1] * x[0]),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),  # of log y
    "Rat42": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x[0])),
    "Rat43": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x[0])) ** (1.0 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x[0] - np.arctan(b[2] / (x[0] - b[3])) / np.pi,
    "Thurber": _cubics,
}
LOGARITHM = ("Nelson",)  # sets whose function gives the logarithm of y
