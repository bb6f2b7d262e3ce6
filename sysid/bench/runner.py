"""Run cells into a table. A run that was stopped or killed continues where it was."""

from collections.abc import Callable, Sequence

from sysid.base.parallel import results
from sysid.bench import cell
from sysid.bench.cell import Cell
from sysid.bench.columns import UNTRIED
from sysid.bench.table import Table


def run(
    cells: Sequence[Cell],
    table: Table,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Run every cell that has no row yet; returns how many were run. Rows without data or environment are run again.

    `workers` are local processes, `scheduler` the address of a Dask scheduler (see `sysid.base.parallel`). Each row is
    on the disk as soon as its cell ends.
    """
    with table.writing():
        done = table.done(UNTRIED)
        todo = [each for each in cells if each.key not in done]
        for k, (_, row) in enumerate(results(cell.run, todo, workers, scheduler), 1):
            table.add(row)
            if progress is not None:
                progress(k, len(todo))
    return len(todo)
