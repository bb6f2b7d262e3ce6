"""How often an actuated joint is found on the twin, all imperfections on: fit and ceiling, values and truth.

    python scripts/joint_recovery.py [--seeds 100] [--jobs 2] [--joints shoulder,thigh,shank]

Fit: the paper's sweep, 2 x 125 s, estimated on the first half and run free over the second. Values: 125 s of a sweep
whose times and levels are drawn, and 125 s of slow stairs of 7 V, fitted as two experiments with Stribeck's curve. A
sweep shows ends and speeds, the stairs show what voltage starts the joint.
"""

import argparse

import numpy as np
from joblib import Parallel, delayed

import sysid
import twin
from sysid.blocks import Motor
from sysid.criteria import fit_percent
from sysid.data import IOData
from sysid.joint_values import joint_values
from sysid.structures import actuated_joint

HALF_PERIOD = {"shoulder": 2.5, "thigh": 10.0, "shank": 10.0}
STRUCTURE = {"motor": Motor(load=3, stribeck=True, substeps=4)}
# What counts as found: a share of the truth, or radians.
SHARES = {"speed_per_volt": 0.02, "breakaway_up": 0.10, "breakaway_down": 0.10}
ENDS = np.deg2rad(0.5)


def gap(joint: str, seed: int) -> float:
    """Points by which the free run over the second half misses the ceiling."""
    log = twin.Experiment(joint, "sweep", seed=seed).run()
    estimation, validation = log.io().split(0.5)
    fit = sysid.fit(actuated_joint(), estimation, search="lm", starts=4, seed=seed)
    assert log.y_true is not None
    scored = slice(estimation.N + fit.n_init, None)
    return fit_percent(log.y[scored], log.y_true[scored]) - fit.fit_percent(validation)


def found(joint: str, seed: int) -> dict[str, tuple[bool, bool, float]]:
    """By name: whether the value is near the truth, whether its interval holds the truth, and value less truth."""
    truth = twin.truth(joint)
    moving = {"half_period": HALF_PERIOD[joint], "jitter": 0.5, "shrink": 0.6}
    slow = {"amplitude": 7.0, "hold": 0.1, "steps": 120, "order": "stairs"}
    parts = [
        twin.Experiment(joint, name, 125.0, seed=seed, options=options).run().io()
        for name, options in (("sweep", moving), ("staircase", slow))
    ]
    data = IOData.merge(*parts)
    fit = sysid.fit(actuated_joint(**STRUCTURE), data, search="lm", starts=4, seed=seed)
    true = {
        "speed_per_volt": truth.gain,
        "breakaway_down": truth.breakaway_voltage[0],
        "breakaway_up": truth.breakaway_voltage[1],
        "end_low": truth.end_angles[0],
        "end_high": truth.end_angles[1],
        "backlash": truth.backlash,
        "time_constant": -1.0 / truth.continuous_pole,
        "delay": truth.delay,
    }
    out = {}
    for value in joint_values(fit, data=data):
        if value.name in true:
            error = value.value - true[value.name]
            allowed = SHARES.get(value.name, 0.0) * abs(true[value.name])
            if value.name.startswith("end"):
                allowed = ENDS
            if value.name == "backlash":
                allowed = max(0.2 * truth.backlash, np.deg2rad(0.1))
            out[value.name] = (abs(error) <= allowed, value.holds(true[value.name]), error)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--joints", default=",".join(twin.JOINTS))
    given = parser.parse_args()
    for joint in given.joints.split(","):
        with Parallel(given.jobs) as pool:
            gaps = np.array(pool(delayed(gap)(joint, seed) for seed in range(given.seeds)))
            rows = pool(delayed(found)(joint, seed) for seed in range(given.seeds))
        print(
            f"{joint}: within 0.5 point of the ceiling {100 * np.mean(gaps <= 0.5):.0f} % of {given.seeds} "
            f"(median gap {np.median(gaps):.2f}, worst {gaps.max():.2f})"
        )
        for name in rows[0]:
            near, held, error = (np.array([row[name][k] for row in rows]) for k in range(3))
            print(
                f"  {name:15s} found {100 * near.mean():3.0f} %, interval holds {100 * held.mean():3.0f} %, "
                f"error median {np.median(error):.4g}, 5 to 95 % {np.quantile(error, 0.05):.4g} to "
                f"{np.quantile(error, 0.95):.4g}",
                flush=True,
            )


if __name__ == "__main__":
    main()
