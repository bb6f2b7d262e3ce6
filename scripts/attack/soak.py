"""Mixed work in one process for an hour: do memory and handles stay where they are?

Each round fits several structures, one of them with a block from a step, runs an ensemble, writes a report and figures,
saves and reads models and logs, works on a session of the app and meets bad input. Memory is that of the process after
each round, once its garbage is collected, beside the largest of the warm-up, the first rounds, in which libraries load
and compile. Bad is a median of the last tenth of the rounds more than 5 % above it, and more descriptors, threads or
child processes.
"""

import contextlib
import gc
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.tally import Tally
from matplotlib import pyplot

import sysid
import twin
from sysid import structures
from sysid.base import style
from sysid.report import identify as report
from sysid.report.page import write
from sysid.workflow.identification import identify_file
from sysid.workflow.saved import export
from sysid.workflow.setting import Setting
from twin.app.entries import Data
from twin.app.session import Session

MINUTES = 60.0  # of a full attack
GROWTH = 5.0  # [%] of memory after the warm-up
WARM_UP = 5  # rounds
STRUCTURES = (
    structures.OutputError(2, 2, 1),
    structures.HammersteinWiener(2, 2, 1),
    structures.Hammerstein(2, 2, 1, input_map="dead_zone"),
    structures.NonlinearArx(2, 2, 1),
)


def step(s, x, p):
    """A lag whose rate of change is limited, as a user writes it."""
    change = (p.gain * x - s.level) / p.lag
    s.level += min(max(change, -p.fastest), p.fastest)
    return s.level


def record(rng: np.random.Generator, n: int = 200) -> sysid.IOData:
    """A record of a saturated lag with noise."""
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 10), 10)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.9 * y[k - 1] + 0.1 * np.clip(u[k - 1], -0.7, 0.7)
    return sysid.IOData(u, y + 0.002 * rng.standard_normal(n), Ts=0.1)


def fits(rng: np.random.Generator, folder: Path) -> None:
    """One of the structures, its figures, its text, and the model written and read."""
    data = record(rng)
    for structure in STRUCTURES:
        fit = sysid.fit(structure.model_of(data), data, starts=1)
        sysid.save(fit, folder / "model.json")
        loaded = sysid.load(folder / "model.json")
        loaded.simulate(data.u)
        style.png(fit.plot(data))
        pyplot.close("all")  # it keeps what a person asked for until it is closed
        repr(fit)
    first = {"gain": 1.0, "lag": 10.0, "fastest": 0.05}
    block = sysid.blocks.dynamic(step, first, bounds={"lag": (1.0, 100.0), "fastest": (1e-3, 1.0)}, role="limiter")
    sysid.fit(sysid.Chain((block,)), data)


def ensembles(rng: np.random.Generator, folder: Path) -> None:
    """Four experiments with drawn parameters, read back."""
    from twin.ensemble.draws import Draws
    from twin.ensemble.ensemble import Ensemble

    seeds = range(int(rng.integers(1 << 20)), 1 << 21)[:4]
    ensemble = Ensemble(
        twin.Experiment("thigh", "aprbs", 10.0), seeds, Draws({"thigh.coulomb": 0.3}), folder / "ensemble"
    )
    ensemble.run()
    ensemble.table()
    for log in ensemble:
        log.io()


def reports(rng: np.random.Generator, folder: Path) -> None:
    """From a log to a page with figures and exports."""
    path = folder / "log.csv"
    twin.Experiment("thigh", "aprbs", 20.0, seed=int(rng.integers(1 << 20))).run().save(path)
    result = identify_file(path, Setting(structures.OutputError(1, 1, 1), starts=1))
    exports = export(result.evaluation, folder)
    write(folder, report.page(result, exports), result.as_dict())


def sessions(rng: np.random.Generator, folder: Path) -> None:
    """A session of the app, opened, filled, changed, closed and opened again."""
    for _ in range(3):
        session = Session.open(folder / "session")
        for k in range(4):
            data = record(rng)
            text = "u,y\n" + "\n".join(f"{u},{y}" for u, y in zip(data.u, data.y, strict=True))
            session.add(Data(name=f"{k}.csv", suffix=".csv"), lambda inside, t=text: (inside / "log.csv").write_text(t))
        session.change(shown="d1")
        for key in list(session.data)[:-1]:
            session.remove("data", key)
        session.close()


def refusals(rng: np.random.Generator, folder: Path) -> None:
    """What is refused, with a unit and a name that were never there before."""
    (folder / "odd.csv").write_text(f"a{rng.integers(1 << 30)} [x{rng.integers(1 << 30)}],b\n1,2\n")
    for bad in (folder / "odd.csv", folder / "nowhere.csv", folder):
        with contextlib.suppress(sysid.InputError):
            sysid.read(bad)


WORK: Mapping[str, Callable[[np.random.Generator, Path], None]] = {
    work.__name__: work for work in (fits, ensembles, reports, sessions, refusals)
}


def usage() -> dict[str, int]:
    """Memory [KiB], descriptors, threads and child processes of this process."""
    gc.collect()
    rows = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    rss = next(int(row.split()[1]) for row in rows if row.startswith("VmRSS"))
    tasks = Path("/proc/self/task").iterdir()
    children = sum(len((task / "children").read_text().split()) for task in tasks)
    return {
        "rss": rss,
        "objects": len(gc.get_objects()),
        "descriptors": len(os.listdir("/proc/self/fd")),
        "threads": threading.active_count(),
        "system_threads": len(os.listdir("/proc/self/task")),
        "children": children,
    }


def judged(rows: list[dict[str, int]]) -> dict[str, Any]:
    """Growth after the warm-up, and what is beyond its limit."""
    warm, last = rows[: min(WARM_UP, len(rows))], rows[-max(1, len(rows) // 10) :]
    warm_memory = max(row["rss"] for row in warm)
    end_memory = float(np.median([row["rss"] for row in last]))
    growth = 100.0 * (end_memory / warm_memory - 1.0)
    wrong = [f"memory has grown by {growth:.1f} %"] if growth > GROWTH else []
    for name in ("descriptors", "threads", "system_threads", "children"):
        limit = max(row[name] for row in warm)
        if min(row[name] for row in last) > limit:
            wrong.append(f"{name} were {limit} and are {last[-1][name]}")
    return {"wrong": wrong, "growth_percent": round(growth, 2), "mebibytes": [warm_memory >> 10, int(end_memory) >> 10]}


def attack(chosen: Any) -> Tally:
    """The work whose name has the part, until the time is over."""
    start, rows, tally = time.monotonic(), list[dict[str, int]](), Tally()
    while time.monotonic() - start < 60.0 * MINUTES * chosen.scale or len(rows) < 2 * WARM_UP:
        rng = np.random.default_rng([chosen.seed, len(rows)])
        with tempfile.TemporaryDirectory() as folder:
            for name in (name for name in WORK if chosen.part in name):
                (Path(folder) / name).mkdir()
                WORK[name](rng, Path(folder) / name)
        rows.append(usage())
        tally.case("round")
        print(f"round {len(rows)}, {time.monotonic() - start:.0f} s: {rows[-1]}", file=sys.stderr, flush=True)
    result = judged(rows)
    tally.case(f"memory grew by {result['growth_percent']} %", [("grown", text) for text in result["wrong"]])
    return tally
