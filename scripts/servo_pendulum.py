"""A servo's logs end to end: the pendulum twin from the data sheet, calibrated on twelve logs, on four held out.

    python scripts/servo_pendulum.py FOLDER [--figure FILE.png]

FOLDER holds the 16 logs of an XL330 with a pendulum (see `sysid.bench.scenarios.real`). Every model runs freely on the
four logs of gain 400 under the recorded voltage; the first 50 samples are not scored.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import sysid
from sysid import IOData
from sysid.bench.methods.physical import servo_joint, servo_profile
from sysid.bench.scenarios.real import HELD_OUT, servo_logs
from sysid.structures import output_error
from twin.calibrate.problem import Free, Record, Simulations
from twin.calibrate.search import find_optimum
from twin.pendulum import Pendulum, respond

MASS, LENGTH = 0.49, 0.1  # kg, m: written in every log
UNSCORED = 50
FIRST = Pendulum(MASS, LENGTH)
# What a servo's voltage and angle can tell, with the mass and length known. Scales are what a data sheet leaves open.
FREE = (
    Free("no_load_speed", FIRST.no_load_speed, 1.0, 19.9, "rad/s", 3.0),
    Free("stall_torque", FIRST.stall_torque, 0.21, 3.0, "N m", 0.2),
    Free("rotor_inertia", FIRST.rotor_inertia, 1e-4, 0.02, "kg m2", 5e-4),
    Free("load_friction", FIRST.load_friction, 0.0, 2.0, "1", 0.1),
    Free("coulomb", FIRST.coulomb, 0.0, 1.0, "N m", 0.01),
    Free("supply_resistance", FIRST.supply_resistance, 0.0, 10.0, "Ohm", 0.5),
    Free("delay", FIRST.delay, 0.0, 0.1, "s", 0.005),
    Free("zero", FIRST.zero, -0.2, 0.2, "rad", 0.02),
)
NAMES = tuple(free.name for free in FREE)


def with_values(values: np.ndarray) -> Pendulum:
    """The pendulum with these values of `FREE`."""
    return FIRST.replace(**dict(zip(NAMES, map(float, values), strict=True)))


def record(name: str, data: IOData) -> Record:
    """A log as the calibration takes it: its first angle is its own, and its first samples are not scored."""
    y = data.y[:, 0].copy()
    y[:UNSCORED] = np.nan

    def run(theta: np.ndarray) -> np.ndarray:
        pendulums = [with_values(row[: len(FREE)]) for row in theta]
        return respond(pendulums, data.u[:, 0], data.Ts, theta[:, len(FREE)])

    start = Free("start", float(data.y[0, 0]), -4.0, 4.0, "rad", 0.01)
    return Record(name, y, data.Ts, run, (start,))


def calibrate_pendulum(train: list[tuple[str, IOData]], draws: int = 24) -> tuple[Pendulum, dict[str, float]]:
    """The pendulum that follows the training logs best, and how the search went."""
    problem = Simulations(FREE, [record(*log) for log in train])
    began = time.perf_counter()
    optimum = find_optimum(problem, np.random.default_rng(0), draws)
    values = problem.values(optimum.p)[: len(FREE)]
    rms = float(np.sqrt(optimum.cost / sum(problem.lengths)))
    facts = {"seconds": time.perf_counter() - began, "training RMS [rad]": rms, "agreed": optimum.agreed}
    return with_values(values), facts | {"descents": optimum.descents}


def errors(run, tests: list[tuple[str, IOData]]) -> list[np.ndarray]:
    """Scored free-run errors of each held-out log."""
    return [(run(data) - data.y[:, 0])[UNSCORED:] for _, data in tests]


def of_pendulum(pendulum: Pendulum):
    return lambda data: respond([pendulum], data.u[:, 0], data.Ts, [float(data.y[0, 0])])[0]


def of_fit(fit):
    return lambda data: fit.simulate(data, UNSCORED).ravel()


def rms(parts: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def table(folder: Path) -> tuple[list[tuple[str, list[np.ndarray]]], Pendulum, dict, list]:
    """Each model with its errors, the calibrated pendulum, how its search went, and the held-out logs."""
    logs = servo_logs(folder)
    train = [(f"{kp} {name}", data) for kp, name, data in logs if kp != HELD_OUT]
    tests = [(name, data) for kp, name, data in logs if kp == HELD_OUT]
    training = IOData.merge(*(data for _, data in train))
    best, facts = calibrate_pendulum(train)
    rows = [
        ("output error (2,2,1)", of_fit(sysid.fit(output_error(2, 2, 1), training))),
        ("actuated joint", of_fit(servo_joint(training))),
        ("motor with profile", of_fit(servo_profile(training))),
        ("pendulum twin, data sheet", of_pendulum(FIRST)),
        ("pendulum twin, calibrated", of_pendulum(best)),
    ]
    return [(name, errors(run, tests)) for name, run in rows], best, facts, tests


def draw(path: Path, rows: list, best: Pendulum, tests: list) -> None:
    """The four held-out logs beside the calibrated twin."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.2), layout="constrained")
    axes = figure.subplots(2, 2)
    for ax, (name, data), parts in zip(axes.ravel(), tests, rows[-1][1], strict=True):
        t = np.arange(data.N) * data.Ts
        ax.plot(t, np.degrees(data.y[:, 0]), color="0.2", label="servo")
        ax.plot(t, np.degrees(of_pendulum(best)(data)), color="tab:red", linestyle="--", label="calibrated twin")
        ax.set(title=f"{name.replace('_', ' ')}: {np.degrees(rms([parts])):.1f} deg RMS", ylabel="angle [deg]")
        ax.set_xlabel("time [s]")
    axes[0, 0].legend()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    rows, best, told, tests = table(given.folder)
    print("| free run, RMS [rad] | all | " + " | ".join(name for name, _ in tests) + " |")
    for name, parts in rows:
        print(f"| {name} | {rms(parts):.4f} | " + " | ".join(f"{rms([part]):.3f}" for part in parts) + " |")
    print({name: round(getattr(best, name), 5) for name in NAMES}, told)
    if given.figure is not None:
        draw(given.figure, rows, best, tests)
