"""What an experiment designed for an input of use brings on fresh inputs of its kind, and how long the rig takes.

    python scripts/study.py design_for_use [--seeds 500:502] [--joints shoulder,thigh,shank]

Legs are those of `drawn_joints`. A joint is fitted to one sweep of 125 s at 0.1 s; an experiment is designed for levels
and times drawn at random over the whole supply; the joint is fitted to both records. Points of fit below the noise
ceiling in free run on two other draws of that kind, before and after. "expected" is the deviation that the design
expects on the input of use with both records [deg], "real" the root mean square of what is left there beside noise.
"""

import argparse

import numpy as np
from design_loop import designed_record
from drawn_joints import DURATION, below_ceiling, leg, records
from study import Row, Study, words

import twin
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.design import design
from sysid.joint.posterior import fit_joint
from sysid.joint.stops import reading_noise
from sysid.structures import actuated_joint
from twin.hardware.actuator import drive

OTHERS = (3, 4)  # draws of the kind of use, beside draw 2, which the design is for


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Points below the ceiling on other inputs of the kind, expected and real deviation, and the rig's time."""
    joint, seed = case
    p = leg(joint, seed)
    plain = actuated_joint(play=False, driver_step=drive(p, joint).step)
    data = records(joint, seed, p)[0].experiments[0]

    def log(k: int) -> twin.Log:
        settings = {"amplitude": p["supply_voltage"]}
        return twin.Experiment(joint, "aprbs", DURATION, data.Ts, 1000 * seed + k, (), p, settings).run()

    first, use = fit_joint(data, plain, seed=seed).fit, log(2)
    try:
        found = design(first, data, to_stops=True, use=use.io().u[:, 0])
    except InputError:  # the sweep is expected to tell enough
        both, expected, rig = first, (np.nan, np.nan), 0.0
    else:
        assert found.use is not None
        expected, rig = found.use.deviations, found.duration
        both = fit_joint(IOData.merge(data, designed_record(found, joint, 3 * seed + 4, p)), plain, seed=seed).fit
    others = [log(k) for k in OTHERS]
    return {
        **{"joint": joint, "seed": seed, "rig": rig, "expected": expected},
        "real": [_left(fit, use.io()) for fit in (first, both)],
        "points": [[below_ceiling(fit, other) for other in others] for fit in (first, both)],
    }


def _left(fit: Fit, data: IOData) -> float:
    """Root mean square of the free run's error beside noise [y]."""
    e = (data.y - fit.simulate(data).reshape(data.y.shape))[fit.n_init :]
    return float(np.sqrt(max(np.mean(e**2) - reading_noise(data) ** 2, 0.0)))


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Points before and after, deviations, and the time of the rig."""
    lines = []
    for k, name in enumerate(("sweep alone", "with the experiment")):
        x = np.array([row["points"][k] for row in rows]).ravel()
        expected, real = (np.degrees([row[kind][k] for row in rows]) for kind in ("expected", "real"))
        lines.append(
            f"{name:20s} n {len(x)}  within 0.5 {np.sum(x <= 0.5)}  within 2 {np.sum(x <= 2.0)}  median "
            f"{np.median(x):.2f}  worst {x.max():.1f}  expected {np.nanmedian(expected):.2f} deg, real "
            f"{np.median(real):.2f} deg (medians), real beyond twice the expected on {np.sum(real > 2.0 * expected)}"
        )
    rig = [row["rig"] for row in rows]
    none = sum(seconds == 0.0 for seconds in rig)
    return "\n".join([*lines, f"rig: median {np.median(rig):.0f} s, longest {max(rig):.0f} s, none on {none}"])


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=summary,
    seeds="500:502",
    options={"--joints": {"type": words, "default": ["shoulder", "thigh", "shank"]}},
)
