"""Task: what one scenario and seed give to a method, and how it is judged. Family: where tasks come from.

`export` writes a task as files that any program reads: CSV for signals, JSON for what is known of the plant.
"""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import json_value, write_text
from sysid.bench.contract import Data
from sysid.data.record import IOData
from sysid.model.chain import Chain

SEEDS = 2**20  # of a method: generators of some libraries take no larger ones


@dataclass(frozen=True)
class Truth:
    """What is known of a synthetic plant: noise-free outputs (N,) of the tests, and noise-free output of the
    estimation record, the standard deviation of the noise on it, poles in z, and chain and parameters if it is a chain.
    """

    y: Mapping[str, np.ndarray]
    noise: float
    poles: np.ndarray | None = None
    chain: Chain | None = None
    theta: np.ndarray | None = None


@dataclass(frozen=True)
class Task:
    """An estimation record, and test records by name whose first `drop` samples are known and not scored.

    Split, dropped samples and the unit of errors travel with it. `orders` are told to every method. `published` are
    errors of other people's models by the same protocol, in `unit`. `given` says in words what was drawn. `model` is
    what the record states of its system, see `sysid.bench.contract.Data`.
    """

    train: IOData
    tests: Mapping[str, IOData]
    drop: int
    unit: str = ""
    orders: tuple[int, int, int] | None = None
    truth: Truth | None = None
    published: Mapping[str, str] = field(default_factory=dict)
    given: str = ""
    model: Mapping[str, Any] | None = None

    def data(self, seconds: float, seed: int) -> Data:
        """The estimation record as a method gets it."""
        parts = self.train.experiments
        return Data(
            tuple(e.u[:, 0] for e in parts),
            tuple(e.y[:, 0] for e in parts),
            tuple(~e.observed[:, 0] for e in parts),
            self.train.Ts,
            self.orders,
            seconds,
            seed % SEEDS,
            self.model,
        )


class Family(Protocol):
    """Scenarios of one kind. A scenario is a name; with a seed it becomes a task. Objects travel to other processes."""

    @property
    def name(self) -> str:
        """First part of the names of its scenarios."""
        ...

    @property
    def about(self) -> str:
        """What its scenarios are, in a few words."""
        ...

    def scenarios(self) -> Sequence[str]:
        """Names of its scenarios, without the family's name."""
        ...

    def make(self, scenario: str, seed: int) -> Task:
        """The task of one scenario and seed, always the same. Raises InputError if its records are not there."""
        ...


def export(task: Task, folder: str | Path) -> Path:
    """Write a task into a new or empty folder, which is returned; every number reads back as it was.

    train.csv and one CSV a test, with columns t [s], u, y, and y_true in tests of a known plant; an output that was
    not measured is empty. A record of several experiments becomes train-1.csv, train-2.csv and so on. scenario.json:
    Ts [s], drop, unit, orders, and the file and length of each record. truth.json, for a known plant: standard
    deviation of the noise, poles in z, structure, parameters by name. Raises InputError for a folder that is in use.
    """
    place = check_empty(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make {place}: {error.strerror}; choose a folder that you may write to") from None
    tests = {}
    for k, (name, test) in enumerate(task.tests.items(), 1):
        clean = None if task.truth is None else task.truth.y.get(name)
        file = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
        tests[name] = _write_record(place, "test" if len(task.tests) == 1 else f"test-{k}-{file}", test, clean)
    files = {"train": _write_record(place, "train", task.train, None), "tests": tests}
    facts = {"Ts": task.train.Ts, "drop": task.drop, "unit": task.unit, "orders": task.orders, "given": task.given}
    _write_json(place / "scenario.json", facts | {"published": dict(task.published)} | files)
    if task.truth is not None:
        _write_json(place / "truth.json", _facts_of_truth(task, task.truth))
    return place


def check_empty(folder: str | Path) -> Path:
    """The folder, which is new or empty; raises InputError for one that is in use."""
    place = Path(folder)
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise InputError(f"{place} is not empty; give a new folder")
    return place


def _write_record(folder: Path, name: str, record: IOData, clean: np.ndarray | None) -> list[dict[str, Any]]:
    """Write the CSV files of one record; returns what scenario.json says of them."""
    parts, entries, begin = record.experiments, [], 0
    for k, part in enumerate(parts, 1):
        file = f"{name}.csv" if len(parts) == 1 else f"{name}-{k}.csv"
        columns = [part.t, part.u[:, 0], np.where(part.observed[:, 0], part.y[:, 0], np.nan)]
        if clean is not None:
            columns.append(np.asarray(clean)[begin : begin + part.N])
        write_text(folder / file, _csv(("t", "u", "y", "y_true")[: len(columns)], columns))
        entries.append({"file": file, "length": part.N})
        begin += part.N
    return entries


def _csv(names: tuple[str, ...], columns: list[np.ndarray]) -> str:
    """Rows of the shortest decimal numbers that read back to the same bits; nan is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        writer.writerow("" if value != value else repr(value) for value in row)
    return text.getvalue()


def _facts_of_truth(task: Task, truth: Truth) -> dict[str, Any]:
    facts: dict[str, Any] = {"noise": truth.noise, "orders": task.orders, "poles": truth.poles}
    if truth.chain is not None and truth.theta is not None:
        facts["structure"] = truth.chain.structure
        facts["parameters"] = dict(zip(truth.chain.names, truth.theta, strict=True))
    return facts


def _write_json(path: Path, value: Any) -> None:
    write_text(path, json.dumps(json_value(value), indent=2, allow_nan=False) + "\n")
