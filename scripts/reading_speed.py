"""Peak memory and time of reading long logs of t, u, y: python scripts/reading_speed.py [--rows 10000000] [--json].

Each file becomes a table, and a record as `sysid.read` makes it. The files lie in a temporary folder; each reading runs
in a process of its own, so that the peak is its own. `--kinds` names others: csv, parquet, semicolons (with decimal
commas), quoted, empty (a cell in a hundred thousand has no value), text (a column of words beside the numbers).
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import polars

READ = """
import json, resource, sys, time
from sysid import read
from sysid.formats import read_table
begin, busy = time.perf_counter(), time.process_time()
made = read_table(sys.argv[2]) if sys.argv[1] == "table" else read(sys.argv[2])
seconds, worked = time.perf_counter() - begin, time.process_time() - busy
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
if sys.platform == "linux":  # where that one begins with the memory of the process that started this one
    status = open("/proc/self/status").read()
    peak = int(status.partition("VmHWM:")[2].split()[0]) / 2**10
rows = len(made.columns[0]) if sys.argv[1] == "table" else made.N
print(json.dumps({"rows": rows, "seconds": seconds, "processor_seconds": worked, "peak_MiB": peak}))
"""
KINDS = ("csv", "parquet", "semicolons", "quoted", "empty", "text")
PART = 1_000_000  # rows that are written at a time


def write(path: Path, rows: int, kind: str = "csv") -> Path:
    """Time, input and angle with six decimals."""
    if kind == "parquet":
        path = path.with_suffix(".parquet")
        k = np.arange(rows)
        polars.DataFrame(
            {"t [s]": np.round(k * 1e-3, 6), "u_V": 12 * np.sin(k), "angle (deg)": 90 * np.cos(k)}
        ).write_parquet(path)
        return path
    mark, decimal = (";", ",") if kind == "semicolons" else (",", ".")
    names = ["t [s]", "u_V", "angle (deg)", *(["note"] if kind == "text" else [])]
    with path.open("wb") as file:
        file.write((mark.join(names) + "\n").encode())
        for first in range(0, rows, PART):
            k = np.arange(first, min(first + PART, rows))
            part = polars.DataFrame({"t": k * 1e-3, "u": 12 * np.sin(k), "y": 90 * np.cos(k)})
            if kind == "empty":
                part = part.with_columns(y=polars.when(polars.Series(k % 100_000 != 777)).then(polars.col("y")))
            if kind == "text":
                part = part.with_columns(note=polars.lit("ok"))
            quotes = "always" if kind == "quoted" else "necessary"
            text = part.write_csv(include_header=False, float_precision=6, quote_style=quotes)
            file.write((text.replace(",", mark).replace(".", decimal) if kind == "semicolons" else text).encode())
    return path


def measured(path: Path, kind: str) -> dict[str, float]:
    """Seconds and peak of a process that reads the file as a "table" or as a "record"."""
    process = subprocess.run([sys.executable, "-c", READ, kind, str(path)], check=True, capture_output=True, text=True)
    return json.loads(process.stdout)


def main() -> None:
    """Print a line, or an entry of a document, for each kind of file and what it becomes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=["csv", "parquet"])
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args()
    rows = []
    for kind in options.kinds:
        with tempfile.TemporaryDirectory() as folder:
            path = write(Path(folder) / "long.csv", options.rows, kind)
            size = path.stat().st_size / 2**20
            for target in ("table", "record") * options.times:
                row = {"kind": kind, "what": target, "file_MiB": size, **measured(path, target)}
                rows.append(row)
                if not options.json:
                    time = f"{row['processor_seconds']:.1f} s of processor time ({row['seconds']:.1f} s passed)"
                    label = f"{kind} to a {target}: {row['rows']:.0f} rows, {size:.0f} MiB"
                    print(f"{label}; {time}, peak {row['peak_MiB']:.0f} MiB", flush=True)
    if options.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
