"""Time and memory of one default Hammerstein-Wiener fit over the length of the record, each length in a new process.

    python scripts/long_records.py --starts 5 --lengths 1000 10000 100000 1000000 10000000

The plant has a smooth map before and after three poles; 0.01 of noise is added to outputs of size 1. The record
is made in pieces, so that making it needs little more than the record itself. Memory is the largest resident size of
the process [GiB]: before the record was made (the interpreter and its libraries), after that, and after the fit.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np

_PIECE = 100_000


def main():
    """Print a row for each length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", type=int, nargs="+", default=[10**k for k in range(3, 8)])
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--one", type=int, help="measure this length in this process, and print JSON")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measured(options.one, options.starts)))
        return
    print("| N | time [s] | processor [s] | libraries [GiB] | with record [GiB] | peak [GiB] | fit [%] | iterations |")
    print("| --: | --: | --: | --: | --: | --: | --: | --: |")
    for n in options.lengths:
        command = [sys.executable, __file__, "--one", str(n), "--starts", str(options.starts)]
        row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        memory = " | ".join(f"{row[name]:.2f}" for name in ("libraries", "record", "peak"))
        print(
            f"| {n} | {row['seconds']:.2f} | {row['processor']:.2f} | {memory} | {row['fit']:.2f} | "
            f"{row['iterations']} |",
            flush=True,
        )


def measured(n, starts):
    """One length in this process."""
    import sysid

    model = sysid.structures.hammerstein_wiener(2, 3, 1)
    sysid.fit(model, record(2000, 1), starts=1)  # compiles, and loads the libraries
    libraries = peak()
    data = record(n, 0)
    with_record = peak()
    began, cpu_start = time.perf_counter(), time.process_time()
    fit = sysid.fit(model, data, starts=starts)
    return {
        "seconds": time.perf_counter() - began,
        "processor": time.process_time() - cpu_start,
        "libraries": libraries,
        "record": with_record,
        "peak": peak(),
        "fit": 100.0 * (1.0 - np.sqrt(fit.criteria.mse) / float(data.y.std())),
        "iterations": fit.stop.iterations,
    }


def record(n, seed):
    """A record of n samples of the textbook plant, made piece by piece."""
    from scipy.signal import lfilter

    import sysid

    rng = np.random.default_rng(seed)
    u, y, state = np.empty(n), np.empty(n), np.zeros(3)
    a = np.poly([0.95, 0.8, 0.5])
    b = np.array([0.0, 1.0, 0.5, 0.0]) * a.sum() / 1.5
    for start in range(0, n, _PIECE):
        part = slice(start, min(start + _PIECE, n))
        size = part.stop - start
        u[part] = np.repeat(rng.uniform(-1.0, 1.0, -(-size // 10)), 10)[:size]
        x, state = lfilter(b, a, np.tanh(2.0 * u[part]), zi=state)
        y[part] = x + 0.3 * x**3 + 0.01 * rng.standard_normal(size)
    return sysid.IOData(u, y, Ts=0.01)


def peak():
    """Largest resident size so far [GiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**30 if sys.platform == "darwin" else 2**20)


if __name__ == "__main__":
    main()
