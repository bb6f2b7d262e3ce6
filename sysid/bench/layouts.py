"""Data sets in other people's layouts as tasks: objects of `nonlinear_benchmarks`, and folders of identibench.

Only sets of one input and one output; others are refused with a sentence.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.rates import same_rate
from sysid.bench.task import Task
from sysid.data.record import IOData

DROP = 50  # samples of a test that give the initial state where the set does not tell


def of_objects(
    train: Any,
    test: Any,
    unit: str = "",
    orders: tuple[int, int, int] | None = None,
    published: Mapping[str, str] | None = None,
) -> Task:
    """The task of what a function of the package `nonlinear_benchmarks` returns: (train, test), each a set or several.

    Such a set has u and y (N,) or (N, 1), `sampling_time` [s] (None: 1), `name`, and in tests
    `state_initialization_window_length`, the samples that are known and not scored. Raises InputError for several
    channels and for parts without samples in common rates.
    """
    parts = [(_label(part, k), part) for k, part in enumerate(_as_tuple(test), 1)]
    records = {name: _of_object(part, name) for name, part in parts}
    if len(records) < len(parts):  # two tests of one name
        records = _number(_of_object(part, name) for name, part in parts)
    windows = [part.state_initialization_window_length or 0 for _, part in parts]
    record = IOData.merge(*(_of_object(part, "the estimation record") for part in _as_tuple(train)))
    _one_rate("the set", record, records)
    return Task(
        record,
        records,
        max(windows) or DROP,
        unit,
        orders,
        published=dict(published or {}),
        given="a set of nonlinear_benchmarks",
    )


@dataclass(frozen=True)
class Ready:
    """A family of tasks that exist already, by scenario."""

    tasks: Mapping[str, Task] = field(repr=False)
    name: str = "ready"
    about: str = "tasks that were made elsewhere"

    def scenarios(self) -> Sequence[str]:
        """Names of the tasks."""
        return sorted(self.tasks)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        if scenario not in self.tasks:
            raise unknown("scenario", scenario, self.tasks)
        return self.tasks[scenario]


@dataclass(frozen=True)
class Files:
    """Sets on the disk as identibench 0.4 keeps them: `folder` is one set, or its folders are.

    A set has folders train, valid and test of .hdf5 files, one record each, and sometimes train_valid, the records of
    the first two before they were cut. A file holds the data sets u0 and y0 (N,) and the attributes fs [Hz] and, in
    tests, init_sz, the samples that are known and not scored. The estimation data is train_valid, else train and valid;
    every file of a folder whose name begins with test is a test. `drop` holds where no file has init_sz.
    """

    folder: str
    name: str = "files"
    about: str = "data sets in the layout of identibench"
    drop: int = DROP
    unit: str = ""

    def scenarios(self) -> Sequence[str]:
        """Names of the sets. Raises InputError for a folder without any."""
        return sorted(self._sets())

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`. Raises InputError also for several channels and for a damaged file."""
        places = self._sets()
        if scenario not in places:
            raise unknown("data set", scenario, places)
        place = places[scenario]
        train = _hdf5(place / "train_valid") or [*_hdf5(place / "train"), *_hdf5(place / "valid")]
        if not train:
            raise InputError(
                f"{place} has no .hdf5 file in train_valid, train or valid; put the training records there"
            )
        tests, windows = dict[str, IOData](), [0]
        for path in _tests(place):
            record, window = _of_file(path)
            name = path.stem if path.stem not in tests else f"{path.parent.name}/{path.stem}"
            tests[name] = record
            windows.append(window)
        record = IOData.merge(*(_of_file(path)[0] for path in train))
        _one_rate(place, record, tests)
        return Task(record, tests, max(windows) or self.drop, self.unit, given=f"files of {place.name}")

    def _sets(self) -> dict[str, Path]:
        root = Path(self.folder)
        places = [root, *sorted(p for p in root.iterdir() if p.is_dir())] if root.is_dir() else []
        sets = {place.resolve().name: place for place in places if _tests(place)}
        if not sets:
            raise InputError(
                f"{root} holds no data set; give a folder with train/*.hdf5 and test/*.hdf5, or one of such folders"
            )
        return sets


def _hdf5(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.hdf5"))


def _tests(place: Path) -> list[Path]:
    return sorted(place.glob("test*/*.hdf5"))


def _of_file(path: Path) -> tuple[IOData, int]:
    """Record of one file, and its number of known samples, 0 if it does not tell."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            columns = {name: np.asarray(item, dtype=float) for name, item in file.items() if np.ndim(item) == 1}
            rate, window = float(file.attrs.get("fs", 1.0)), int(file.attrs.get("init_sz", 0))
    except OSError as error:
        raise InputError(f"{path} is no HDF5 file ({error}); copy it again from its source") from None
    _check_single(path, *(sum(name.rstrip("0123456789") == kind for name in columns) for kind in "uy"))
    if "u0" not in columns or "y0" not in columns or not rate > 0.0:
        raise InputError(f"{path} has columns {', '.join(columns)} at {rate} Hz; it needs u0, y0 and a rate above 0")
    return IOData(columns["u0"], columns["y0"], 1.0 / rate), window


def _of_object(part: Any, name: str) -> IOData:
    u, y = (np.asarray(values, dtype=float) for values in (part.u, part.y))
    _check_single(name, *(1 if x.ndim == 1 else int(np.prod(x.shape[1:])) for x in (u, y)))
    return IOData(u.ravel(), y.ravel(), 1.0 if part.sampling_time is None else float(part.sampling_time))


def _check_single(place: object, inputs: int, outputs: int) -> None:
    if (inputs, outputs) != (1, 1):
        raise InputError(
            f"{place} has {inputs} input(s) u0, u1, ... and {outputs} output(s) y0, y1, ...; this benchmark takes sets "
            "of one each: choose one of either"
        )


def _one_rate(place: object, train: IOData, tests: Mapping[str, IOData]) -> None:
    for name, test in tests.items():
        if not same_rate(test.Ts, train.Ts):
            raise InputError(
                f"{place}: test {name} is sampled every {test.Ts} s and the estimation record every {train.Ts} s; "
                "resample one of them (sysid.data.resampling.resample)"
            )


def _as_tuple(parts: Any) -> tuple[Any, ...]:
    return tuple(parts) if isinstance(parts, tuple | list) else (parts,)


def _label(part: Any, k: int) -> str:
    return str(getattr(part, "name", "") or f"test {k}")


def _number(records: Iterable[IOData]) -> dict[str, IOData]:
    return {f"test {k}": record for k, record in enumerate(records, 1)}
