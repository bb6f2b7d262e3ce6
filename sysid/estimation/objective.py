"""The cost of a fit: squared free-run errors with optional robust loss, weights and penalties."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.estimation.prior import Prior

_FEWEST = 12  # knots: fewer than the search itself uses
_SMALLEST = 1e-100  # threshold: errors divided by less overflow


@checked
@dataclass(frozen=True)
class Objective:
    """Options of the cost: least squares, with a prior on the maps whose break points the model does not count.

    huber_threshold: the error at which Huber's loss becomes linear, in standard deviations of the residuals (1.345
    keeps 95 % efficiency under Gaussian noise, Huber 1964), None for squares. ridge: weight of the distance to
    `nominal` (name -> value; 0 if not named), relative to the nominal size of each parameter; 0 for none. weights: one
    factor for each output's error. curvature_weight: a kink of a free map as large as its mean slope costs as much as
    an error of `curvature_weight` noise standard deviations in one sample; 0 for none. Where there are data, they
    determine the map. A segment with only a few noisy samples, and the extrapolation beyond it, keep nearly the slope
    of the neighbour. knots: break points that a piecewise linear map without a number of its own ends with, at fixed
    places, with a prior on its changes of slope whose width the record chooses (`sysid.estimation.finer_maps`); 0 keeps
    the 10 free ones of the search, as MATLAB does, and so does a ridge. shapes: whether such a map becomes a straight
    line, a parabola, a cubic, a saturation, a dead zone or both where BIC says so (`sysid.estimation.named_maps`).
    prior: what is known of the parameters of the model beside the record, instead of a ridge; a fit with one needs a
    `start`.
    """

    huber_threshold: float | None = None
    ridge: float = 0.0
    nominal: Mapping[str, float] = field(default_factory=dict)
    weights: tuple[float, ...] = ()
    curvature_weight: float = 1.0
    knots: int = 50
    shapes: bool = True
    prior: Prior | None = None

    def __post_init__(self) -> None:
        if self.huber_threshold is not None and not _SMALLEST <= self.huber_threshold < np.inf:
            raise InputError(
                f"huber_threshold is {self.huber_threshold}; give a number of at least {_SMALLEST:g}, for example "
                "1.345, or None"
            )
        if not 0.0 <= self.ridge < np.inf:
            raise InputError(f"ridge is {self.ridge}; give 0 or a positive weight")
        if not 0.0 <= self.curvature_weight < np.inf:
            raise InputError(
                f"curvature_weight is {self.curvature_weight}; give 0 or a positive number of noise deviations"
            )
        if self.knots and self.knots < _FEWEST:
            raise InputError(
                f"knots is {self.knots}; give at least {_FEWEST}, for example 50, or 0 for the model's own"
            )
        if any(not 0.0 < w < np.inf for w in self.weights):
            raise InputError(f"weights are {self.weights}; give one positive number for each output")


LEAST_SQUARES = Objective()


def huber(e: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors r (N,) whose squares sum to Huber's loss of e (N,), and dr/de (N,).

    r = e within the threshold c and sign(e) sqrt(2 c |e| - c^2) beyond, so that a least-squares search minimises it.
    """
    size = np.abs(e)
    beyond = size > threshold
    root = np.sqrt(np.where(beyond, 2.0 * threshold * size - threshold**2, 1.0))
    return np.where(beyond, np.sign(e) * root, e), np.where(beyond, threshold / root, 1.0)


def spread(e: np.ndarray) -> float:
    """Standard deviation of Gaussian errors e (N,) from their median absolute deviation, robust to outliers."""
    return float(1.4826 * np.median(np.abs(e - np.median(e))))
