"""How often an actuated joint is found on the twin, all imperfections on: fit and ceiling, values and truth.

    python scripts/study.py joint_recovery [--seeds 0:100] [--workers 2] [--joints shoulder,thigh,shank] [--lead]

Fit: 2 x 125 s of the paper's sweep, and of one whose times and levels are drawn, estimated on the first half and run
free over the second; with --lead also how far the paper's structure stays behind. Values: 125 s each of the paper's
sweep, of a drawn one and of slow stairs of 7 V, fitted as three experiments: sweeps show ends and speeds, the stairs
what voltage starts the joint. The joint is that of `sysid.fit_joint`; how fine the bridge is and how
straight the potentiometer stand in their data sheets.
The thigh's weight holds its link against one side of the play, so its backlash is looked for once more with the leg
laid on its side, where nothing pulls.
"""

import argparse

import numpy as np
from study import Row, Study, words

import sysid
import twin
from sysid.base.criteria import fit_percent
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.joint.posterior import JointFit, fit_joint
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


def joint_of(data: IOData, joint: str, seed: int) -> JointFit:
    """The joint that the record bears out."""
    step = drive(twin.Parameters(), joint).step
    return fit_joint(data, actuated_joint(play=False, driver_step=step), seed=seed)


def gaps(joint: str, seed: int, lead: bool) -> list[float]:
    """Points by which the free run misses the ceiling, on the paper's sweep and on the drawn one; then, or nan, by
    which it is ahead of the paper's structure on the latter."""
    differences = []
    for log in (twin.Experiment(joint, "sweep", seed=seed).run(), irregular(joint, seed, 250.0, 0.1)):
        estimation, validation = log.io().split(0.5)
        fit = joint_of(estimation, joint, seed).fit
        assert log.y_true is not None
        samples = slice(estimation.N + fit.n_init, None)
        percent = fit.fit_percent(validation)
        differences.append(fit_percent(log.y[samples], log.y_true[samples]) - percent)
    if not lead:
        return [*differences, np.nan]
    s, (estimation, validation) = PAPER[joint].setting, quick_start(log.io())
    paper = sysid.fit(s.model(), estimation, search=s.search, starts=s.starts, seed=seed).fit_percent(validation)
    return [*differences, percent - max(paper, 0.0)]


def values_of(joint: str, seed: int, kind: str) -> dict[str, tuple[bool, bool, float]]:
    """By name: whether the value is near the truth, whether its interval holds the truth, and value less truth."""
    p = twin.Parameters({"gravity": 0.0}) if kind == "lying" else twin.Parameters()
    parts = []
    for name, (excitation, options) in RECORDS.items():
        settings = options | ({"half_period": HALF_PERIOD[joint]} if name == "drawn" else {})
        parts.append(twin.Experiment(joint, excitation, 125.0, seed=seed, parameters=p, options=settings).run().io())
    data = IOData.merge(*parts)
    linearity = p["pot_linearity"] * p["pot_range"]
    values = {v.name: v for v in joint_values(joint_of(data, joint, seed).fit, data=data, linearity=linearity)}
    true, out = twin_truth(joint, data.Ts, p), {}
    for name in WANTED:
        if name not in values:
            out[name] = (False, False, np.nan)
            continue
        error = values[name].value - true[name]
        out[name] = (abs(error) <= aim(name, true[name], data.Ts), values[name].holds(true[name]), error)
    return out


def cases(options: argparse.Namespace) -> list[tuple[str, int, str]]:
    """Joint, seed, and what is recovered: the fit, the values, and a thigh's values with the leg on its side."""
    kinds = [("fit", joint) for joint in options.joints] + [("values", joint) for joint in options.joints]
    kinds += [("lying", "thigh")] if "thigh" in options.joints else []
    return [(joint, seed, kind) for kind, joint in kinds for seed in options.seeds]


def score(case: tuple[str, int, str], options: argparse.Namespace) -> Row:
    """The gaps of a fit, or the values."""
    joint, seed, kind = case
    return {"gaps": gaps(joint, seed, options.lead)} if kind == "fit" else {"values": values_of(joint, seed, kind)}


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """By joint: how often the ceiling is reached, then the values."""
    lines = []
    groups = {(joint, kind): [r for r in rows if (r["case"][0], r["case"][2]) == (joint, kind)]
          for joint in options.joints for kind in ("fit", "values", "lying")}  # fmt: skip
    for joint in options.joints:
        fits = np.array([row["gaps"] for row in groups[joint, "fit"]], dtype=float).T
        for name, gap in zip(("the paper's sweep", "the drawn sweep"), fits, strict=False):
            lines.append(
                f"{joint}: within 0.5 point of the ceiling on {name} {100 * np.mean(gap <= 0.5):.0f} % of "
                f"{len(gap)} (median gap {np.median(gap):.2f}, worst {gap.max():.2f})"
            )
        if options.lead:
            lines.append(
                f"  15 points ahead of the paper's structure on it {100 * np.mean(fits[2] >= 15.0):.0f} % "
                f"(least {fits[2].min():.1f}, median {np.median(fits[2]):.1f})"
            )
        lines += value_lines(groups[joint, "values"], WANTED)
        if joint == "thigh":
            lines += ["  the leg laid on its side:", *value_lines(groups[joint, "lying"], ("backlash",))]
    return "\n".join(lines)


def value_lines(rows: list[Row], names: tuple[str, ...]) -> list[str]:
    """One line a value: how often found, how often its interval holds, and the errors."""
    lines = []
    for name in names:
        is_near, holds, error = np.array([row["values"][name] for row in rows], dtype=float).T
        finite = np.isfinite(error)
        low, middle, high = np.quantile(error[finite], (0.05, 0.5, 0.95)) if finite.any() else (np.nan,) * 3
        lines.append(
            f"  {name:15s} told {100 * finite.mean():3.0f} %, found {100 * is_near.mean():3.0f} %, interval holds "
            f"{100 * holds.mean():3.0f} %, error median {middle:.4g}, 5 to 95 % {low:.4g} to {high:.4g}"
        )
    return lines


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:100",
    options={
        "--joints": {"type": words, "default": list(twin.JOINTS)},
        "--lead": {"action": "store_true", "help": "also how far the paper's structure stays behind"},
    },
)
