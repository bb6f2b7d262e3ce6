"""What a designed experiment adds: a joint of the twin from a first sweep, and from the record designed on it.

    python scripts/study.py design_loop --nominal [--joints thigh] [--seeds 1:2] [--figure docs/joint-design.png]
    python scripts/study.py design_loop [--joints shoulder,thigh,shank] [--seeds 8100:8108] [--figure FILE]

With --nominal a table has the values of both records beside the truth; each is fitted to the first half, as `qpal
identify` does. The figure shows the designed input and prediction, and both records' intervals. Otherwise the loop runs
on the joints of drawn legs (see the study drawn_joints). The summary then tells how often values are determined, found
and held, and how far the free run over a fresh sweep stays behind the ceiling, and the figure has the calibration of
the intervals by value.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from drawn_joints import TS, compare_values, leg, table
from drawn_joints import draw as draw_calibration
from study import MISSING, Row, Study, words

import twin
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.joint.design import Design, design
from sysid.joint.posterior import JointFit, fit_joint
from sysid.joint.values import JointValue, joint_values
from sysid.structures import actuated_joint
from twin.bench.families import sweep
from twin.hardware.actuator import drive
from twin.parameters import Parameters
from twin.plant.stepping import step
from twin.studies.beyond import twin_truth

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


def joint_of(data: IOData, joint: str, p: Parameters) -> JointFit:
    """The joint of a record, with the driver's step from the data sheet."""
    return fit_joint(data, actuated_joint(play=False, driver_step=drive(p, joint).step), starts=2)


def value_text(value: JointValue | None) -> str:
    """A value with its interval, in degrees where it is an angle."""
    if value is None:
        return MISSING
    factor = 180.0 / np.pi if value.unit.startswith("y") else 1.0
    text = f"{factor * value.value:.3g}"
    if value.low is None or value.high is None:
        return f"({text})"
    return f"{text} ({factor * value.low:.3g} to {factor * value.high:.3g})"


def nominal_table(joint: str, seed: int, figure: Path | None) -> str:
    """The table of the nominal leg; its figure is drawn."""
    p = Parameters()
    first = first_record(joint, seed, p)
    fit = joint_of(first, joint, p).fit
    d = design(fit, first, to_stops=True)
    second = designed_record(d, joint, seed + 1, p)
    half = second.split(0.5)[0]
    linearity = p["pot_linearity"] * p["pot_range"]
    columns = [
        {v.name: v for v in joint_values(fit, data=first, linearity=linearity)},
        {v.name: v for v in joint_values(joint_of(half, joint, p).fit, data=half, linearity=linearity)},
    ]
    true = twin_truth(joint, d.Ts, p)
    lines = [f"first {FIRST:.0f} s, designed {d.duration:.0f} s; in brackets without interval: not determined"]
    for name in dict.fromkeys([*columns[0], *columns[1]]):
        unit = next(c[name].unit for c in columns if name in c)
        factor = 180.0 / np.pi if unit.startswith("y") else 1.0
        cells = [value_text(c.get(name)) for c in columns]
        lines.append(f"| {name} | {factor * true[name]:.3g} | {cells[0]} | {cells[1]} | {unit} |")
    if figure is not None:
        draw(d, second, figure)
    return "\n".join(lines)


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


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """The loop on a drawn leg, or the table of the nominal one; the reason where no experiment can be designed."""
    joint, seed = case
    if options.nominal:
        return {"text": nominal_table(joint, seed, options.figure)}
    p = leg(joint, seed)
    first = first_record(joint, 3 * seed, p)
    try:
        d = design(joint_of(first, joint, p).fit, first, to_stops=True)
    except InputError as error:
        return {"joint": joint, "refused": str(error)}
    data = designed_record(d, joint, 3 * seed + 1, p)
    start = time.process_time()
    found = joint_of(data, joint, p)
    fit = found.fit
    fresh = twin.Experiment(joint, "sweep", FIRST, d.Ts, 3 * seed + 2, (), p, sweep(joint, p, "voltage")).run()
    assert fresh.y_true is not None
    gap = fit_percent(fresh.y[fit.n_init :], fresh.y_true[fit.n_init :]) - fit.fit_percent(fresh.io())
    row = {"joint": joint, "seed": seed, "gap": gap, "seconds": time.process_time() - start}
    row |= {"samples": len(d.u), "Ts": d.Ts, "parts": list(found.shown), "warnings": list(found.warnings)}
    return row | {"values": compare_values(joint, p, data, fit)}


def line(row: Row) -> str:
    """How the loop went on one leg."""
    joint, seed = row["case"]
    if "gap" not in row:
        return f"{joint} {seed}: {row.get('refused', 'nominal')}"
    record = f"{row['samples']} samples of {row['Ts']:g} s"
    return f"{joint} {seed}: gap {row['gap']:.2f}, {record}, {row['parts']}, {row['warnings']}"


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """The table of the nominal leg, or of each joint and of all, and the figure if asked for."""
    if options.nominal:
        return "\n".join(row["text"] for row in rows)
    with_design, lines = [row for row in rows if "gap" in row], []
    for joint in options.joints:
        group = [row for row in with_design if row["joint"] == joint]
        legs = f"{joint}: designed on {len(group)} of {len(options.seeds)}"
        lines.append(f"{legs}; {table(group)}" if group else legs)
    if options.figure is not None:
        draw_calibration(with_design, options.figure)
    return "\n".join([*lines, f"all, {table(with_design)}"] if with_design else lines)


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=summary,
    seeds="1:2",
    options={
        "--joints": {"type": words, "default": ["thigh"]},
        "--nominal": {"action": "store_true", "help": "the nominal leg instead of drawn ones"},
        "--figure": {"type": Path},
    },
    line=line,
)
