"""Are README's two tables the same on every processor? One row for each setting, and each line that differs.

    python scripts/processors.py                # six settings, some minutes each
    python scripts/processors.py --only plain haswell

A setting names the instructions that compiled loops use (numba, numpy) and the core whose kernels OpenBLAS takes; these
change the order of sums, and so the last digits of every number on the way. Exit status 1 if a table differs.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from numpy._core._multiarray_umath import __cpu_dispatch__  # numpy has no public list of them

ROOT = Path(__file__).resolve().parents[1]
OLD = {  # no instruction beyond those that every x86-64 has, in numpy and in the C library too
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA",
}
SETTINGS = {
    "plain": {},
    "old": OLD,
    "sandybridge": {"NUMBA_CPU_NAME": "sandybridge", "OPENBLAS_CORETYPE": "Sandybridge"},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "OPENBLAS_CORETYPE": "Haswell"},
    "zen": {"OPENBLAS_CORETYPE": "Zen"},
    "skylake": {"OPENBLAS_CORETYPE": "SkylakeX"},
}
TABLES = (
    "from twin.report import actuated_joint, reproduce; from twin.studies import protocol; "
    "result = protocol.run(seed=0); "
    "print(reproduce.table(result).markdown() + actuated_joint.table(result).markdown())"
)


def tables(name: str) -> list[str]:
    """The lines of both tables under a setting, each in a process and with a cache of kernels of its own."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache, **SETTINGS[name]}
        command = [sys.executable, "-W", "ignore", "-c", TABLES]
        run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if run.returncode:
        why = run.stderr.strip().splitlines() or ["this processor lacks the instructions of the setting"]
        raise SystemExit(f"{name}: {why[-1]}")
    return run.stdout.splitlines()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=SETTINGS, default=list(SETTINGS), help="these settings")
    parser.add_argument("--workers", type=int, default=1, help="settings at a time")
    options = parser.parse_args()
    shown = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    differs = False
    with ThreadPoolExecutor(options.workers) as pool:
        for name, lines in zip(options.only, pool.map(tables, options.only), strict=True):
            others = [line for line in lines if line.strip() and line not in shown]
            differs = differs or bool(others)
            print(f"{name}: {len(lines) - len(others)} of {len(lines)} lines as in README", flush=True)
            print("".join(f"    {line}\n" for line in others), end="", flush=True)
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
