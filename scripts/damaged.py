"""Three deliberately damaged identifiers: does the comparison of two benchmark tables catch and name them?

    python scripts/damaged.py --out runs/damaged --tag quick

The undamaged library and each damage run the same cells; the damage is put into the library at run time. The structure
search runs on short drawn records: with thousands of samples the half that was fitted judges as well as the other one.
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

from sysid.bench import scenarios, suites
from sysid.bench.cell import Cell, run_cell
from sysid.bench.measures import INTERVALS, SEARCH, SELECTION
from sysid.bench.methods import OURS
from sysid.bench.methods import TABLE as METHODS
from sysid.bench.regression import Verdict, compare
from sysid.bench.table import KEY, Table, read
from sysid.blocks.transfer_function import TransferFunction
from sysid.selection import select as selecting
from sysid.uncertainty import information as informing

SEARCHES = "auto_of_two"  # the method that chooses its structure


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
    """The structure search judges a candidate on the part that it fitted."""

    def damaged(right: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda data: tuple(replace(fold, unseen=fold.estimation) for fold in right(data))

    with (
        patch.object(selecting, "folds", damaged(selecting.folds)),
        patch.object(selecting, "folds_of_other_kinds", damaged(selecting.folds_of_other_kinds)),
    ):
        yield


@contextmanager
def covariance() -> Iterator[None]:
    """The covariance is four times too large."""
    right = informing.information_at

    def wrong(*arguments: Any, **options: Any) -> Any:
        information = right(*arguments, **options)
        return replace(information, factor=2.0 * information.factor)

    with patch.object(informing, "information_at", wrong):
        yield


@dataclass(frozen=True)
class Damage:
    """What is damaged, whether it concerns the structure search alone, and the room that the comparison must name."""

    put: Callable[[], Any]
    chooses: bool
    room: str


DAMAGES = {
    "jacobian": Damage(jacobian, False, SEARCH),
    "selection": Damage(selection, True, SELECTION),
    "covariance": Damage(covariance, False, INTERVALS),
}


def cells(tag: str, seeds: int | None) -> list[Cell]:
    """The cells of a tag on the families of the library, with at most so many seeds for each scenario."""
    parts = []
    for part in suites.SUITES[tag].parts:
        patterns = tuple(pattern for pattern in part.scenarios if pattern.partition("/")[0] in scenarios.TABLE)
        if patterns:
            parts.append(replace(part, scenarios=patterns, seeds=min(part.seeds, seeds or part.seeds)))
    return suites.cells(parts, suites.SUITES[tag].seconds, scenarios.TABLE, METHODS, ours=OURS)


def fill(path: Path, todo: list[Cell]) -> None:
    """Run the cells that the table lacks, in this process, where the damage is."""
    table = Table(path)
    with table.writing():
        keys = table.row_keys()
        for cell in todo:
            if cell.key not in keys:
                table.add(run_cell(cell))
                print(path.stem, *cell.key, file=sys.stderr)


def judge_damage(name: str, folder: Path, every: list[Cell]) -> tuple[bool, Verdict]:
    """Whether a damage is called worse and its own room is named."""
    damage = DAMAGES[name]
    todo = [cell for cell in every if (cell.method.name == SEARCHES) == damage.chooses]
    fill(folder / "base.parquet", todo)
    with damage.put():
        fill(folder / f"{name}.parquet", todo)
    new, base = (read(folder / f"{table}.parquet") for table in (name, "base"))
    verdict = compare(new, base.join(new.select(KEY), list(KEY), "semi"))
    return verdict.worse and damage.room in {f.room for f in verdict.findings if f.worse}, verdict


def main() -> int:
    """Run what is asked for and print each verdict."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("damages", nargs="*", metavar="DAMAGE", help=f"{', '.join(DAMAGES)}; all without any")
    parser.add_argument("--out", type=Path, default=Path("runs/damaged"), help="folder of the tables")
    parser.add_argument("--tag", default="quick", choices=sorted(suites.SUITES))
    parser.add_argument("--seeds", type=int, help="at most so many for each scenario; the tag's if not given")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    every, missed = cells(options.tag, options.seeds), []
    for name in options.damages or DAMAGES:
        is_caught, verdict = judge_damage(name, options.out, every)
        print(
            f"\n{name}: {'caught and named' if is_caught else 'NOT named'}", *verdict.sentences, sep="\n  ", flush=True
        )
        missed += [] if is_caught else [name]
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
