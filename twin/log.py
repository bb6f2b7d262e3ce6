"""Log: what an excitation experiment recorded, and its three file formats."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data import IOData
from sysid.errors import InputError

COLUMNS = ("time_s", "voltage_V", "angle_rad", "angle_true_rad")


@dataclass(frozen=True)
class Log:
    """A record of one joint: commanded voltage u (N,) [V], measured angle y (N,) [rad], sampled every Ts [s].

    y[k] is read at t[k] = k Ts, before u[k] is applied over [t[k], t[k+1]). y_true (N,) [rad] is the angle between the
    links without noise and ADC, None where nobody knows it. `meta` can be written as JSON.
    """

    u: np.ndarray
    y: np.ndarray
    Ts: float
    y_true: np.ndarray | None = None
    joint: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s]."""
        return np.arange(self.N) * self.Ts

    def io(self) -> IOData:
        """Voltage and measured angle, ready to identify."""
        return IOData(self.u, self.y, self.Ts, "voltage", "angle", "V", "rad")

    def save(self, path: str | Path) -> Path:
        """Write .csv, .parquet or .mat by suffix, under a temporary name first so that no half-written file appears.

        CSV holds the columns alone; Parquet and MAT keep joint and meta too.
        """
        path = Path(path)
        write = _format(path)[0]
        if not path.parent.is_dir():
            raise InputError(f"{path}: there is no folder {path.parent}; make it first or choose another place")
        # The process number keeps two writers of the same log apart; the suffix tells MAT's writer to add none.
        temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
        try:
            write(self, temporary)
            os.replace(temporary, path)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from None
        finally:
            temporary.unlink(missing_ok=True)
        return path

    @staticmethod
    def load(path: str | Path) -> "Log":
        """Read what `save` wrote. Raises InputError for a file that is missing, damaged or not sampled uniformly."""
        path = Path(path)
        read = _format(path)[1]
        if not path.is_file():
            raise InputError(f"{path}: there is no such file; check the name")
        try:
            columns, meta = read(path)
        except InputError:
            raise
        except Exception as error:  # every reader has its own; the user needs the file's name
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise InputError(f"{path}: cannot be read as {path.suffix} ({reason}); write it again") from None
        return _checked(path, columns, meta)


def _checked(path: Path, columns: Mapping[str, np.ndarray], meta: dict[str, Any]) -> Log:
    for name in COLUMNS[:3]:
        if name not in columns:
            raise InputError(f"{path}: there is no column {name}; it has {', '.join(columns) or 'none'}")
    values = {name: np.asarray(columns[name]).ravel() for name in COLUMNS if name in columns}
    for name, column in values.items():
        if column.dtype.kind not in "iuf":
            raise InputError(f"{path}: column {name} holds something other than numbers; write numbers only")
        bad = np.flatnonzero(~np.isfinite(column))
        if len(bad):
            raise InputError(f"{path}: column {name} is {column[bad[0]]} in data row {bad[0] + 1}; fill or remove it")
    if len({len(column) for column in values.values()}) > 1 or len(values["time_s"]) < 2:
        raise InputError(f"{path}: the columns need one length of at least 2 rows; write the file again")
    time = values["time_s"].astype(float)
    step = (time[-1] - time[0]) / (len(time) - 1)
    off = np.abs(np.diff(time) - step)
    if not step > 0 or off.max() > 1e-3 * step:
        row = int(off.argmax()) + 2
        raise InputError(f"{path}: time_s is not uniform at data row {row}; resample the record to a fixed step")
    u, y, *true = (values[name].astype(float) for name in COLUMNS[1:] if name in values)
    Ts = float(meta.get("Ts", round(step, 9)))
    return Log(u, y, Ts, true[0] if true else None, str(meta.get("joint", "")), meta)


def _columns(log: Log) -> dict[str, np.ndarray]:
    columns = dict(zip(COLUMNS, (log.t, log.u, log.y), strict=False))
    return columns if log.y_true is None else columns | {COLUMNS[3]: log.y_true}


def _header(log: Log) -> str:
    return json.dumps({**log.meta, "joint": log.joint, "Ts": log.Ts})


def _write_csv(log: Log, path: Path) -> None:
    import polars

    polars.DataFrame(_columns(log)).with_columns(polars.col("time_s").round(9)).write_csv(path)


def _read_csv(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    import polars

    return _numpy(polars.read_csv(path)), {}


def _write_parquet(log: Log, path: Path) -> None:
    import polars

    polars.DataFrame(_columns(log)).write_parquet(path, metadata={"qpal": _header(log)})


def _read_parquet(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    import polars

    meta = polars.read_parquet_metadata(path).get("qpal", "{}")
    return _numpy(polars.read_parquet(path)), json.loads(meta)


def _numpy(frame: Any) -> dict[str, np.ndarray]:
    return {name: frame[name].to_numpy() for name in frame.columns}


def _write_mat(log: Log, path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {**_columns(log), "qpal": _header(log)}, oned_as="column")


def _read_mat(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    import scipy.io

    content = scipy.io.loadmat(path)
    meta = content.get("qpal")
    return {k: v for k, v in content.items() if k in COLUMNS}, {} if meta is None else json.loads(str(meta.ravel()[0]))


_Writer = Callable[[Log, Path], None]
_Reader = Callable[[Path], tuple[dict[str, np.ndarray], dict[str, Any]]]
_FORMATS: dict[str, tuple[_Writer, _Reader]] = {
    ".csv": (_write_csv, _read_csv),
    ".parquet": (_write_parquet, _read_parquet),
    ".mat": (_write_mat, _read_mat),
}


def _format(path: Path) -> tuple[_Writer, _Reader]:
    if path.suffix not in _FORMATS:
        raise InputError(
            f"{path}: a log cannot be {path.suffix or 'without suffix'}; end its name in {', '.join(_FORMATS)}"
        )
    return _FORMATS[path.suffix]
