"""Three deliberately damaged identifiers: does the comparison of two benchmark tables catch and name them?

    python scripts/damaged.py --out runs/damaged --seeds 3

The undamaged library and each damage run the same cells of one family; the damage is put into the library at run time.
Tables stay in the folder, and a run that was stopped continues. Exit status 1 if a damage passes unseen.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from sysid.bench import scenarios
from sysid.bench.cell import Cell, run
from sysid.bench.measures import INTERVALS, SEARCH, SELECTION
from sysid.bench.methods import TABLE as METHODS
from sysid.bench.regression import Verdict, compare
from sysid.bench.table import Table, read
from sysid.blocks.transfer_function import TransferFunction
from sysid.selection import select as selecting
from sysid.uncertainty import information as informing

SECONDS = 300.0
FIXED = ("from_truth", "output_error", "hammerstein", "wiener", "hammerstein_wiener")


@contextmanager
def jacobian() -> Iterator[None]:
    """The derivative by the first coefficient of every F(q) has the wrong sign."""
    right = TransferFunction.propagate

    def wrong(self: TransferFunction, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        y = right(self, theta, x, J, q)
        if J.shape[1] and self.nf:
            J[:, q + self.nb] *= -1.0
        return y

    with patch.object(TransferFunction, "propagate", wrong):
        yield


@contextmanager
def selection() -> Iterator[None]:
    """The structure search judges a candidate on the half that it fitted."""

    def wrong(data: Any) -> Any:
        first, second = data.split(0.5)
        return (first, first), (second, second)

    with patch.object(selecting, "_folds", wrong):
        yield


@contextmanager
def covariance() -> Iterator[None]:
    """The covariance is four times too large."""
    right = informing.information_at

    def wrong(*arguments: Any, **options: Any) -> Any:
        found = right(*arguments, **options)
        return replace(found, factor=2.0 * found.factor)

    with patch.object(informing, "information_at", wrong):
        yield


@dataclass(frozen=True)
class Damage:
    """What is damaged, the methods that are run with it, and the room that the comparison must name."""

    put: Callable[[], Any]
    methods: tuple[str, ...]
    room: str


DAMAGES = {
    "jacobian": Damage(jacobian, FIXED, SEARCH),
    "selection": Damage(selection, ("auto",), SELECTION),
    "covariance": Damage(covariance, FIXED, INTERVALS),
}


def cells(family: str, names: list[str], methods: tuple[str, ...], seeds: int) -> list[Cell]:
    """Every method on every scenario and seed."""
    where = scenarios.TABLE[family]
    chosen = names or list(where.scenarios())
    return [Cell(where, s, METHODS[m], k, SECONDS) for s in chosen for k in range(seeds) for m in methods]


def fill(path: Path, todo: list[Cell]) -> None:
    """Run the cells that the table lacks, in this process, where the damage is."""
    table = Table(path)
    with table.writing():
        done = table.done()
        for cell in todo:
            if cell.key not in done:
                table.add(run(cell))
                print(path.stem, *cell.key, file=sys.stderr)


def caught(name: str, folder: Path, family: str, names: list[str], seeds: int) -> tuple[bool, Verdict]:
    """Whether a damage is called worse and its own room is named."""
    damage = DAMAGES[name]
    todo = cells(family, names, damage.methods, seeds)
    fill(folder / "base.parquet", todo)
    with damage.put():
        fill(folder / f"{name}.parquet", todo)
    verdict = compare(read(folder / f"{name}.parquet"), read(folder / "base.parquet"), damage.methods)
    return verdict.worse and damage.room in {f.room for f in verdict.findings if f.worse}, verdict


def main() -> int:
    """Run what is asked for and print each verdict."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("damages", nargs="*", metavar="DAMAGE", help=f"{', '.join(DAMAGES)}; all without any")
    parser.add_argument("--out", type=Path, default=Path("runs/damaged"), help="folder of the tables")
    parser.add_argument("--family", default="textbook", choices=sorted(scenarios.TABLE))
    parser.add_argument("--scenario", action="append", default=[], help="one of the family; all without any")
    parser.add_argument("--seeds", type=int, default=3, help="how many for each scenario")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    unseen = []
    for name in given.damages or DAMAGES:
        seen, verdict = caught(name, given.out, given.family, given.scenario, given.seeds)
        print(f"\n{name}: {'caught and named' if seen else 'NOT named'}", *verdict.sentences, sep="\n  ", flush=True)
        unseen += [] if seen else [name]
    return 1 if unseen else 0


if __name__ == "__main__":
    sys.exit(main())
