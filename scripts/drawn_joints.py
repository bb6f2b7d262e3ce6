"""How well an actuated joint of a drawn leg is found: what is determined, how near, and whether intervals hold.

    python scripts/drawn_joints.py [--seeds 20] [--first 0] [--joints shoulder,thigh,shank] [--jobs 1] [--figure FILE]

Every seed is another leg: each row of its joints, its board and its links is drawn within `SPREAD` of nominal, all
imperfections on. A joint is estimated from a sweep with random times and levels whose half periods fit the leg, and
from slow stairs, 125 s each; its free run over a fresh sweep is compared with the ceiling. Each physical value is
compared with the twin's truth: determined or not, error, and whether intervals of several levels hold.
"""

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

import twin
from sysid.base.criteria import fit_percent
from sysid.base.parallel import in_order
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.growth import grow_joint
from sysid.joint.values import JointValue, joint_values
from sysid.structures import actuated_joint
from twin.bench.records import sweep
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


def grown(joint: str, seed: int) -> tuple[Parameters, IOData, Fit, float]:
    """The leg, its record, the fit, and the points by which a free run over a fresh record misses the ceiling."""
    p = leg(joint, seed)
    data, fresh = records(joint, seed, p)
    fit = grow_joint(data, actuated_joint(play=False, driver_step=drive(p, joint).step), starts=2, seed=seed).fit
    ceiling = fit_percent(fresh.y[fit.n_init :], fresh.y_true[fit.n_init :])
    return p, data, fit, ceiling - fit.fit_percent(fresh.io())


@dataclass(frozen=True)
class Found:
    """A value of one leg: whether it is determined, its error, the accepted one, and whether its intervals hold."""

    joint: str
    seed: int
    determined: bool
    error: float
    aim: float
    holds: dict[float, bool]
    why: str


@dataclass(frozen=True)
class Leg:
    """A joint of one leg: points below the ceiling, seconds of computation, and its values by name."""

    joint: str
    seed: int
    gap: float
    seconds: float
    values: dict[str, Found] = field(default_factory=dict)


def truths(joint: str, p: Parameters, Ts: float = TS) -> dict[str, float]:
    """True values by every name that `sysid.joint_values` gives."""
    return twin_truth(joint, Ts, p)


def accepted(name: str, true: float) -> float:
    """Accepted error: 2 % of a speed, 10 % of a voltage, 0.5 degrees of an end, 20 % or 0.1 degrees of a backlash, 10
    ms of a time."""
    if name == "lag_and_delay":
        return aim("delay", true, TS)
    return aim(name.replace("moving_friction", "coulomb"), true, TS)


def studied(joint: str, seed: int) -> Leg:
    """The joint of one drawn leg, fitted and compared with its truth."""
    began = time.process_time()
    p, data, fit, gap = grown(joint, seed)
    values = compared(joint, seed, p, data, fit)
    return Leg(joint, seed, gap, time.process_time() - began, values)


def compared(joint: str, seed: int, p: Parameters, data: IOData, fit: Fit) -> dict[str, Found]:
    """Every value of a fit against the twin's truth."""
    linearity, true = p["pot_linearity"] * p["pot_range"], truths(joint, p, fit.Ts)
    by_level = {level: _named(joint_values(fit, level, data, linearity)) for level in LEVELS}
    found = {}
    for name, value in by_level[0.95].items():
        holds = {level: values[name].holds(true[name]) for level, values in by_level.items()}
        error = value.value - true[name]
        found[name] = Found(joint, seed, value.determined, error, accepted(name, true[name]), holds, value.why)
    return found


def _named(values: tuple[JointValue, ...]) -> dict[str, JointValue]:
    return {value.name: value for value in values}


# Values that the tables list, with the names under which a record that does not determine them gives less.
LISTED = (
    "speed_per_volt",
    "breakaway_up",
    "breakaway_down",
    "coulomb_up",
    "coulomb_down",
    "end_low",
    "end_high",
    "backlash",
    "time_constant",
    "delay",
    "lag_and_delay",
)


def table(legs: list[Leg]) -> None:
    """One line a value: how often determined, then of these: found, interval holds, and the worst case."""
    gaps = np.array([leg.gap for leg in legs])
    worst = legs[int(np.argmax(gaps))]
    print(
        f"n = {len(legs)}: within 0.5 of the ceiling {np.sum(gaps <= 0.5)}, median gap {np.median(gaps):.2f}, worst "
        f"{worst.gap:.2f} ({worst.joint} {worst.seed}); {np.median([leg.seconds for leg in legs]):.0f} s a leg"
    )
    for name in LISTED:
        told = [leg.values[name] for leg in legs if name in leg.values and leg.values[name].determined]
        print(f"  {name:15s} determined {len(told):3d} of {len(legs)}", end="")
        if not told:
            print()
            continue
        shares = np.array([abs(found.error) / found.aim for found in told])
        held = sum(found.holds[0.95] for found in told)
        far = told[int(np.argmax(shares))]
        low, high = binom.interval(0.95, len(told), 0.95)
        print(
            f", found {np.sum(shares <= 1.0):3d}, 95 % interval holds {held:3d} ({low:.0f} to {high:.0f} by chance), "
            f"error / accepted: median {np.median(shares):.2f}, worst {shares.max():.1f} ({far.joint} {far.seed})",
            flush=True,
        )


def draw(legs: list[Leg], where: Path) -> None:
    """Share of intervals that hold over their level, by value, and every error over the accepted one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot((0.5, 1), (0.5, 1), color="0.6", linewidth=1, label="level = share")
    names = [name for name in LISTED if any(name in leg.values for leg in legs)]
    for name in names:
        told = [leg.values[name] for leg in legs if name in leg.values and leg.values[name].determined]
        if len(told) >= 10:
            held = [np.mean([found.holds[level] for found in told]) for level in LEVELS]
            left.plot(LEVELS, held, marker=".", label=f"{name.replace('_', ' ')} ({len(told)})")
    left.set(xlabel="level of the interval", ylabel="share that holds the truth", ylim=(0, 1.02))
    left.legend(fontsize=7)
    for row, name in enumerate(names):
        found = [leg.values[name] for leg in legs if name in leg.values]
        for sure, colour in ((False, "0.75"), (True, "C0")):
            errors = [np.clip(f.error / f.aim, -5, 5) for f in found if f.determined == sure]
            right.plot(errors, np.full(len(errors), row), "|", color=colour, markersize=9)
    right.axvspan(-1, 1, color="0.93", zorder=0)
    right.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    right.set(xlabel="error / accepted error; grey: not determined; cut off at 5")
    figure.savefig(where, dpi=120)


def called(job: tuple[str, int]) -> Leg:
    """One job: a joint and the seed of its leg."""
    return studied(*job)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--joints", default=",".join(twin.JOINTS))
    parser.add_argument("--figure", type=Path, help="PNG with calibration and errors by value")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    jobs = [(joint, seed) for joint in given.joints.split(",") for seed in seeds]
    legs = in_order(called, jobs, given.jobs, None)
    for joint in given.joints.split(","):
        print(joint, end=", ")
        table([leg for leg in legs if leg.joint == joint])
    print("all", end=", ")
    table(legs)
    if given.figure:
        draw(legs, given.figure)


if __name__ == "__main__":
    main()
