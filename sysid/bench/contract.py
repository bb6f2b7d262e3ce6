"""The contract of a method: a function `fit(data)` that returns a model with `simulate(u, y_init)`.

A method in an environment of its own reads this file by its path, so it needs numpy alone.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True)
class Data:
    """What a method gets: experiments of one input and one output, and what is known beforehand.

    u and y hold one array (N,) an experiment, sampled every Ts [s]; `missing` marks outputs that were not measured,
    whose y lies on a straight line between their neighbours. `orders` are (nb, nf, nk) of a linear model that suits
    the plant, None if nobody knows. A method should end within `seconds`; all its random numbers come from `seed`,
    which is below 2^20.
    """

    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]
    missing: tuple[np.ndarray, ...]
    Ts: float
    orders: tuple[int, int, int] | None
    seconds: float
    seed: int


class Model(Protocol):
    """What a method returns.

    Two attributes are optional. `poles` are its discrete-time poles (n,). `details` is a dictionary of JSON values:
    `stop`, a sentence that says why the search ended; `loss`, the mean squared free-run error on the data;
    `structure`, the orders that it chose; `intervals`, {"pole": [[re, im, half axis of re, of im], ...]} at 95 %.
    """

    def simulate(self, u: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Free run (N,) for the input u (N,): the first outputs y_init (n,) are known and give the initial state."""
        ...


def details_of(model: Any) -> dict[str, Any]:
    """The optional attributes of a model as JSON values."""
    found = dict(getattr(model, "details", None) or {})
    poles = getattr(model, "poles", None)
    if poles is not None:
        found["poles"] = [[float(z.real), float(z.imag)] for z in np.asarray(poles, dtype=complex).ravel()]
    return found
