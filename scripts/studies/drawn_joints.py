"""How well an actuated joint of a drawn leg is found: what is determined, how near, and whether intervals hold.

    python scripts/study.py drawn_joints [--seeds 0:20] [--joints shoulder,thigh,shank] [--figure FILE]

Every seed is another leg: each row of its joints, its board and its links is drawn within `SPREAD` of nominal, all
imperfections on. A joint is estimated from a sweep with random times and levels whose half periods fit the leg, and
from slow stairs, 125 s each; its free run over a fresh sweep is compared with the ceiling. Each physical value is
compared with the twin's truth: determined or not, error, and whether intervals of several levels hold.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom
from study import Row, Study, words

import twin
from sysid.base.criteria import fit_percent
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.posterior import fit_joint
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from twin.bench.families import sweep
from twin.ensemble.draws import Draws
from twin.hardware.actuator import drive
from twin.parameters import TABLE, Parameters
from twin.studies.beyond import aim, twin_truth

SPREAD = 0.4  # of nominal, to each side
NARROW = {"base_angle": 0.05, "rod_angle": 0.05, "retracted_length": 0.1, "base_radius": 0.1, "rod_radius": 0.1}
# What the records presuppose (supply, board, converter), and rows that concern servo mode or the bench.
KEPT = ("supply_voltage", "rated_voltage", "pot_range", "pot_supply", "adc_bits", "pwm_bits", "switch_period")
KEPT += ("servo_kp", "servo_ki", "servo_kd", "gravity", "bench_height", "gear_ratio", "lead")
STARTS = 0.75  # of the supply: a joint that needs more to start is drawn again
DURATION, TS = 125.0, 0.1  # [s]
STAIRS = {"hold": 0.1, "steps": 80, "order": "stairs"}
ABOVE = 1.7  # top of the stairs, in break-away voltages
LEVELS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)


def leg(joint: str, seed: int) -> Parameters:
    """The drawn leg `seed`; one whose joint starts at `STARTS` of the supply or less."""
    nominal = Parameters()
    rows = [row.name for row in TABLE if row.name.split(".")[-1] not in KEPT and nominal[row.name] != 0.0]
    draws = Draws({name: NARROW.get(name.split(".")[-1], SPREAD) for name in rows}, seed=seed)
    for number in range(1000):
        p = draws.draw(nominal, number).parameters
        volts = [abs(twin_truth(joint, TS, p)[f"breakaway_{way}"]) for way in ("up", "down")]
        if max(volts) <= STARTS * p["supply_voltage"]:
            return p
    raise AssertionError("no leg of a thousand starts")


def records(joint: str, seed: int, p: Parameters) -> tuple[IOData, Any]:
    """The record to estimate from, and the log of a fresh sweep."""
    options = sweep(joint, p, "voltage")
    true = twin_truth(joint, TS, p)
    top = min(ABOVE * max(true["breakaway_up"], -true["breakaway_down"]), p["supply_voltage"])
    parts = [
        twin.Experiment(joint, "sweep", DURATION, TS, 3 * seed, (), p, options).run().io(),
        twin.Experiment(joint, "staircase", DURATION, TS, 3 * seed + 1, (), p, STAIRS | {"amplitude": top}).run().io(),
    ]
    return IOData.merge(*parts), twin.Experiment(joint, "sweep", DURATION, TS, 3 * seed + 2, (), p, options).run()


def joint_of(joint: str, seed: int) -> tuple[Parameters, IOData, Fit, float]:
    """The leg, its record, the fit, and the points by which a free run over a fresh record misses the ceiling."""
    p = leg(joint, seed)
    data, fresh = records(joint, seed, p)
    fit = fit_joint(data, actuated_joint(play=False, driver_step=drive(p, joint).step), starts=2, seed=seed).fit
    return p, data, fit, below_ceiling(fit, fresh)


def below_ceiling(fit: Fit, log: Any) -> float:
    """Points by which a free run over a log misses the fit that its noise leaves."""
    return fit_percent(log.y[fit.n_init :], log.y_true[fit.n_init :]) - fit.fit_percent(log.io())


def accepted_error(name: str, true: float) -> float:
    """Accepted error: 2 % of a speed, 10 % of a voltage, 0.5 degrees of an end, 20 % or 0.1 degrees of a backlash, 10
    ms of a time."""
    if name == "lag_and_delay":
        return aim("delay", true, TS)
    return aim(name.replace("moving_friction", "coulomb"), true, TS)


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """The joint of one drawn leg: points below the ceiling, seconds of computation, and its values by name."""
    joint, seed = case
    start = time.process_time()
    p, data, fit, gap = joint_of(joint, seed)
    values = compare_values(joint, p, data, fit)
    return {"joint": joint, "seed": seed, "gap": gap, "seconds": time.process_time() - start, "values": values}


def compare_values(joint: str, p: Parameters, data: IOData, fit: Fit) -> dict[str, Row]:
    """Every value of a fit against the twin's truth: determined or not, error, accepted error, whether intervals hold
    at each of `LEVELS`."""
    linearity, true = p["pot_linearity"] * p["pot_range"], twin_truth(joint, fit.Ts, p)
    by_level = {level: {v.name: v for v in joint_values(fit, level, data, linearity)} for level in LEVELS}
    return {
        name: {
            "determined": value.determined,
            "error": value.value - true[name],
            "aim": accepted_error(name, true[name]),
            "holds": [values[name].holds(true[name]) for values in by_level.values()],
            "why": value.why,
        }
        for name, value in by_level[0.95].items()
    }


# Values that the tables list, with the names under which a record that does not determine them gives less.
LISTED = ("speed_per_volt", "breakaway_up", "breakaway_down", "coulomb_up", "coulomb_down")
LISTED += ("end_low", "end_high", "backlash", "time_constant", "delay", "lag_and_delay")


def table(rows: list[Row]) -> str:
    """One line a value: how often determined, then of these: found, interval holds, and the worst case."""
    gaps = np.array([row["gap"] for row in rows])
    worst = rows[int(np.argmax(gaps))]
    lines = [
        f"n = {len(rows)}: within 0.5 of the ceiling {np.sum(gaps <= 0.5)}, median gap {np.median(gaps):.2f}, worst "
        f"{worst['gap']:.2f} ({worst['joint']} {worst['seed']}); {np.median([r['seconds'] for r in rows]):.0f} s a leg"
    ]
    for name in LISTED:
        determined_values = [
            (row["values"][name], row) for row in rows if row["values"].get(name, {}).get("determined")
        ]
        text = f"  {name:15s} determined {len(determined_values):3d} of {len(rows)}"
        if determined_values:
            shares = np.array([abs(value["error"]) / value["aim"] for value, _ in determined_values])
            holding = sum(value["holds"][LEVELS.index(0.95)] for value, _ in determined_values)
            worst = determined_values[int(np.argmax(shares))][1]
            low, high = binom.interval(0.95, len(determined_values), 0.95)
            text += (
                f", found {np.sum(shares <= 1.0):3d}, 95 % interval holds {holding:3d} "
                f"({low:.0f} to {high:.0f} by chance), error / accepted: median {np.median(shares):.2f}, "
                f"worst {shares.max():.1f} ({worst['joint']} {worst['seed']})"
            )
        lines.append(text)
    return "\n".join(lines)


def draw(rows: list[Row], path: Path) -> None:
    """Share of intervals that hold over their level, by value, and every error over the accepted one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    calibration_axes, error_axes = figure.subplots(1, 2)
    calibration_axes.plot((0.5, 1), (0.5, 1), color="0.6", linewidth=1, label="level = share")
    names = [name for name in LISTED if any(name in row["values"] for row in rows)]
    for k, name in enumerate(names):
        values = [row["values"][name] for row in rows if name in row["values"]]
        determined_values = [value for value in values if value["determined"]]
        if len(determined_values) >= 10:
            shares = np.mean([value["holds"] for value in determined_values], axis=0)
            calibration_axes.plot(
                LEVELS, shares, marker=".", label=f"{name.replace('_', ' ')} ({len(determined_values)})"
            )
        for is_determined, colour in ((False, "0.75"), (True, "C0")):
            errors = [np.clip(v["error"] / v["aim"], -5, 5) for v in values if v["determined"] == is_determined]
            error_axes.plot(errors, np.full(len(errors), k), "|", color=colour, markersize=9)
    calibration_axes.set(xlabel="level of the interval", ylabel="share that holds the truth", ylim=(0, 1.02))
    calibration_axes.legend(fontsize=7)
    error_axes.axvspan(-1, 1, color="0.93", zorder=0)
    error_axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    error_axes.set(xlabel="error / accepted error; grey: not determined; cut off at 5")
    figure.savefig(path, dpi=120)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """The table of each joint and of all, and the figure if asked for."""
    if options.figure:
        draw(rows, options.figure)
    groups = {joint: [row for row in rows if row["joint"] == joint] for joint in options.joints}
    return "\n".join(f"{name}, {table(group)}" for name, group in [*groups.items(), ("all", rows)])


STUDY = Study(
    cases=lambda options: ((joint, seed) for joint in options.joints for seed in options.seeds),
    score=score,
    summary=summary,
    seeds="0:20",
    options={
        "--joints": {"type": words, "default": list(twin.JOINTS)},
        "--figure": {"type": Path, "help": "PNG with calibration and errors by value"},
    },
)
