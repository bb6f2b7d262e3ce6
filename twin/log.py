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
from twin.logs import read_table

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
        """Read what `save` wrote; joint and meta are empty from a CSV.

        Raises InputError, which names the place, for a file that is missing, damaged or not sampled uniformly.
        """
        path = Path(path)
        read_meta = _format(path)[1]
        table = read_table(path)
        values = [table.numbers(name) for name in COLUMNS if name in table.names or name in COLUMNS[:3]]
        if len({len(column) for column in values}) > 1 or len(values[0]) < 2:
            raise InputError(f"{path}: the columns need one length of at least 2 rows; write the file again")
        steps = np.diff(values[0])
        off = np.abs(steps - np.median(steps))
        if steps.min() <= 0 or off.max() > 1e-3 * np.median(steps):
            j, k = table.names.index(COLUMNS[0]), int(off.argmax()) + 1
            raise table.error(j, k, f"found a step of {steps[k - 1]:g} s; resample the record to one step")
        meta = read_meta(path)
        Ts = float(meta.get("Ts", f"{steps.mean():.9g}"))
        return Log(values[1], values[2], Ts, values[3] if len(values) > 3 else None, str(meta.get("joint", "")), meta)


def _columns(log: Log) -> dict[str, np.ndarray]:
    columns = dict(zip(COLUMNS, (log.t, log.u, log.y), strict=False))
    return columns if log.y_true is None else columns | {COLUMNS[3]: log.y_true}


def _header(log: Log) -> str:
    return json.dumps({**log.meta, "joint": log.joint, "Ts": log.Ts})


def _write_csv(log: Log, path: Path) -> None:
    import polars

    polars.DataFrame(_columns(log)).with_columns(polars.col("time_s").round(9)).write_csv(path)


def _no_meta(path: Path) -> dict[str, Any]:
    return {}


def _write_parquet(log: Log, path: Path) -> None:
    import polars

    polars.DataFrame(_columns(log)).write_parquet(path, metadata={"qpal": _header(log)})


def _parquet_meta(path: Path) -> dict[str, Any]:
    import polars

    return json.loads(polars.read_parquet_metadata(path).get("qpal", "{}"))


def _write_mat(log: Log, path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {**_columns(log), "qpal": _header(log)}, oned_as="column")


def _mat_meta(path: Path) -> dict[str, Any]:
    import scipy.io

    text = scipy.io.loadmat(path, variable_names=["qpal"]).get("qpal")
    return {} if text is None else json.loads(str(text.ravel()[0]))


_Writer = Callable[[Log, Path], None]
_MetaReader = Callable[[Path], dict[str, Any]]
_FORMATS: dict[str, tuple[_Writer, _MetaReader]] = {
    ".csv": (_write_csv, _no_meta),
    ".parquet": (_write_parquet, _parquet_meta),
    ".mat": (_write_mat, _mat_meta),
}


def _format(path: Path) -> tuple[_Writer, _MetaReader]:
    if path.suffix not in _FORMATS:
        raise InputError(
            f"{path}: a log cannot be {path.suffix or 'without suffix'}; end its name in {', '.join(_FORMATS)}"
        )
    return _FORMATS[path.suffix]
