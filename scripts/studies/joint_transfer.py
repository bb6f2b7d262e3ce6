"""What a joint of a drawn leg loses on a sweep that it has not seen, and on another kind of input.

    python scripts/study.py joint_transfer [--seeds 0:8] [--joints shoulder,thigh,shank] [--record designed]

Legs are those of `drawn_joints`. A joint is estimated from one sweep of 125 s at 0.1 s, from this and slow stairs
(`--record stairs`), or from the record that is designed on the sweep (`--record designed`), by growth and with all
parts at once (`sysid.joint_posterior`). Its free run is compared with the noise ceiling on a fresh sweep, and on levels
and times drawn at random over the whole supply (aprbs). "found" are joints within 0.5 points, "band" the share of
unseen samples that the 95 % band of the free run holds, on the mean and on the worst joint. Values: how many are told,
how many of these are near the truth, and how many intervals hold it.
"""

import argparse
import time

import numpy as np
from design_loop import designed_record
from drawn_joints import DURATION, TS, below_ceiling, leg, records
from study import Row, Study, words

import twin
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.design import design
from sysid.joint.growth import grow_joint
from sysid.joint.posterior import joint_posterior
from sysid.joint.transfer import joint_information
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from sysid.uncertainty.bands import monte_carlo
from twin.hardware.actuator import drive
from twin.studies.beyond import aim, twin_truth

WAYS = {
    "growth": lambda data, plain, seed: grow_joint(data, plain, starts=2, seed=seed).fit,
    "all parts": lambda data, plain, seed: joint_posterior(data, plain, seed=seed),
}
KINDS = ("same kind", "another kind")


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Points below the ceiling on both kinds of input, and seconds, of both ways."""
    joint, seed = case
    p = leg(joint, seed)
    data, fresh = records(joint, seed, p)
    if options.record != "stairs":
        data = data.experiments[0]
    if options.record == "designed":
        plain = actuated_joint(play=False, driver_step=drive(p, joint).step)
        first = joint_posterior(data, plain, seed=seed)
        data = designed_record(design(first, data, to_stops=True), joint, 3 * seed + 4, p)
    amplitude = {"amplitude": p["supply_voltage"]}
    other = twin.Experiment(joint, "aprbs", DURATION, TS, 3 * seed + 3, (), p, amplitude).run()
    row: Row = {"joint": joint, "seed": seed}
    for name, way in WAYS.items():
        start = time.process_time()
        fit = way(data, actuated_joint(play=False, driver_step=drive(p, joint).step), seed)
        row[name] = {"seconds": time.process_time() - start}
        info = joint_information(fit, data)
        for kind, log in zip(KINDS, (fresh, other), strict=True):
            row[name][kind] = below_ceiling(fit, log)
            band = monte_carlo(info, log.io(), noise=True, draws=200)
            held = (band.lower <= log.y) & (log.y <= band.upper)
            row[name][f"held, {kind}"] = float(np.mean(held[fit.n_init :]))
        row[name]["values"] = values_of(fit, data, joint, p)
    return row


def values_of(fit: Fit, data: IOData, joint: str, p: twin.Parameters) -> dict[str, tuple[bool, bool]]:
    """Of each value that is told: whether it is near the truth, and whether its interval holds it."""
    true, out = twin_truth(joint, data.Ts, p), {}
    for v in joint_values(fit, data=data, linearity=p["pot_linearity"] * p["pot_range"]):
        if v.low is not None and v.name in true:
            near = abs(v.value - true[v.name]) <= aim(v.name, true[v.name], data.Ts)
            out[v.name] = (bool(near), bool(v.holds(true[v.name])))
    return out


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Found, within 2 points, median and worst by way and kind of input."""
    lines = []
    for name in WAYS:
        seconds = np.median([row[name]["seconds"] for row in rows])
        for kind in KINDS:
            x = np.array([row[name][kind] for row in rows])
            worst, held = rows[int(np.argmax(x))], [row[name][f"held, {kind}"] for row in rows]
            lines.append(
                f"{name:10s} {kind:12s} n {len(x)}  found {np.sum(x <= 0.5)}  within 2 {np.sum(x <= 2.0)}  median "
                f"{np.median(x):.2f}  worst {x.max():.1f} ({worst['joint']} {worst['seed']})  {seconds:.1f} s CPU  "
                f"band {100 * np.mean(held):.0f} %, worst {100 * np.min(held):.0f} %"
            )
        for value in sorted({v for row in rows for v in row[name]["values"]}):
            told = [row[name]["values"][value] for row in rows if value in row[name]["values"]]
            near, holds = np.mean(told, axis=0)
            lines.append(
                f"{name:10s} {value:20s} told on {len(told)}, near {100 * near:.0f} %, held {100 * holds:.0f} %"
            )
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
    },
)
