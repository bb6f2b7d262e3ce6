"""How fast, how large: an ensemble beside bare stepping of the same models, an hour of one joint, and its memory.

    python scripts/bench_ensemble.py [--threads 2] [--experiments 32] [--seconds 25] [--pairs 3] [--skip-memory]

"Bare" is one mujoco.batch.Batch.rollout of the same models over as many steps, with the same voltages and as many
threads, without the motor board's callbacks; it records nothing, or the sensors. The ensemble's time is that of
Ensemble.run: drawing, compiling, starting states, stepping with callbacks, noise, and Parquet files on the disk. They
take turns and the table shows medians of the ratios; the last is that of the processors' seconds, which a busy machine
changes least.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch

from twin.ensemble.draws import Draws
from twin.ensemble.ensemble import Ensemble
from twin.experiment import SETTLE, Experiment
from twin.plant.stepping import TIMESTEP

FRICTION = {f"thigh.{row}": 0.3 for row in ("coulomb", "viscous", "bearing_coulomb", "backlash", "stall_force")}
DRIVE = {"supply_voltage": 0.2, "dead_band": 0.5, "delay": 0.5, "pot_noise": 0.5}
MEMORY = """
import resource, sys, tempfile
from twin.ensemble.ensemble import Ensemble
from twin.experiment import Experiment
from twin.ensemble.draws import Draws
with tempfile.TemporaryDirectory() as folder:
    draws = Draws({"thigh.coulomb": 0.3})
    ensemble = Ensemble(Experiment("thigh", "aprbs", 5.0), range(int(sys.argv[1])), draws, folder)
    ensemble.run(int(sys.argv[2]))
    assert sum(log.N for log in ensemble) == 50 * len(ensemble)
    assert ensemble.table().height == len(ensemble)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def main() -> None:
    """Print the table of throughputs, then the hour and the memory."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--threads", type=int, default=2)
    options.add_argument("--experiments", type=int, default=32)
    options.add_argument("--seconds", type=float, default=25.0)
    options.add_argument("--pairs", type=int, default=3)
    options.add_argument("--skip-memory", action="store_true")
    o = options.parse_args()
    print(f"{o.experiments} experiments of {o.seconds:g} s, {o.threads} threads, medians of {o.pairs} pairs")
    print(f"{'':28}{'ensemble':>12}{'bare':>12}{'recording':>12}{'ratio to':>10}{'ratio to':>11}{'processor':>11}")
    print(f"{'':28}{'steps/s':>12}{'steps/s':>12}{'steps/s':>12}{'bare':>10}{'recording':>11}{'ratio':>11}")
    cases: list[tuple[str, str, dict[str, float] | None]] = [
        *((joint, joint, None) for joint in ("shoulder", "thigh", "shank", "leg")),
        ("thigh, drive drawn", "thigh", DRIVE),
        ("thigh, models drawn", "thigh", FRICTION),
    ]
    for name, joint, spread in cases:
        throughput(name, Experiment(joint, "aprbs", o.seconds), Draws(spread) if spread else None, o)
    for count, seconds in ((1, 3600.0), (2, 1800.0), (14, 257.2)):
        hour(count, seconds, o.threads)
    if not o.skip_memory:
        memory(o.threads)


def throughput(name: str, experiment: Experiment, draws: Draws | None, o: argparse.Namespace) -> None:
    """Print the row of one ensemble."""
    with tempfile.TemporaryDirectory() as folder:
        ensemble = Ensemble(experiment, range(o.experiments), draws, folder)
        cases = ensemble.members.prepare(range(o.experiments))
    runs = [case.run for case in cases if case.run is not None]
    steps_per_sample = round(experiment.Ts / TIMESTEP)
    lead = np.zeros((len(runs), round(SETTLE / TIMESTEP), len(experiment.joints)))
    voltages = np.concatenate(
        [lead, np.repeat(np.stack([run.commands for run in runs]), steps_per_sample, axis=1)], axis=1
    )
    steps = voltages.shape[0] * voltages.shape[1]

    def step_models(record: tuple[str, ...]) -> None:
        batch = Batch(runs[0].model, len(runs), o.threads)
        if draws is not None:
            batch.set_models([run.model for run in runs])
        batch.qpos = np.stack([run.qpos for run in runs])
        batch.rollout(voltages.shape[1], voltages, record=record)

    def run_ensemble() -> None:
        with tempfile.TemporaryDirectory() as folder:
            Ensemble(experiment, range(o.experiments), draws, folder).run(o.threads)

    rounds = []
    for k in range(o.pairs + 1):
        turns: list[Callable[[], None]] = [run_ensemble, lambda: step_models(()), lambda: step_models(("sensordata",))]
        order = [0, 1, 2] if k % 2 else [2, 1, 0]
        times = {i: timed(turns[i]) for i in order}
        if k > 0:  # the first turn warms up
            rounds.append([times[i] for i in range(3)])
    speeds = [statistics.median(steps / row[i][0] for row in rounds) for i in range(3)]
    ratios = [statistics.median(row[i][0] / row[0][0] for row in rounds) for i in (1, 2)]
    processor = statistics.median(row[1][1] / row[0][1] for row in rounds)
    print(f"{name:28}{speeds[0]:12,.0f}{speeds[1]:12,.0f}{speeds[2]:12,.0f}", end="")
    print(f"{ratios[0]:10.2f}{ratios[1]:11.2f}{processor:11.2f}", flush=True)


def hour(count: int, seconds: float, threads: int) -> None:
    """Print how long an hour of the thigh takes as `count` experiments."""
    with tempfile.TemporaryDirectory() as folder:
        ensemble = Ensemble(Experiment("thigh", "aprbs", seconds), range(count), None, folder)
        wall, processor = timed(lambda: ensemble.run(threads) and None)
    print(f"an hour of the thigh, {count} x {seconds:g} s: {wall:.1f} s, {processor:.1f} s of processors", flush=True)


def memory(threads: int) -> None:
    """Print the largest resident memory of ensembles of two sizes."""
    for count in (500, 2000):
        command = [sys.executable, "-c", MEMORY, str(count), str(threads)]
        process = subprocess.run(command, capture_output=True, text=True, check=True)
        print(
            f"{count} experiments of 5 s with drawn friction: {int(process.stdout) / 1024:.0f} MiB at most", flush=True
        )


def timed(run: Callable[[], None]) -> tuple[float, float]:
    """Seconds on the wall, and of all processors, that `run` takes."""
    wall, start = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
    run()
    end = resource.getrusage(resource.RUSAGE_SELF)
    return time.perf_counter() - wall, end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime


if __name__ == "__main__":
    main()
