"""`mujoco.sysid` on the task of the study calibration: the same logs, the same twin, the same free parameters.

    python scripts/study.py calibration_toolbox --seeds 1000:1003     # needs pip install mujoco[sysid]

It gets what it needs: a residual over a batch of parameters, so that its Jacobian is one batch too. Its parameters are
in their own units, as in its documentation, and it starts where a user would, at nominal values; "polish" starts it at
the place that the actuated joint gives.
"""

import time

import numpy as np
from study import MISSING, Study, markdown, words

import twin
from twin.bench.standin import LACKS, StandIn
from twin.calibrate.calibration import calibrate
from twin.calibrate.leg import Leg, free
from twin.calibrate.problem import Simulations

ITERATIONS = 12
HEADINGS = ("joint, seed", "what", "start", "RMS [deg]", "worst error", "legs simulated", "CPU s")


def score(case, options):
    """Rows of the table: `qpal calibrate`, the toolbox from nominal, from friction 0, and from the actuated joint."""
    joint, seed = case
    rig = StandIn(joint, seed, same=True)
    logs = rig.calibration()
    start = time.process_time()
    calibration = calibrate(logs, joint, without=LACKS)
    seconds = time.process_time() - start
    names = tuple(value.name for value in calibration.values)
    at_joint = {value.name: value.start for value in calibration.values}
    fitted_runs = [run for run in calibration.runs if not run.held_out]
    rms = np.sqrt(np.mean(np.concatenate([run.y - run.after for run in fitted_runs]) ** 2))
    rows = [
        _cells(
            joint, seed, "qpal calibrate", "the joint", rms, _worst(calibration.parameters, rig, names), None, seconds
        )
    ]
    nominal = {name: twin.Parameters()[name] for name in names}
    for label, start in (
        ("nominal", nominal),
        ("nominal, friction 0", nominal | {f"{joint}.coulomb": 0.0}),
        ("the joint", at_joint),
    ):
        rows.append(_toolbox(rig, logs, names, label, start))
    return {"rows": rows}


def _toolbox(rig, logs, names, label, start):
    """The row of `mujoco.sysid` from one start."""
    from mujoco import sysid

    base = twin.Parameters().replace(start)
    leg = Leg(rig.joint, base, names, LACKS)
    task = Simulations(free(names, base), [leg.record(log) for log in logs])
    parameters = sysid.ParameterDict()
    for k, parameter in enumerate(task.free):
        parameters.add(sysid.Parameter(f"{parameter.name} {k}", parameter.start, parameter.lower, parameter.upper))

    def residual(x, _):
        points = np.atleast_2d(np.asarray(x).T)
        inner = np.array([[float(f.inner(v)) for f, v in zip(task.free, p, strict=True)] for p in points])
        rows = np.hstack(task.responses(inner)) - np.concatenate([record.y for record in task.records])
        rows = np.nan_to_num(rows, nan=10.0)
        return [rows.T if np.ndim(x) > 1 else rows[0]], None, None

    start = time.process_time()
    optimum, _ = sysid.optimize(parameters, residual, verbose=False, max_iters=ITERATIONS)
    seconds, x = time.process_time() - start, optimum.as_vector()
    rms = np.sqrt(np.mean(residual(x, None)[0][0] ** 2))
    worst = _worst(base.replace(dict(zip(names, map(float, x), strict=False))), rig, names)
    return _cells(rig.joint, rig.seed, "mujoco.sysid", label, rms, worst, task.simulations, seconds)


def _worst(parameters, rig, names):
    """The name with the largest relative error, and that error."""
    errors = {name: abs(parameters[name] / rig.parameters[name] - 1.0) for name in names}
    name = max(errors, key=lambda key: errors[key])
    return f"{name.rpartition('.')[2]} {100 * errors[name]:.0f} %"


def _cells(joint, seed, program, start, rms, worst, legs, seconds):
    """A row of the table as texts."""
    legs = MISSING if legs is None else str(legs)
    return [f"{joint}, {seed}", program, start, f"{np.degrees(rms):.3f}", worst, legs, f"{seconds:.0f}"]


STUDY = Study(
    cases=lambda options: ((joint, seed) for seed in options.seeds for joint in options.joints),
    score=score,
    summary=lambda rows, options: markdown(HEADINGS, [cells for row in rows for cells in row["rows"]], 3),
    seeds="1000:1003",
    options={"--joints": {"type": words, "default": list(twin.JOINTS)}},
)
