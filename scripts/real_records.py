"""Free-run errors on five public benchmark records, by their own protocols, beside published rows.

.venv/bin/python scripts/real_records.py FOLDER [NAME ...], where FOLDER holds ced/, emps/, cascaded_tanks/, silverbox/
and daisy/ (see https://www.nonlinearbenchmark.org and DaISy). Published values: Champneys et al. 2024 for the linear,
polynomial NARX and best listed models. Nothing is chosen on a test record: orders and maps are stated here, and among
starts the loss on the training record decides.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

import sysid
from sysid import IOData
from sysid.structures import hammerstein_wiener, nlarx, output_error, wiener_hammerstein


@dataclass(frozen=True)
class Benchmark:
    """Training record, test records with the samples that the protocol drops, unit, and published rows."""

    train: IOData
    tests: dict[str, IOData]
    drop: int
    unit: str
    orders: tuple[int, int, int]
    published: str


def table(path: Path) -> np.ndarray:
    """The numbers of a CSV with one heading row and a trailing comma."""
    return np.genfromtxt(path, delimiter=",", skip_header=1)


def about(train: list[tuple[np.ndarray, np.ndarray]], Ts: float) -> Callable[[np.ndarray, np.ndarray], IOData]:
    """Makes records whose offsets are the means of the training record."""
    u0, y0 = (float(np.mean(np.concatenate([t[i] for t in train]))) for i in (0, 1))
    return lambda u, y: IOData(u - u0, y - y0, Ts)


def ced(folder: Path) -> Benchmark:
    t = table(folder / "ced" / "DATAUNIF.csv")
    pairs = [(t[:, 0], t[:, 2]), (t[:, 1], t[:, 3])]
    record = about([(u[:400], y[:400]) for u, y in pairs], 0.02)
    train = IOData.merge(*(record(u[:400], y[:400]) for u, y in pairs))
    # The last ten training samples stand before each test for the initial state, and are dropped.
    tests = {f"test {k}": record(u[390:], y[390:]) for k, (u, y) in enumerate(pairs, 1)}
    return Benchmark(
        train, tests, 10, "ticks/s", (2, 3, 1), "linear 0.224 / 0.384, NARX 0.10 / 0.141, best 0.115 / 0.074"
    )


def emps(folder: Path) -> Benchmark:
    train, test = (loadmat(folder / "emps" / f"{n}.mat") for n in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    (u, y), (ut, yt) = ((m["vir"].ravel(), 1e3 * m["qm"].ravel()) for m in (train, test))
    record = about([(u, y)], 1e-3)
    return Benchmark(record(u, y), {"pulses": record(ut, yt)}, 20, "mm", (2, 2, 1), "linear 5.53, NARX 5.17, best 2.64")


def tanks(folder: Path) -> Benchmark:
    t = table(folder / "cascaded_tanks" / "dataBenchmark.csv")
    record = about([(t[:, 0], t[:, 2])], 4.0)
    tests = {"validation": record(t[:, 1], t[:, 3])}
    return Benchmark(record(t[:, 0], t[:, 2]), tests, 50, "V", (2, 2, 1), "linear 0.588, NARX 0.413, best 0.191")


def silverbox(folder: Path) -> Benchmark:
    v = 1e3 * table(folder / "silverbox" / "SNLS80mV.csv")[:, :2]
    u, y = v[:, 0], v[:, 1]
    record = about([(u[40650:105712], y[40650:105712])], 1 / 610.35)
    parts = {"multisine": (105712, 127400), "arrow": (100, 40575), "no extrapolation": (100, 32100)}
    tests = {name: record(u[a:b], y[a:b]) for name, (a, b) in parts.items()}
    published = "linear 6.96 / 14.4 / 6.58, NARX 0.64 / 2.25 / 0.57, best 0.36 / 0.26 / 0.32"
    return Benchmark(record(u[40650:105712], y[40650:105712]), tests, 50, "mV", (3, 2, 0), published)


def daisy(folder: Path) -> Benchmark:
    t = np.loadtxt(folder / "daisy" / "hair_dryer.dat")
    record = about([(t[:500, 0], t[:500, 1])], 0.08)
    tests = {"second half": record(t[500:, 0], t[500:, 1])}
    return Benchmark(record(t[:500, 0], t[:500, 1]), tests, 50, "V", (2, 3, 1), "none")


RECORDS: dict[str, Callable[[Path], Benchmark]] = {
    "ced": ced,
    "emps": emps,
    "cascaded_tanks": tanks,
    "silverbox": silverbox,
    "hair_dryer": daisy,
}


def models(orders: tuple[int, int, int]) -> dict[str, Any]:
    """OE, HW, WH (with a one-pole second filter) and NLARX of these orders, with the library's default maps."""
    nb, nf, nk = orders
    return {
        "OE": output_error(nb, nf, nk),
        "HW": hammerstein_wiener(nb, nf, nk),
        "WH": wiener_hammerstein(nb, nf, nk, nb2=2, nf2=1, nk2=0),
        "NLARX": nlarx(na=nf, nb=nb, nk=nk, focus="simulation"),
    }


def main(arguments: list[str]) -> None:
    """Prints one row for each record and model."""
    folder, names = Path(arguments[0]), arguments[1:] or list(RECORDS)
    for name in names:
        bench = RECORDS[name](folder)
        print(f"{name} [{bench.unit}], published: {bench.published}")
        for label, model in models(bench.orders).items():
            began = time.perf_counter()
            fit = sysid.fit(model, bench.train)
            errors = []
            for part, record in bench.tests.items():
                e = record.y[bench.drop :, 0] - fit.simulate(record, bench.drop)[bench.drop :]
                percent = 100.0 * (1.0 - np.sqrt(np.mean(e**2)) / record.y[bench.drop :].std())
                errors.append(f"{part} {np.sqrt(np.mean(e**2)):.3f} ({percent:.1f} %)")
            seconds = time.perf_counter() - began
            end = "" if fit.stop.converged else ", not converged"
            print(f"  {label:6} d {fit.criteria.d:3}  {', '.join(errors)}  [{seconds:.1f} s{end}]")


if __name__ == "__main__":
    main(sys.argv[1:])
