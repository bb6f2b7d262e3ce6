"""Rows a second and peak memory of reading a long CSV of t, u, y: python scripts/reading_speed.py [--rows 10000000].

The file lies in a temporary folder; each reading runs in a process of its own, so that the peak is its own.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import polars

READ = """
import resource, sys, time
from sysid.formats import read_table
begin, busy = time.perf_counter(), time.process_time()
table = read_table(sys.argv[1])
seconds, worked = time.perf_counter() - begin, time.process_time() - busy
rows = len(table.columns[0])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
print(
    f"{rows} rows: {rows / seconds / 1e6:.2f} million a second, {rows / worked / 1e6:.2f} million a second of "
    f"processor time, peak {peak:.0f} MiB"
)
"""


def write(path: Path, rows: int) -> None:
    """Time, input and angle with six decimals, a million rows at a time."""
    with path.open("wb") as file:
        file.write(b"t [s],u_V,angle (deg)\n")
        for first in range(0, rows, 1_000_000):
            t = np.arange(first, min(first + 1_000_000, rows)) * 1e-3
            part = polars.DataFrame({"t": t, "u": 12 * np.sin(t), "y": 90 * np.cos(t)})
            part.write_csv(file, include_header=False, float_precision=6)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--times", type=int, default=3)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.csv"
        write(path, given.rows)
        print(f"{path.stat().st_size / 2**20:.0f} MiB")
        for _ in range(given.times):
            subprocess.run([sys.executable, "-c", READ, str(path)], check=True)


if __name__ == "__main__":
    main()
