"""`qpal calibrate --model` on a quadruped with hidden values: how many are found, in what time, and what is left.

    python scripts/study.py mjcf_joints --seeds 0:3 --out runs/mjcf_joints.jsonl
    python scripts/study.py mjcf_joints --seeds 0:3 --legs 1 --toolbox   # 3 joints; needs pip install mujoco[sysid]

The robot has 3 joints a leg, each with hidden armature, damping, frictionloss and bias, and one delay: 49 values for
four legs. The model knows none of them. It sees 20 s of a chirp at the test stand; random levels are held out. Logs are
made step by step with MuJoCo alone (tests/robots.py). --toolbox gives `mujoco.sysid` the same batches of simulations,
start and bounds, in the units of its documentation; an infinite bound becomes 20 times the largest hidden value.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from study import MISSING, Study, markdown

from twin.mjcf import logs, robot
from twin.mjcf.calibration import calibrate
from twin.mjcf.simulation import free_run

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
import robots

TS, DURATION, NOISE = 0.004, 20.0, 1e-3  # [s], [s], [rad]
CLOSE = 0.05  # of the hidden value
JOINTS = ("hip", "thigh", "calf")
HEADINGS = (
    "seed",
    "program",
    "values",
    "close or inside",
    "inside 95 %",
    "worst error",
    "worst bias [deg]",
    "held out [deg]",
    "CPU s",
    "s",
)


def quadruped(legs, free):
    """MJCF of a quadruped of 12 kg with `legs` legs, its base free or held."""
    parts, motors = [], []
    for k in range(legs):
        x, y = (0.19, -0.19)[k // 2], (0.06, -0.06)[k % 2]
        parts.append(
            f"""<body pos="{x} {y} 0"><joint name="hip{k}" axis="1 0 0"/>
            <geom size=".04 .02" type="cylinder" mass=".7"/>
            <body pos="0 {1.5 * y} 0"><joint name="thigh{k}" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.21" size=".025" mass="1.1"/>
            <body pos="0 0 -.21"><joint name="calf{k}" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".012" mass=".2"/>
            <geom name="foot{k}" pos="0 0 -.2" size=".02" mass=".04" contype="1"/>
            </body></body></body>"""
        )
        motors += [f'<position name="{joint}{k}_servo" joint="{joint}{k}"/>' for joint in JOINTS]
    return f"""<mujoco><option timestep="0.002" integrator="implicitfast"/>
      <default><joint damping="0" armature="0.01" frictionloss="0.2"/><position kp="25" kv="0.5" forcerange="-24 24"/>
      <geom contype="0" conaffinity="0"/></default>
      <worldbody><geom type="plane" size="5 5 .1" conaffinity="1"/>
      <body name="trunk" pos="0 0 {0.45 if free else 9}">{"<freejoint/>" if free else ""}
      <geom type="box" size=".2 .05 .05" mass="7"/>
      {"".join(parts)}</body></worldbody><actuator>{"".join(motors)}</actuator></mujoco>"""


def hidden(names, rng):
    """The values that the search should find."""
    out = {"delay": rng.uniform(0.002, 0.02)}
    for name in names:
        for kind, low, high in (("armature", 5e-3, 5e-2), ("damping", 0.05, 0.5), ("frictionloss", 0.05, 0.6)):
            out[f"{name}.{kind}"] = np.exp(rng.uniform(np.log(low), np.log(high)))
        out[f"{name}.bias"] = rng.uniform(-0.08, 0.08)
    return {name: float(value) for name, value in out.items()}


def case_logs(legs, seed):
    """The model's file as text, the hidden values, and the chirp and the levels as logs."""
    rng, N = np.random.default_rng(seed), round(DURATION / TS)
    names = [f"{joint}{k}_servo" for k in range(legs) for joint in JOINTS]
    truth, t = hidden(names, rng), np.arange(N) * TS
    posture = np.tile([0.0, 0.6, -1.2], legs)
    sign = rng.choice([-1.0, 1.0], len(names))
    chirps = robots.chirp(t, 0.1, 8.0, 1.0)[:, None] * sign * np.tile([0.2, 0.3, 0.35], legs)
    steps = robots.levels(rng, len(names), N // 2, 100, 0.25)
    records = []
    for label, u in (("chirp", chirps), ("levels", steps)):
        y = robots.record(quadruped(legs, False), truth, names, u + posture, TS, NOISE, rng)
        records.append(logs.RobotLog(label, u + posture, y, TS))
    return quadruped(legs, True), names, truth, records


def score(case, options):
    """Errors of all values, whether the intervals hold them, the held-out error and the time."""
    (seed,) = case
    text, names, truth, (used, held) = case_logs(options.legs, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        path.write_text(text)
        model = robot.read(path, names)
    start, cpu = time.perf_counter(), time.process_time()
    result = calibrate(model, [used], [held], threads=options.threads)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    values = {
        value.name: {"true": truth[value.name], "value": value.value, "low": value.low, "high": value.high}
        for value in result.values
    }
    unseen = [[np.degrees(run.rms(name)) for run in result.runs if run.held_out] for name in ("before", "after")]
    row = {"before": max(unseen[0]), "values": values, "held_out": max(unseen[1]), "seconds": seconds, "cpu": cpu}
    row |= {"converged": result.optimum.stop.converged, "simulations": result.simulations}
    return row | ({"toolbox": toolbox(result.rig, used, held, truth)} if options.toolbox else {})


def toolbox(rig, used, held, truth):
    """The same of `mujoco.sysid`, which gives no intervals."""
    from mujoco import sysid

    parameters = sysid.ParameterDict()
    for each in rig.parameters:
        kind = each.kind.name
        largest = 20.0 * max(abs(value) for name, value in truth.items() if name.endswith(kind))
        low, high = max(each.free.lower, -largest), min(each.free.upper, largest)
        parameters.add(sysid.Parameter(each.free.name, each.free.start, low, high))

    def residual(x, _):
        points = np.atleast_2d(np.asarray(x).T)
        y = rig.run(points, used.u, used.Ts, np.tile(used.start, (len(points), 1, 1)))
        rows = np.nan_to_num((y - used.y).reshape(len(points), -1), nan=10.0)
        return [rows.T if np.ndim(x) > 1 else rows[0]], None, None

    start, cpu = time.perf_counter(), time.process_time()
    optimum, _ = sysid.optimize(parameters, residual, verbose=False)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    x = np.asarray(optimum.as_vector())
    error = held.y - free_run(rig, x, held.u, held.Ts, held.start)
    names = [each.free.name for each in rig.parameters]
    values = {name: {"true": truth[name], "value": v, "low": v, "high": v} for name, v in zip(names, x, strict=True)}
    worst = float(np.degrees(np.sqrt(np.mean(error**2, axis=0))).max())
    return {"values": values, "held_out": worst, "seconds": seconds, "cpu": cpu}


def _error(value):
    return abs(value["value"] / value["true"] - 1.0)


def _inside(value):
    return value["low"] <= value["true"] <= value["high"]


def summary(rows, options):
    """A row a robot and program, then all of them."""
    cells = []
    for label, part in (("qpal", lambda row: row), ("mujoco.sysid", lambda row: row.get("toolbox"))):
        chosen = [(str(row["case"][0]), part(row)) for row in rows if part(row)]
        cells += [_cells(seed, label, row) for seed, row in chosen]
        if len(chosen) > 1:
            every = {f"{seed} {name}": value for seed, row in chosen for name, value in row["values"].items()}
            worst = {key: max(row[key] for _, row in chosen) for key in ("held_out", "cpu", "seconds")}
            cells.append(_cells("all, worst", label, worst | {"values": every}))
    return markdown(HEADINGS, cells, 2)


def _cells(seed, label, row):
    values, bias = row["values"].values(), [v for name, v in row["values"].items() if name.endswith("bias")]
    good = sum(_error(value) <= CLOSE or _inside(value) for value in values)
    others = [_error(value) for name, value in row["values"].items() if not name.endswith("bias")]
    return [
        seed,
        label,
        len(values),
        f"{good} ({100 * good / len(values):.1f} %)",
        f"{100 * np.mean([_inside(value) for value in values]):.0f} %" if label == "qpal" else MISSING,
        f"{100 * max(others):.1f} %",
        f"{max(np.degrees(abs(v['value'] - v['true'])) for v in bias):.3f}",
        f"{row['held_out']:.3f}",
        f"{row['cpu']:.0f}",
        f"{row['seconds']:.0f}",
    ]


STUDY = Study(
    cases=lambda options: ((seed,) for seed in options.seeds),
    score=score,
    summary=summary,
    seeds="0:3",
    options={
        "--legs": {"type": int, "default": 4},
        "--toolbox": {"action": "store_true"},
        "--threads": {"type": int, "default": 2, "help": "of one calibration"},
    },
)
