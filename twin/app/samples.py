"""Records and free runs of a session as files that a page opens at once, without reading a log again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import atomic_file, check_regular_file
from sysid.data.record import IOData
from twin.app.entries import LARGEST

WORD = 200  # letters of a name in a record
FIELDS = ("u_name", "y_name", "u_unit", "y_unit")  # of a record, kept as texts


@dataclass(frozen=True)
class Runs:
    """What a model gives under the input that it was fitted and validated with.

    t [s] from the start of the log, measured y and free run (N, ny) on the scale of the log, and the time `border` [s]
    at which validation begins; `outputs` are names with units.
    """

    t: np.ndarray
    y: np.ndarray
    run: np.ndarray
    border: float
    outputs: tuple[tuple[str, str], ...]


def save_record(data: IOData, path: Path) -> None:
    """Write a record."""
    missing = np.zeros(0, dtype=bool) if data.missing is None else data.missing
    words = {name: np.array(str(getattr(data, name))) for name in FIELDS}
    _write(path, u=data.u, y=data.y, Ts=np.array(data.Ts), missing=missing, **words)


def load_record(path: Path) -> IOData:
    """Read what `save_record` wrote; raises InputError for a file that is missing or damaged."""
    arrays = _read(path)
    try:
        missing = arrays["missing"] if arrays["missing"].size else None
        words: dict[str, Any] = {name: str(arrays[name])[:WORD] for name in FIELDS}
        return IOData(arrays["u"], arrays["y"], float(arrays["Ts"]), missing=missing, **words)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); add the log again") from None


def save_runs(evaluation: Any, start: float, path: Path) -> None:
    """Write the free runs of an evaluation whose record begins `start` [s] after that of the log."""
    estimation, parts = evaluation.estimation, [(evaluation.estimation, evaluation.estimation_output)]
    parts += [(evaluation.validation, evaluation.validation_output)] if evaluation.unseen else []
    offset = estimation.y_offset
    y = np.concatenate([np.where(part.observed, part.y, np.nan) for part, _ in parts]) + offset
    run = np.concatenate([np.reshape(output, part.y.shape) for part, output in parts]) + offset
    t = start + np.arange(len(y)) * estimation.Ts
    outputs = [(output.name, output.unit) for output in evaluation.outputs]
    names, units = zip(*(outputs or [(estimation.y_name, estimation.y_unit)]), strict=True)
    words = {"name": np.array(names), "unit": np.array(units)}
    _write(path, t=t, y=y, run=run, border=np.array(start + (estimation.N - 0.5) * estimation.Ts), **words)


def load_runs(path: Path) -> Runs:
    """Read what `save_runs` wrote; raises InputError for a file that is missing or damaged."""
    arrays = _read(path)
    try:
        t = np.asarray(arrays["t"], dtype=float)
        y, run = (np.asarray(arrays[name], dtype=float).reshape(len(t), -1) for name in ("y", "run"))
        names, units = (np.atleast_1d(arrays[word]) for word in ("name", "unit"))
        if not (t.ndim == 1 and y.shape == run.shape and y.shape[1:] == names.shape == units.shape):
            raise ValueError("the signals differ in length")
        if not (np.isfinite(t).all() and np.isfinite(y).any()):
            raise ValueError("the signals have no samples")
        outputs = tuple((str(name)[:WORD], str(unit)[:WORD]) for name, unit in zip(names, units, strict=True))
        return Runs(t, y, run, float(arrays["border"]), outputs)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path.name} is damaged ({error}); fit the model again") from None


def _write(path: Path, **arrays: np.ndarray) -> None:
    with atomic_file(path) as temporary:
        np.savez(temporary, **arrays)  # type: ignore[arg-type]


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive, which are at most `LARGEST` bytes: a packed file can be a thousandth of its content."""
    try:
        with ZipFile(check_regular_file(path)) as packed:
            if sum(member.file_size for member in packed.infolist()) > LARGEST:
                raise ValueError(f"its content is larger than {LARGEST // 2**20} MiB")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
            # numpy gives other members as bytes
            if not all(isinstance(array, np.ndarray) for array in arrays.values()):
                raise ValueError("one of its members is no array")
            return arrays
    except Exception as error:  # a damaged file fails in many ways inside numpy and zipfile
        raise InputError(f"{path.name} cannot be read ({error}); add the log, or fit the model, again") from None
