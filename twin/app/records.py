"""Records and free runs as files that a page opens at once, without reading a log again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import whole_file
from sysid.data.record import IOData

FIELDS = ("u_name", "y_name", "u_unit", "y_unit")


@dataclass(frozen=True)
class Runs:
    """What a model gives under the input that it was fitted and validated with.

    t [s] from the start of the log, measured y and free run (N,) on the scale of the log, and the time `border` [s]
    at which validation begins.
    """

    t: np.ndarray
    y: np.ndarray
    run: np.ndarray
    border: float
    name: str
    unit: str


def save(data: IOData, path: Path) -> None:
    """Write a record of one input and one output."""
    missing = np.zeros(0, dtype=bool) if data.missing is None else data.missing
    words = {name: np.array(str(getattr(data, name))) for name in FIELDS}
    _write(path, u=data.u, y=data.y, Ts=np.array(data.Ts), missing=missing, **words)


def load(path: Path) -> IOData:
    """Read what `save` wrote; raises InputError for a file that is missing or damaged."""
    found = _read(path)
    try:
        missing = found["missing"] if found["missing"].size else None
        words: dict[str, Any] = {name: str(found[name]) for name in FIELDS}
        return IOData(found["u"], found["y"], float(found["Ts"]), missing=missing, **words)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); add the log again") from None


def save_runs(found: Any, start: float, path: Path) -> None:
    """Write the free runs of an evaluation whose record begins `start` [s] after that of the log."""
    one, two = found.estimation, found.validation
    offset = one.y_offset[0]
    y = np.concatenate([np.where(part.observed[:, 0], part.y[:, 0], np.nan) for part in (one, two)]) + offset
    run = np.concatenate([np.ravel(found.estimation_output), np.ravel(found.validation_output)]) + offset
    t = start + np.arange(len(y)) * one.Ts
    words = {"name": np.array(one.y_name), "unit": np.array(one.y_unit)}
    _write(path, t=t, y=y, run=run, border=np.array(start + (one.N - 0.5) * one.Ts), **words)


def load_runs(path: Path) -> Runs:
    """Read what `save_runs` wrote; raises InputError for a file that is missing or damaged."""
    found = _read(path)
    try:
        t, y, run = (np.asarray(found[name], dtype=float) for name in ("t", "y", "run"))
        if not (t.ndim == 1 and t.shape == y.shape == run.shape):
            raise ValueError("the signals differ in length")
        return Runs(t, y, run, float(found["border"]), str(found["name"]), str(found["unit"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); fit the model again") from None


def _write(path: Path, **arrays: np.ndarray) -> None:
    with whole_file(path) as temporary:
        np.savez(temporary, **arrays)  # type: ignore[arg-type]


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            found = {name: file[name] for name in file.files}
            if not all(isinstance(array, np.ndarray) for array in found.values()):  # numpy gives other members as bytes
                raise ValueError("one of its members is no array")
            return found
    except Exception as error:  # a damaged file fails in many ways inside numpy and zipfile
        raise InputError(f"{path.name} cannot be read ({error}); add the log, or fit the model, again") from None
