"""Free-run errors on six public records, by their own protocols, beside published rows.

.venv/bin/python scripts/real_records.py FOLDER [NAME ...], where FOLDER holds ced/, emps/, cascaded_tanks/, silverbox/,
daisy/ and bam_xl330/ (see https://www.nonlinearbenchmark.org, DaISy and Rhoban's bam). Published values: Champneys et
al. 2024 for the linear, polynomial NARX and best listed models. Nothing is chosen on a test record: orders and maps are
stated here, physical models by what `physical_models.py` says of each, and among starts the loss on the training record
decides. The initial state of every test comes from its first samples, which are not scored.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from physical_models import PHYSICAL, servo_logs
from scipy.io import loadmat

import sysid
from sysid import IOData
from sysid.structures import hammerstein_wiener, nlarx, output_error, wiener_hammerstein


@dataclass(frozen=True)
class Benchmark:
    """Training record, test records with the samples that the protocol drops, unit, and published rows.

    `means` of u and y were taken away; physical models get them back, since a motor's zero volts are no offset.
    """

    train: IOData
    tests: dict[str, IOData]
    drop: int
    unit: str
    orders: tuple[int, int, int]
    published: str
    means: tuple[float, float] = (0.0, 0.0)

    def raw(self, record: IOData) -> IOData:
        """A record of this benchmark in its own scale."""
        return replace(record, u=record.u + self.means[0], y=record.y + self.means[1])


def table(path: Path) -> np.ndarray:
    """The numbers of a CSV with one heading row and a trailing comma."""
    return np.genfromtxt(path, delimiter=",", skip_header=1)


def averages(train: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Means of u and y of the training record."""
    u0, y0 = (float(np.mean(np.concatenate([t[i] for t in train]))) for i in (0, 1))
    return u0, y0


def about(train: list[tuple[np.ndarray, np.ndarray]], Ts: float) -> Callable[[np.ndarray, np.ndarray], IOData]:
    """Makes records whose offsets are the means of the training record."""
    u0, y0 = averages(train)
    return lambda u, y: IOData(u - u0, y - y0, Ts)


def ced(folder: Path) -> Benchmark:
    t = table(folder / "ced" / "DATAUNIF.csv")
    pairs = [(t[:, 0], t[:, 2]), (t[:, 1], t[:, 3])]
    record = about([(u[:400], y[:400]) for u, y in pairs], 0.02)
    train = IOData.merge(*(record(u[:400], y[:400]) for u, y in pairs))
    tests = {f"test {k}": record(u[400:], y[400:]) for k, (u, y) in enumerate(pairs, 1)}
    means = averages([(u[:400], y[:400]) for u, y in pairs])
    published = "linear 0.224 / 0.384, NARX 0.10 / 0.141, best 0.115 / 0.074"
    return Benchmark(train, tests, 10, "ticks/s", (2, 3, 1), published, means)


def emps(folder: Path) -> Benchmark:
    train, test = (loadmat(folder / "emps" / f"{n}.mat") for n in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    (u, y), (ut, yt) = ((m["vir"].ravel(), 1e3 * m["qm"].ravel()) for m in (train, test))
    record = about([(u, y)], 1e-3)
    published = "linear 5.53, NARX 5.17, best 2.64"
    return Benchmark(record(u, y), {"pulses": record(ut, yt)}, 20, "mm", (2, 2, 1), published, averages([(u, y)]))


def bam(folder: Path) -> Benchmark:
    logs = servo_logs(folder / "bam_xl330")
    train = IOData.merge(*(record for kp, _, record in logs if kp != 400))
    tests = {name: record for kp, name, record in logs if kp == 400}
    return Benchmark(train, tests, 50, "rad", (2, 2, 1), "none")


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
    "bam_xl330": bam,
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


def row(label: str, fit: Any, bench: Benchmark, tests: dict[str, IOData], began: float) -> None:
    """Prints one fit's errors on the test records; of more than two, also their mean square's root."""
    errors, squares = [], []
    for part, record in tests.items():
        e = record.y[bench.drop :, 0] - fit.simulate(record, bench.drop)[bench.drop :]
        percent = 100.0 * (1.0 - np.sqrt(np.mean(e**2)) / record.y[bench.drop :].std())
        errors.append(f"{part} {np.sqrt(np.mean(e**2)):.3f} ({percent:.1f} %)")
        squares.append(e**2)
    if len(squares) > 2:
        errors.append(f"all {np.sqrt(np.mean(np.concatenate(squares))):.4f}")
    end = "" if fit.stop.converged else ", not converged"
    print(f"  {label:16} d {fit.criteria.d:3}  {', '.join(errors)}  [{time.perf_counter() - began:.1f} s{end}]")


def main(arguments: list[str]) -> None:
    """Prints one row for each record and model."""
    folder, names = Path(arguments[0]), arguments[1:] or list(RECORDS)
    for name in names:
        bench = RECORDS[name](folder)
        print(f"{name} [{bench.unit}], published: {bench.published}")
        for label, model in models(bench.orders).items():
            began = time.perf_counter()
            row(label, sysid.fit(model, bench.train), bench, bench.tests, began)
        raw = {part: bench.raw(record) for part, record in bench.tests.items()}
        for label, physical in PHYSICAL.get(name, {}).items():
            began = time.perf_counter()
            row(label, physical(bench.raw(bench.train)), bench, raw, began)


if __name__ == "__main__":
    main(sys.argv[1:])
