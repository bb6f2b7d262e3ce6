"""The contract of a method, a function `fit(data)` that returns a model with `simulate(u, y_init)`, and peak memory.

The worker of a method in an environment of its own reads this file by its path, so it needs numpy alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

# Peak memory since a moment, as Linux counts it: a 5 written to the first sets the count back (man 5 proc).
_RESET, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
MOST_POLES = 1000  # more are not compared: the true ones are a dozen
LONGEST = 1000  # letters of a sentence in the table
PASSED = (KeyboardInterrupt,)  # what ends a run, whoever raises it: a person's Ctrl-C


@dataclass(frozen=True)
class Data:
    """What a method gets: experiments of one input and one output, and what is known beforehand.

    u and y hold one array (N,) an experiment, sampled every Ts [s]; `missing` marks outputs that were not measured,
    whose y lies on a straight line between their neighbours. `orders` are (nb, nf, nk) of a linear model that suits
    the plant, None if nobody knows. A method should end within `seconds`; all its random numbers come from `seed`,
    which is below 2^20. `model` is what a reference record states of its system, None of any other: `blocks` in series,
    values `fixed` by name, and a `start`, {name: value}, of the parameters to estimate; the system begins at rest.
    """

    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]
    missing: tuple[np.ndarray, ...]
    Ts: float
    orders: tuple[int, int, int] | None
    seconds: float
    seed: int
    model: Mapping[str, Any] | None = None


class Model(Protocol):
    """What a method returns.

    Two attributes are optional. `poles` are its discrete-time poles (n,). `details` is a dictionary of JSON values:
    `stop`, a sentence that says why the search ended; `loss`, the mean squared free-run error on the data;
    `structure`, the orders that it chose; `intervals`, {"pole": [[re, im, half axis of re, of im], ...]} at 95 %;
    `values` and `deviations`, {name: number}, the estimates of a stated model and their standard deviations.
    """

    def simulate(self, u: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Free run (N,) for the input u (N,): the first outputs y_init (n,) are known and give the initial state."""
        ...


def checked_run(values: Any, N: int) -> np.ndarray:
    """A free run as (N,) of floats, also if it came as a row or a column. Raises ValueError for anything else."""
    run = np.asarray(np.ma.filled(values, np.nan) if isinstance(values, np.ma.MaskedArray) else values)
    if run.dtype == object and run.ndim:
        run = np.array([number(value) for value in run.ravel()]).reshape(run.shape)
    if run.dtype.kind not in "biuf" or run.ndim == 0:
        raise ValueError(f"simulate gave {kind_of(values)}; it must give an array of {N} numbers")
    if run.size != N or max(run.shape) != N:
        raise ValueError(f"simulate gave {run.size} samples for {N}, of shape {run.shape}")
    with np.errstate(over="ignore"):
        return run.astype(float).ravel()


def details_of(model: Any) -> dict[str, Any]:
    """What a model tells of itself by its optional attributes, as JSON values; see `checked_details`."""
    try:
        details, poles = getattr(model, "details", None), getattr(model, "poles", None)
        if poles is not None and isinstance(details, dict | None):
            pairs = [[float(z.real), float(z.imag)] for z in np.asarray(poles, dtype=complex).ravel()[: MOST_POLES + 1]]
            details = {**(details or {}), "poles": pairs}
        return checked_details(details)
    except PASSED:
        raise
    except BaseException as error:  # an attribute may be a property that does anything
        return {"stop": f"its details cannot be had: {text_of(error)}"}


def checked_details(details: Any) -> dict[str, Any]:
    """Of what a model tells of itself the parts that are as `Model` says, as JSON values; the others are left out.

    `stop` says so if it is no dictionary at all.
    """
    if details is None:
        return {}
    if not isinstance(details, Mapping):
        return {"stop": f"its details are {kind_of(details)}; give a dictionary"}
    valid: dict[str, Any] = {name: text_of(details[name], LONGEST) for name in ("stop", "structure") if name in details}
    loss = number(details.get("loss"))
    valid |= {"loss": loss} if np.isfinite(loss) else {}
    poles = _rows(details.get("poles"), 2)
    if poles is not None and np.isfinite(poles).all():
        valid["poles"] = poles.tolist()
    claims = details.get("intervals")
    claims = _rows(claims.get("pole"), 4) if isinstance(claims, Mapping) else None
    if claims is not None and np.isfinite(claims[:, :2]).all():
        valid["intervals"] = {"pole": claims.tolist()}
    for name in ("values", "deviations"):
        if isinstance(details.get(name), Mapping):
            valid[name] = {text_of(key): number(value) for key, value in list(details[name].items())[:MOST_POLES]}
    return valid


def _rows(value: Any, width: int) -> np.ndarray | None:
    """value as (n, width) of floats, at most `MOST_POLES`; None if it is not that."""
    if not isinstance(value, list | tuple | np.ndarray) or not 0 < len(value) <= MOST_POLES:
        return None
    try:
        rows = np.array(value)
        return rows.astype(float).reshape(-1, width) if rows.dtype.kind in "iuf" else None
    except (TypeError, ValueError, RecursionError):
        return None


def number(value: Any) -> float:
    """value as a float; nan for what is no real number, text included."""
    if isinstance(value, int | float | np.integer | np.floating):
        try:
            return float(value)
        except OverflowError:
            return float("inf")
    return float("nan")


def text_of(value: Any, most: int = 300) -> str:
    """The text of whatever it is, an exception with its kind; control characters are spaces, and its end is cut."""
    try:
        text = str.__str__(value) if isinstance(value, str) else str(value)
        text = f"{type(value).__name__}: {text}" if isinstance(value, BaseException) else text
        text = text[:most].encode("utf-8", "replace").decode("utf-8")
        return "".join(c if c.isprintable() else " " for c in text).strip()
    except PASSED:
        raise
    except BaseException:  # its text is had by a method of its own, which may do anything
        return f"{kind_of(value)} without a text"


def kind_of(value: Any) -> str:
    """What it is, in a word or two."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    return {type(None): "nothing"}.get(type(value), f"a value of type {type(value).__name__}")


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
