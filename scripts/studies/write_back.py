"""How close MJCF comes to the fit that it was made from: three joints of the leg and the logs of a servo.

    python scripts/study.py write_back [--seeds 1:6] [--servo FOLDER]

A joint has the parts that MJCF has; RMS and largest difference are shares of the stroke. FOLDER holds the logs
of an XL330 with a pendulum (see `sysid.bench.scenarios.real`); its motor is solved in eight parts a sample, since a
load that changes within a sample is otherwise held for it.
"""

import argparse
from pathlib import Path
from typing import Any

from study import Study, markdown

import sysid
import twin
from sysid.bench.scenarios.real import servo_logs
from sysid.blocks import Motor
from sysid.export.mjcf import fragment
from sysid.structures import actuated_joint
from twin.fragment.rollout import check
from twin.studies.write_back import PARTS


def cases(options: argparse.Namespace) -> list[tuple[str, Any]]:
    """Joints and seeds; then the numbers of the servo's logs of a sine."""
    logs = servo_logs(options.servo) if options.servo is not None else []
    servo = [("servo", k) for k, (_, name, _) in enumerate(logs) if name.startswith("sin")]
    return [*((joint, seed) for joint in twin.JOINTS for seed in options.seeds), *servo]


def score(case: tuple[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Fit [%], and RMS and largest difference of the fragment [% of the stroke]."""
    joint, key = case
    if joint == "servo":
        chain = actuated_joint(motor=Motor(load=2, stops=False, at=0.0, substeps=8), knots=None, play=False)
        gain, trajectory, data = servo_logs(options.servo)[key]
        fit, parts, name = sysid.fit(chain, data, search="lm", starts=4, seed=0), (), f"servo {gain} {trajectory}"
    else:
        data = twin.Experiment(joint=joint, excitation="aprbs", duration=120.0, Ts=0.1, seed=key).run().io()
        joint = sysid.fit_joint(data, parts=PARTS)
        fit, parts, name = joint.fit, joint.shown, f"{joint} {key}"
    result = check(fragment(fit, "joint", 1.0), fit, data)
    row = {"name": name, "parts": ", ".join(parts), "fit": fit.fit_percent(data)}
    return row | {"rms": 100 * result.share, "worst": 100 * result.worst}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """A row for each record."""
    cells = [(r["name"], r["parts"], f"{r['fit']:.1f}", f"{r['rms']:.3f}", f"{r['worst']:.2f}") for r in rows]
    return markdown(("record", "parts", "fit %", "RMS % of stroke", "worst %"), cells, 2)


STUDY = Study(cases, score, summary, seeds="1:6", options={"--servo": {"type": Path, "metavar": "FOLDER"}})
