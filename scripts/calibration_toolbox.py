"""`mujoco.sysid` on the task of scripts/calibration.py: the same logs, the same twin, the same free parameters.

It gets what it needs: a residual over a batch of parameters, so that its Jacobian is one batch too. Its parameters are
in their own units, as in its documentation, and it starts where a user would, at nominal values; "polish" starts it at
the place that the actuated joint gives.
"""

import time

import numpy as np
from standin import LACKS, StandIn

import twin
from twin.calibrate.calibration import calibrate
from twin.calibrate.leg import Leg, free
from twin.calibrate.problem import Simulations

ITERATIONS = 12
HEADINGS = "| joint, seed | what | start | RMS [deg] | worst error | legs simulated | CPU s |"


def row(joint, seed, kind="same"):
    """Markdown rows: `qpal calibrate`, the toolbox from nominal, from friction 0, and from the actuated joint."""
    rig = StandIn(joint, seed, kind == "same")
    logs = rig.calibration()
    began = time.process_time()
    ours = calibrate(logs, joint, without=LACKS)
    spent = time.process_time() - began
    names = tuple(value.name for value in ours.values)
    at_joint = {value.name: value.start for value in ours.values}
    used = [run for run in ours.runs if not run.held_out]
    rms = np.sqrt(np.mean(np.concatenate([run.y - run.after for run in used]) ** 2))
    lines = [_line(joint, seed, "qpal calibrate", "the joint", rms, _worst(ours.parameters, rig, names), None, spent)]
    nominal = {name: twin.Parameters()[name] for name in names}
    for words, start in (
        ("nominal", nominal),
        ("nominal, friction 0", nominal | {f"{joint}.coulomb": 0.0}),
        ("the joint", at_joint),
    ):
        lines.append(_toolbox(rig, logs, names, words, start))
    return "\n".join(lines)


def _toolbox(rig, logs, names, words, start):
    from mujoco import sysid

    base = twin.Parameters().replace(start)
    leg = Leg(rig.joint, base, names, LACKS)
    task = Simulations(free(names, base), [leg.record(log) for log in logs])
    known = sysid.ParameterDict()
    for k, one in enumerate(task.free):
        known.add(sysid.Parameter(f"{one.name} {k}", one.start, one.lower, one.upper))

    def residual(x, _):
        points = np.atleast_2d(np.asarray(x).T)
        inner = np.array([[float(f.inner(v)) for f, v in zip(task.free, p, strict=True)] for p in points])
        rows = np.hstack(task.responses(inner)) - np.concatenate([record.y for record in task.records])
        rows = np.nan_to_num(rows, nan=10.0)
        return [rows.T if np.ndim(x) > 1 else rows[0]], None, None

    began = time.process_time()
    found, _ = sysid.optimize(known, residual, verbose=False, max_iters=ITERATIONS)
    spent, x = time.process_time() - began, found.as_vector()
    rms = np.sqrt(np.mean(residual(x, None)[0][0] ** 2))
    worst = _worst(base.replace(dict(zip(names, map(float, x), strict=False))), rig, names)
    return _line(rig.joint, rig.seed, "mujoco.sysid", words, rms, worst, task.simulations, spent)


def _worst(parameters, rig, names):
    """The name with the largest relative error, and that error."""
    errors = {name: abs(parameters[name] / rig.parameters[name] - 1.0) for name in names}
    name = max(errors, key=lambda each: errors[each])
    return f"{name.rpartition('.')[2]} {100 * errors[name]:.0f} %"


def _line(joint, seed, what, start, rms, worst, legs, spent):
    cells = (f"{joint}, {seed}", what, start, f"{np.degrees(rms):.3f}", worst, "–" if legs is None else str(legs))
    return f"| {' | '.join(cells)} | {spent:.0f} |"
