"""The contract of a method, a function `fit(data)` that returns a model with `simulate(u, y_init)`, and peak memory.

The worker of a method in an environment of its own reads this file by its path, so it needs numpy alone.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

# Peak memory since a moment, as Linux counts it: a 5 written to the first sets the count back (man 5 proc).
_RESET, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")


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
    details = dict(getattr(model, "details", None) or {})
    poles = getattr(model, "poles", None)
    if poles is not None:
        details["poles"] = [[float(z.real), float(z.imag)] for z in np.asarray(poles, dtype=complex).ravel()]
    return details


def start_peak() -> None:
    """Count the peak memory from now on, where the system can."""
    try:
        _RESET.write_text("5")
    except OSError:
        return


def peak() -> float:
    """Peak resident memory [MiB] since `start_peak`; nan where the system does not tell."""
    try:
        rows = _STATUS.read_text().splitlines()
    except OSError:
        return float("nan")
    return next((int(row.split()[1]) / 1024 for row in rows if row.startswith("VmHWM")), float("nan"))
