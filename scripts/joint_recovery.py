"""How often an actuated joint is found on the twin, all imperfections on: fit and ceiling, values and truth.

    python scripts/joint_recovery.py [--seeds 100] [--jobs 2] [--joints shoulder,thigh,shank] [--lead]

Fit: 2 x 125 s of the paper's sweep, and of one whose times and levels are drawn, estimated on the first half and run
free over the second; with --lead also how far the paper's structure stays behind. Values: 125 s each of the paper's
sweep, of a drawn one and of slow stairs of 7 V, fitted as three experiments: sweeps show ends and speeds, the stairs
what voltage starts the joint. The joint grows part by part (`sysid.joint.growth`); how fine the bridge is and how
straight the potentiometer stand in their data sheets.
The thigh's weight holds its link against one side of the play, so its backlash is looked for once more with the leg
laid on its side, where nothing pulls.
"""

import argparse
from typing import Any

import numpy as np

import sysid
import twin
from sysid.base.criteria import fit_percent
from sysid.base.parallel import in_order
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.joint.growth import Growth, grow_joint
from sysid.joint.values import joint_values
from sysid.structures import actuated_joint
from twin.hardware.actuator import drive
from twin.studies.beyond import aim, irregular, twin_truth
from twin.studies.protocol import PAPER

RECORDS = {
    "sweep": ("sweep", {}),
    "drawn": ("sweep", {"jitter": 0.5, "shrink": 0.6}),
    "stairs": ("staircase", {"amplitude": 7.0, "hold": 0.1, "steps": 120, "order": "stairs"}),
}
HALF_PERIOD = {"shoulder": 2.5, "thigh": 10.0, "shank": 10.0}  # [s] of the drawn sweep, on the mean
WANTED = (
    "speed_per_volt",
    "breakaway_up",
    "breakaway_down",
    "end_low",
    "end_high",
    "backlash",
    "time_constant",
    "delay",
)


def grown(data: IOData, joint: str, seed: int) -> Growth:
    """The joint that the record bears out."""
    step = drive(twin.Parameters(), joint).step
    return grow_joint(data, actuated_joint(play=False, driver_step=step), seed=seed)


def gaps(joint: str, seed: int, lead: bool) -> list[float]:
    """Points by which the free run misses the ceiling, on the paper's sweep and on the drawn one; then, or nan, by
    which it is ahead of the paper's structure on the latter."""
    found = []
    for log in (twin.Experiment(joint, "sweep", seed=seed).run(), irregular(joint, seed, 250.0, 0.1)):
        estimation, validation = log.io().split(0.5)
        fit = grown(estimation, joint, seed).fit
        assert log.y_true is not None
        scored = slice(estimation.N + fit.n_init, None)
        reached = fit.fit_percent(validation)
        found.append(fit_percent(log.y[scored], log.y_true[scored]) - reached)
    if not lead:
        return [*found, np.nan]
    s, (estimation, validation) = PAPER[joint].setting, quick_start(log.io())
    paper = sysid.fit(s.model(), estimation, search=s.search, starts=s.starts, seed=seed).fit_percent(validation)
    return [*found, reached - max(paper, 0.0)]


def found(joint: str, seed: int, lying: bool = False) -> dict[str, tuple[bool, bool, float]]:
    """By name: whether the value is near the truth, whether its interval holds the truth, and value less truth."""
    p = twin.Parameters({"gravity": 0.0}) if lying else twin.Parameters()
    parts = []
    for name, (excitation, options) in RECORDS.items():
        more = options | ({"half_period": HALF_PERIOD[joint]} if name == "drawn" else {})
        parts.append(twin.Experiment(joint, excitation, 125.0, seed=seed, parameters=p, options=more).run().io())
    data = IOData.merge(*parts)
    linearity = p["pot_linearity"] * p["pot_range"]
    values = {v.name: v for v in joint_values(grown(data, joint, seed).fit, data=data, linearity=linearity)}
    true, out = twin_truth(joint, data.Ts, p), {}
    for name in WANTED:
        if name not in values:
            out[name] = (False, False, np.nan)
            continue
        error = values[name].value - true[name]
        out[name] = (abs(error) <= aim(name, true[name], data.Ts), values[name].holds(true[name]), error)
    return out


def called(job: tuple[Any, ...]) -> Any:
    """One job: a function and its arguments."""
    return job[0](*job[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--scheduler", help="address of a Dask scheduler, instead of --jobs")
    parser.add_argument("--joints", default=",".join(twin.JOINTS))
    parser.add_argument("--lead", action="store_true")
    given = parser.parse_args()
    seeds, where = range(given.seeds), (given.jobs, given.scheduler)
    for joint in given.joints.split(","):
        fits = np.array(in_order(called, [(gaps, joint, seed, given.lead) for seed in seeds], *where)).T
        for name, gap in zip(("the paper's sweep", "the drawn sweep"), fits, strict=False):
            print(
                f"{joint}: within 0.5 point of the ceiling on {name} {100 * np.mean(gap <= 0.5):.0f} % of "
                f"{given.seeds} (median gap {np.median(gap):.2f}, worst {gap.max():.2f})"
            )
        if given.lead:
            print(
                f"  15 points ahead of the paper's structure on it {100 * np.mean(fits[2] >= 15.0):.0f} % "
                f"(least {fits[2].min():.1f}, median {np.median(fits[2]):.1f})",
                flush=True,
            )
        table(in_order(called, [(found, joint, seed) for seed in seeds], *where), WANTED)
        if joint == "thigh":
            print("  the leg laid on its side:")
            table(in_order(called, [(found, joint, seed, True) for seed in seeds], *where), ("backlash",))


def table(rows: list[dict[str, tuple[bool, bool, float]]], names: tuple[str, ...]) -> None:
    """One line a value: how often found, how often its interval holds, and the errors."""
    for name in names:
        near, held, error = (np.array([row[name][k] for row in rows]) for k in range(3))
        told = np.isfinite(error)
        low, middle, high = np.quantile(error[told], (0.05, 0.5, 0.95)) if told.any() else (np.nan,) * 3
        print(
            f"  {name:15s} told {100 * told.mean():3.0f} %, found {100 * near.mean():3.0f} %, interval holds "
            f"{100 * held.mean():3.0f} %, error median {middle:.4g}, 5 to 95 % {low:.4g} to {high:.4g}",
            flush=True,
        )


if __name__ == "__main__":
    main()
