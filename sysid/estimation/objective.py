"""What a fit minimises: squared free-run errors, and what may be put on top of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError


@dataclass(frozen=True)
class Objective:
    """Options of the cost; the default is plain least squares.

    robust: corner of Huber's loss in multiples of the residuals' own spread (1.345 keeps 95 % efficiency under Gaussian
    noise, Huber 1964), None for squares. ridge: weight of the pull towards `nominal` (name -> value; 0 where not
    named), each parameter measured in its own nominal size; 0 for none. weights: one factor for each output's error.
    calm: a bend of a free map by its own mean slope costs as much as an error of `calm` noise standard deviations in
    one sample. Data decide wherever there are data; a segment that two noisy samples would bend anywhere, and with it
    all that lies beyond, stays near its neighbour. 0 for none.
    """

    robust: float | None = None
    ridge: float = 0.0
    nominal: Mapping[str, float] = field(default_factory=dict)
    weights: tuple[float, ...] = ()
    calm: float = 1.0

    def __post_init__(self) -> None:
        if self.robust is not None and not 0.0 < self.robust < np.inf:
            raise InputError(f"robust is {self.robust}; give a positive number of spreads, for example 1.345, or None")
        if not 0.0 <= self.ridge < np.inf:
            raise InputError(f"ridge is {self.ridge}; give 0 or a positive weight")
        if not 0.0 <= self.calm < np.inf:
            raise InputError(f"calm is {self.calm}; give 0 or a positive number of noise deviations")
        if any(not 0.0 < w < np.inf for w in self.weights):
            raise InputError(f"weights are {self.weights}; give one positive number for each output")


def huber(e: np.ndarray, corner: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors r (N,) whose squares sum to Huber's loss of e (N,), and dr/de (N,).

    r = e within the corner and sign(e) sqrt(2 c |e| - c^2) beyond, so that a least-squares search minimises it.
    """
    size = np.abs(e)
    beyond = size > corner
    root = np.sqrt(np.where(beyond, 2.0 * corner * size - corner**2, 1.0))
    return np.where(beyond, np.sign(e) * root, e), np.where(beyond, corner / root, 1.0)


def spread(e: np.ndarray) -> float:
    """Standard deviation of Gaussian errors e (N,) from their median absolute deviation, blind to outliers."""
    return float(1.4826 * np.median(np.abs(e - np.median(e))))
