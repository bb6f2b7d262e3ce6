"""Log: what an excitation experiment recorded, and its three file formats."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data import IOData
from sysid.errors import InputError, unknown
from sysid.files import whole_file
from twin.logs import read_table
from twin.parameters import JOINTS, LEG

TIME = "time_s"
INPUTS = {"voltage": "voltage", "servo": "reference"}  # name of the input by mode


@dataclass(frozen=True)
class Log:
    """A record of one joint: input u (N,) [V], measured angle y (N,) [rad], sampled every Ts [s].

    u is the voltage that was asked for or, in servo mode, the reference of the position loop. y[k] is read at
    t[k] = k Ts, before u[k] is applied over [t[k], t[k+1]). y_true (N,) [rad] is what the potentiometer would have
    shown then without noise, ADC and dropped samples (its nonlinearity is in it), None where nobody knows it. A record
    of all three joints has joint "leg" and u, y, y_true (N, 3) in the order of `JOINTS`. `meta` can be written as JSON.
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

    @property
    def mode(self) -> str:
        """How the joint was driven: "voltage" or "servo"."""
        return str(self.meta.get("mode", "voltage"))

    def io(self, joint: str | None = None) -> IOData:
        """Input and measured angle, ready to identify; of `joint` alone where the log has all three."""
        u, y = self.u, self.y
        if joint is not None and joint != self.joint:
            if self.joint != LEG or joint not in JOINTS:
                raise unknown("joint of this log", joint, JOINTS if self.joint == LEG else (self.joint,))
            u, y = u[:, JOINTS.index(joint)], y[:, JOINTS.index(joint)]
        return IOData(u, y, self.Ts, INPUTS[self.mode], "angle", "V", "rad")

    def save(self, path: str | Path) -> Path:
        """Write .csv, .parquet or .mat by suffix, under a temporary name first so that no half-written file appears.

        CSV holds the columns alone; Parquet and MAT keep joint and meta too.
        """
        path = Path(path)
        write = _format(path)[0]
        if not path.parent.is_dir():
            raise InputError(f"{path}: there is no folder {path.parent}; make it first or choose another place")
        try:
            with whole_file(path) as temporary:
                write(self, temporary)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from None
        return path

    @staticmethod
    def load(path: str | Path) -> "Log":
        """Read what `save` wrote; joint and meta are empty from a CSV.

        Raises InputError, which names the place, for a file that is missing, damaged or not sampled uniformly.
        """
        path = Path(path)
        read_meta = _format(path)[1]
        table = read_table(path)
        meta = read_meta(path)
        joint, mode = _kind(table.names, meta)
        names = column_names(joint, mode)
        required = [TIME, *names[0], *names[1]]
        values = {
            name: table.numbers(name) for name in (*required, *names[2]) if name in table.names or name in required
        }
        t = values[TIME]
        if len({len(column) for column in values.values()}) > 1 or len(t) < 2:
            raise InputError(f"{path}: the columns need one length of at least 2 rows; write the file again")
        steps = np.diff(t)
        off = np.abs(steps - np.median(steps))
        if steps.min() <= 0 or off.max() > 1e-3 * np.median(steps):
            j, k = table.names.index(TIME), int(off.argmax()) + 1
            raise table.error(j, k, f"found a step of {steps[k - 1]:g} s; resample the record to one step")
        u, y, true = ([values[name] for name in group if name in values] for group in names)
        return Log(
            _joined(u),
            _joined(y),
            float(meta.get("Ts", f"{steps.mean():.9g}")),
            _joined(true) if len(true) == len(y) else None,
            joint,
            meta if mode == "voltage" else {**meta, "mode": mode},
        )


def column_names(joint: str, mode: str) -> tuple[list[str], list[str], list[str]]:
    """Names of a file's columns of input, measured angle and true angle."""
    parts = [f"_{each}" for each in JOINTS] if joint == LEG else [""]
    return (
        [f"{INPUTS[mode]}{part}_V" for part in parts],
        [f"angle{part}_rad" for part in parts],
        [f"angle_true{part}_rad" for part in parts],
    )


def _kind(names: Sequence[str], meta: Mapping[str, Any]) -> tuple[str, str]:
    """Joint and mode of a log with these columns."""
    for mode in INPUTS:
        for joint in (LEG, str(meta.get("joint", ""))):
            if column_names(joint, mode)[0][0] in names:
                return joint, mode
    return str(meta.get("joint", "")), "voltage"


def _joined(columns: list[np.ndarray]) -> np.ndarray:
    return columns[0] if len(columns) == 1 else np.column_stack(columns)


def _columns(log: Log) -> dict[str, np.ndarray]:
    names = column_names(log.joint, log.mode)
    columns = {TIME: log.t}
    for group, values in zip(names, (log.u, log.y, log.y_true), strict=True):
        if values is not None:
            columns |= dict(zip(group, values.reshape(log.N, -1).T, strict=True))
    return columns


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
