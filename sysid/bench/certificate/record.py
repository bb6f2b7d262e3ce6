"""Dynamic reference records: what is certified of each, and the chain of this library that it states.

They lie in records/ with a README, for other tools too; `scripts/certificates/certify.py` makes and certifies them.
"""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.bench.task import Task
from sysid.blocks import TABLE, TransferFunction
from sysid.data.record import IOData
from sysid.model.chain import Chain

FOLDER = Path(__file__).with_name("records")
STARTS = (1, 2)


@dataclass(frozen=True)
class Record:
    """u, y (N,), what the record states of its system, two starts by name, and certified values by name.

    `is_global` where it is proved that no other point of a stated domain has a lower sum of squares.
    """

    name: str
    level: str
    data: IOData
    blocks: tuple[Mapping[str, Any], ...]
    fixed: Mapping[str, float]
    starts: tuple[Mapping[str, float], ...]
    parameters: Mapping[str, float]
    deviations: Mapping[str, float]
    rss: float
    is_global: bool

    def task(self, start: int) -> Task:
        """The record for a method of the benchmark, with start 1 or 2; its free run from rest is the test."""
        model = {"blocks": list(self.blocks), "fixed": dict(self.fixed), "start": dict(self.starts[start - 1])}
        return Task(self.data, {"estimation": self.data}, 0, orders=self.orders, model=model)

    @property
    def orders(self) -> tuple[int, int, int] | None:
        """nb, nf and nk of its first filter, for methods that do not look at the statement; None without a filter."""
        orders = [(b["nb"], b["nf"], b["nk"]) for b in self.blocks if b["kind"] == "transfer_function"]
        return orders[0] if orders else None


def chain_of(model: Mapping[str, Any]) -> Chain:
    """The chain that a record states, filters at rest. Raises InputError for a kind of block that there is not."""
    blocks = []
    for settings in model["blocks"]:
        kind = settings["kind"]
        if kind not in TABLE:
            raise InputError(f"the record has a block {kind}; this version has {', '.join(sorted(TABLE))}")
        rest = {"initial_state": False} if TABLE[kind] is TransferFunction else {}
        blocks.append(TABLE[kind](**{key: value for key, value in settings.items() if key != "kind"}, **rest))
    return Chain(tuple(blocks), fixed=model["fixed"])


def records(folder: Path = FOLDER) -> dict[str, Record]:
    """All records by name. Raises InputError for a folder without any."""
    table = {path.stem: _read(path) for path in sorted(folder.glob("*.json"))}
    if not table:
        raise InputError(f"there are no reference records in {folder}; give a folder with NAME.json and NAME.csv")
    return table


def _read(path: Path) -> Record:
    facts = json.loads(path.read_text(encoding="ascii"))
    with path.with_suffix(".csv").open(encoding="ascii", newline="") as file:
        u, y = np.array(list(csv.reader(file))[1:], dtype=float).T
    parameters, deviations = ({k: float(v) for k, v in facts[key].items()} for key in ("parameters", "deviations"))
    return Record(
        facts["name"],
        facts["level"],
        IOData(u, y, facts["Ts"]),
        tuple(facts["blocks"]),
        facts["fixed"],
        (facts["start1"], facts["start2"]),
        parameters,
        deviations,
        float(facts["rss"]),
        "global" in facts,
    )
