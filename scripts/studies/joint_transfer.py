"""What a joint of a drawn leg loses on a sweep that it has not seen, and on another kind of input.

    python scripts/study.py joint_transfer [--seeds 0:8] [--joints shoulder,thigh,shank] [--record designed]
        [--figure FILE]

Legs are those of `drawn_joints`. A joint is estimated from one sweep of 125 s at 0.1 s, from this and slow stairs
(`--record stairs`), or from the record that is designed on the sweep (`--record designed`). Its free run is compared
with the noise ceiling on a fresh sweep, on levels and times drawn at random over the whole supply (aprbs), and on a sum
of sines of as much. "found" are joints within 0.5 points, "band" the share of unseen samples that the 95 % band of the
free run holds, on the mean and on the worst joint. Values: how many are told, how many of these are near the truth, and
how many intervals hold it.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from design_loop import designed_record
from drawn_joints import DURATION, below_ceiling, leg, records
from study import Row, Study, words

import twin
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.design import design
from sysid.joint.posterior import fit_joint
from sysid.joint.transfer import joint_information
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from sysid.uncertainty.bands import monte_carlo
from twin.bench.families import sweep
from twin.hardware.actuator import drive
from twin.studies.beyond import aim, twin_truth

SHOWN = 60.0  # [s] of a figure
KINDS = ("same kind", "another kind", "a third kind")


def fitted(joint: str, seed: int, p: twin.Parameters, options: argparse.Namespace) -> tuple[Fit, IOData, float]:
    """The joint of a drawn leg, its record, and the CPU seconds of the fit."""
    plain = actuated_joint(play=False, driver_step=drive(p, joint).step)
    data, _ = records(joint, seed, p)
    if options.record != "stairs":
        data = data.experiments[0]
    if options.record == "designed":
        first = fit_joint(data, plain, seed=seed).fit
        data = designed_record(design(first, data, to_stops=True), joint, 3 * seed + 4, p)
    start = time.process_time()
    return fit_joint(data, plain, seed=seed).fit, data, time.process_time() - start


def unseen(joint: str, seed: int, p: twin.Parameters, Ts: float) -> dict[str, Any]:
    """A log of each kind of input."""
    whole = {"amplitude": p["supply_voltage"]}
    inputs = ("sweep", 2, sweep(joint, p, "voltage")), ("aprbs", 3, whole), ("multisine", 1001, whole)
    return {
        kind: twin.Experiment(joint, name, DURATION, Ts, 3 * seed + k, (), p, settings).run()
        for kind, (name, k, settings) in zip(KINDS, inputs, strict=True)
    }


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Points below the ceiling on each kind of input, values, and seconds."""
    joint, seed = case
    p = leg(joint, seed)
    fit, data, seconds = fitted(joint, seed, p, options)
    row: Row = {"joint": joint, "seed": seed, "seconds": seconds}
    info = joint_information(fit, data)
    for kind, log in unseen(joint, seed, p, data.Ts).items():
        row[kind] = below_ceiling(fit, log)
        band = monte_carlo(info, log.io(), noise=True, draws=200)
        held = (band.lower <= log.y) & (log.y <= band.upper)
        row[f"held, {kind}"] = float(np.mean(held[fit.n_init :]))
    return row | {"values": values_of(fit, data, joint, p)}


def values_of(fit: Fit, data: IOData, joint: str, p: twin.Parameters) -> dict[str, tuple[bool, bool]]:
    """Of each value that is told: whether it is near the truth, and whether its interval holds it."""
    true, out = twin_truth(joint, data.Ts, p), {}
    for v in joint_values(fit, data=data, linearity=p["pot_linearity"] * p["pot_range"]):
        if v.low is not None and v.name in true:
            near = abs(v.value - true[v.name]) <= aim(v.name, true[v.name], data.Ts)
            out[v.name] = (bool(near), bool(v.holds(true[v.name])))
    return out


def draw(rows: list[Row], options: argparse.Namespace) -> None:
    """The worst joint on each kind of input that it was not fitted to, fitted once more, with its band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout="constrained")
    for ax, kind in zip(figure.subplots(2, 1), KINDS[1:], strict=True):
        worst = max(rows, key=lambda row: row[kind])
        joint, seed = worst["joint"], worst["seed"]
        p = leg(joint, seed)
        fit, data, _ = fitted(joint, seed, p, options)
        log = unseen(joint, seed, p, data.Ts)[kind]
        band = monte_carlo(joint_information(fit, data), log.io(), noise=True, draws=200)
        shown = slice(0, round(SHOWN / data.Ts))
        t, y, free_run = data.Ts * np.arange(len(log.y)), log.io().y[:, 0], fit.simulate(log.io())
        low, high = (np.degrees(side.reshape(-1)[shown]) for side in (band.lower, band.upper))
        ax.fill_between(t[shown], low, high, color="C1", alpha=0.3, label="95 % band")
        ax.plot(t[shown], np.degrees(y[shown]), color="0.2", label="measured")
        ax.plot(t[shown], np.degrees(free_run.reshape(-1)[shown]), color="C1", label="free run")
        title = f"{joint} {seed}, {kind}: {worst[kind]:.1f} points below the ceiling, the worst of {len(rows)}"
        ax.set(ylabel="angle [deg]", title=title)
    ax.set_xlabel("time [s]")
    ax.legend(loc="lower right", ncols=3)
    figure.savefig(options.figure, dpi=120)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Found, within 2 points, median and worst by kind of input; then the values."""
    if options.figure:
        draw(rows, options)
    seconds, lines = [row["seconds"] for row in rows], []
    for kind in KINDS:
        x, held = (np.array([row[name] for row in rows]) for name in (kind, f"held, {kind}"))
        worst = rows[int(np.argmax(x))]
        lines.append(
            f"{kind:12s} n {len(x)}  found {np.sum(x <= 0.5)}  within 2 {np.sum(x <= 2.0)}  median {np.median(x):.2f}  "
            f"worst {x.max():.1f} ({worst['joint']} {worst['seed']})  band {100 * np.mean(held):.0f} %, worst "
            f"{100 * np.min(held):.0f} %, below 85 % on {np.sum(held < 0.85)}"
        )
    lines.append(f"CPU median {np.median(seconds):.1f} s, worst {max(seconds):.1f} s")
    for value in sorted({v for row in rows for v in row["values"]}):
        told = [row["values"][value] for row in rows if value in row["values"]]
        near, holds = np.mean(told, axis=0)
        lines.append(f"{value:20s} told on {len(told)}, near {100 * near:.0f} %, held {100 * holds:.0f} %")
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=summary,
    seeds="0:8",
    options={
        "--joints": {"type": words, "default": ["shoulder", "thigh", "shank"]},
        "--record": {
            "default": "sweep",
            "choices": ("sweep", "stairs", "designed"),
            "help": "what is fitted",
        },
        "--figure": {"type": Path, "help": "PNG with the worst joint on each other kind of input"},
    },
    selecting=("figure",),
)
