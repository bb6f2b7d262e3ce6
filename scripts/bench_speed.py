"""Cost of the benchmark's runner: its share of the time, and rows a second of two workers beside one, in one run.

    python scripts/bench_speed.py --seeds 12 --rounds 3

The report of 100,000 made-up rows is timed too. Each round runs the same cells in a plain loop, by the runner in this
process, and by the runner on two workers, which are warm. An idle machine is needed for the last ratio.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars as pl

from sysid.bench import cell, suites
from sysid.bench.methods import TABLE as METHODS
from sysid.bench.scenarios import TABLE as FAMILIES
from sysid.bench.table import Table


def main():
    """Print the seconds of a loop, of the runner and of two workers, and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    part = suites.Part(("drawn/hammerstein_wiener", "drawn/wiener"), ("hammerstein_wiener", "wiener"), options.seeds)
    cells = suites.cells([part], 20.0, FAMILIES, METHODS, 50)
    with tempfile.TemporaryDirectory() as folder:

        def runner(name, workers):
            return lambda: cell.run_cells(cells, Table(Path(folder) / f"{name}.parquet"), workers)

        count, seconds = report_of_100_000_rows()
        print(f"report of {count} rows: {seconds:.1f} s")
        timed(runner("warm", 2))
        rows = []
        for k in range(options.rounds):
            plain = timed(lambda: [cell.run_cell(cell_of_suite) for cell_of_suite in cells])
            rows.append((plain, timed(runner(f"one-{k}", 1)), timed(runner(f"two-{k}", 2))))
    plain, row, two = np.median(np.array(rows), axis=0)
    share = np.median([b / a - 1 for a, b, _ in rows])
    gain = np.median([b / c for _, b, c in rows])
    print(
        f"{len(cells)} rows, median of {options.rounds}: loop {plain:.1f} s, runner {row:.1f} s, "
        f"two workers {two:.1f} s"
    )
    print(f"runner over loop: {100 * share:.1f} % more; two workers beside one: {gain:.2f} times the rows a second")


def report_of_100_000_rows():
    """Seconds of the whole report, its pages included."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from fakes import run_of_the_library

    from sysid.report import bench as pages

    part = run_of_the_library(np.random.default_rng(0), methods=12, tasks=24)
    table = pl.concat(part.with_columns(pl.col("scenario").str.replace("f", f"g{k % 7}") + f"-{k}") for k in range(350))
    with tempfile.TemporaryDirectory() as folder:
        return len(table), timed(lambda: pages.write(Path(folder), table, ()))


def timed(job):
    began = time.perf_counter()
    job()
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
