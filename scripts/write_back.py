"""How close MJCF comes to the fit that it was made from: three joints of the leg and the logs of a servo.

    python scripts/write_back.py [--seeds 5] [--servo FOLDER]

A joint grows with the parts that MJCF has; RMS and largest difference are shares of the stroke. FOLDER holds the logs
of an XL330 with a pendulum (see `sysid.bench.scenarios.real`); its motor is solved in eight parts a sample, since a
load that changes within a sample is otherwise held for it.
"""

import argparse
from pathlib import Path

import sysid
import twin
from sysid.bench.scenarios.real import servo_logs
from sysid.blocks import Motor
from sysid.export.mjcf import fragment
from sysid.structures import actuated_joint
from twin.fragment import check
from twin.studies.write_back import PARTS


def show(name: str, fit: sysid.Fit, data: sysid.IOData, parts: str = "") -> None:
    found = check(fragment(fit, "joint", 1.0), fit, data)
    print(f"| {name} | {parts} | {fit.fit_percent(data):.1f} | {100 * found.share:.3f} | {100 * found.worst:.2f} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--servo", type=Path)
    given = parser.parse_args()
    print("| record | parts | fit % | RMS % of stroke | worst % |")
    for joint in twin.JOINTS:
        for seed in range(1, given.seeds + 1):
            data = twin.Experiment(joint=joint, excitation="aprbs", duration=120.0, Ts=0.1, seed=seed).run().io()
            growth = sysid.grow_joint(data, parts=PARTS)
            show(f"{joint} {seed}", growth.fit, data, ", ".join(growth.parts))
    if given.servo is not None:
        chain = actuated_joint(motor=Motor(load=2, stops=False, at=0.0, substeps=8), knots=None, play=False)
        for kp, name, data in servo_logs(given.servo):
            if name.startswith("sin"):
                show(f"servo {kp} {name}", sysid.fit(chain, data, search="lm", starts=4, seed=0), data)
