"""What a designed experiment adds: a joint of the twin from a first sweep, and from the record designed on it.

    python scripts/design_loop.py [--joint thigh] [--seed 1] [--legs 0] [--jobs 1] [--figure docs/joint-design.png]

The table has the values of both records beside the truth; each is fitted to the first half, as `qpal identify` does.
The figure shows the designed input and prediction, and both records' intervals. With --legs N the loop runs on the
joints of N drawn legs (see `scripts/drawn_joints.py`). The summary then tells how often values are determined, found
and held, and how far the free run over a fresh sweep stays behind the ceiling, and the figure has the calibration of
the intervals by value.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from drawn_joints import TS, Leg, compared, leg, table, truths
from drawn_joints import draw as calibration

import twin
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.base.parallel import in_order
from sysid.data.record import IOData
from sysid.joint.design import Design, design
from sysid.joint.growth import Growth, grow_joint
from sysid.joint.values import JointValue, joint_values
from sysid.structures import actuated_joint
from twin.bench.records import sweep
from twin.hardware.actuator import drive
from twin.parameters import Parameters
from twin.plant.stepping import step

FIRST = 125.0  # [s] of the first record
SETTLE = 0.5  # [s] before a record begins


def first_record(joint: str, seed: int, p: Parameters) -> IOData:
    """A sweep with random times and levels that fits the leg."""
    return twin.Experiment(joint, "sweep", FIRST, TS, seed, (), p, sweep(joint, p, "voltage")).run().io()


def designed_record(d: Design, joint: str, seed: int, p: Parameters) -> IOData:
    """The leg under the designed input."""
    experiment = twin.Experiment(joint, "sweep", d.duration, d.Ts, seed, (), p)
    run = experiment.prepare(u=d.u[:, None])
    return experiment.record(run, step([run], d.Ts, SETTLE)[0]).io()


def grown(data: IOData, joint: str, p: Parameters) -> Growth:
    """The joint of a record, with the driver's step from the data sheet."""
    return grow_joint(data, actuated_joint(play=False, driver_step=drive(p, joint).step), starts=2)


def shown(value: JointValue | None, name: str) -> str:
    """A value with its interval, in degrees where it is an angle."""
    if value is None:
        return "–"
    factor = 180.0 / np.pi if value.unit.startswith("y") else 1.0
    text = f"{factor * value.value:.3g}"
    if value.low is None or value.high is None:
        return f"({text})"
    return f"{text} ({factor * value.low:.3g} to {factor * value.high:.3g})"


def one(joint: str, seed: int, figure: Path | None) -> None:
    """The table and the figure of the nominal leg."""
    p = Parameters()
    first = first_record(joint, seed, p)
    fit = grown(first, joint, p).fit
    d = design(fit, first, to_stops=True)
    second = designed_record(d, joint, seed + 1, p)
    half = second.split(0.5)[0]
    linearity = p["pot_linearity"] * p["pot_range"]
    columns = [
        {v.name: v for v in joint_values(fit, data=first, linearity=linearity)},
        {v.name: v for v in joint_values(grown(half, joint, p).fit, data=half, linearity=linearity)},
    ]
    true = truths(joint, p, d.Ts)
    print(f"first {FIRST:.0f} s, designed {d.duration:.0f} s; in brackets without interval: not determined")
    for name in dict.fromkeys([*columns[0], *columns[1]]):
        unit = next(c[name].unit for c in columns if name in c)
        factor = 180.0 / np.pi if unit.startswith("y") else 1.0
        cells = [shown(c.get(name), name) for c in columns]
        print(f"| {name} | {factor * true[name]:.3g} | {cells[0]} | {cells[1]} | {unit} |")
    if figure is not None:
        draw(d, second, figure)


def draw(d: Design, second: IOData, path: Path) -> None:
    """The designed input with prediction, and what the joint did."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    t = np.arange(len(d.u)) * d.Ts
    upper.step(t, d.u, where="post", color="tab:blue", linewidth=0.8)
    lower.plot(t, np.degrees(second.y[:, 0]), color="0.2", label="the joint")
    lower.plot(t, np.degrees(d.y), color="tab:red", linestyle="--", linewidth=0.8, label="predicted by the first fit")
    colours = {"ends": "0.75", "breakaway": "C2", "backlash": "C1"}
    for k, phase in enumerate(d.phases):
        for axes in (upper, lower):
            label = phase.name if axes is upper and k < len(colours) else None
            span = (phase.start * d.Ts, phase.stop * d.Ts)
            axes.axvspan(*span, alpha=0.2, color=colours[phase.name], linewidth=0, label=label)
    upper.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False)
    upper.set(ylabel="input [V]")
    lower.set(ylabel="angle [deg]", xlabel="time [s]")
    lower.legend(loc="upper left", bbox_to_anchor=(0, -0.18), ncols=2, frameon=False)
    figure.savefig(path, dpi=100)


def looped(joint: str, seed: int) -> Leg | None:
    """The loop on a drawn leg; None where no experiment can be designed."""
    p = leg(joint, seed)
    first = first_record(joint, 3 * seed, p)
    try:
        d = design(grown(first, joint, p).fit, first, to_stops=True)
    except InputError as error:
        print(f"{joint} {seed}: {error}", flush=True)
        return None
    data = designed_record(d, joint, 3 * seed + 1, p)
    began = time.process_time()
    growth = grown(data, joint, p)
    fit = growth.fit
    fresh = twin.Experiment(joint, "sweep", FIRST, d.Ts, 3 * seed + 2, (), p, sweep(joint, p, "voltage")).run()
    assert fresh.y_true is not None
    gap = fit_percent(fresh.y[fit.n_init :], fresh.y_true[fit.n_init :]) - fit.fit_percent(fresh.io())
    seconds = time.process_time() - began
    print(
        f"{joint} {seed}: gap {gap:.2f}, {len(d.u)} samples of {d.Ts:g} s, {growth.parts}, {growth.warnings}",
        flush=True,
    )
    return Leg(joint, seed, gap, seconds, compared(joint, seed, p, data, fit))


def called(job: tuple[str, int]) -> Leg | None:
    """One job: a joint and the seed of its leg."""
    return looped(*job)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joint", default="thigh", help="with --legs also several: shoulder,thigh,shank")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--legs", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if not given.legs:
        one(given.joint, given.seed, given.figure)
        return
    joints = given.joint.split(",")
    jobs = [(joint, seed) for seed in range(given.seed, given.seed + given.legs) for joint in joints]
    found = [each for each in in_order(called, jobs, given.jobs, None) if each is not None]
    for joint in joints:
        legs = [each for each in found if each.joint == joint]
        print(f"{joint}: designed on {len(legs)} of {given.legs}", end="; ")
        table(legs)
    print("all", end=", ")
    table(found)
    if given.figure is not None:
        calibration(found, given.figure)


if __name__ == "__main__":
    main()
