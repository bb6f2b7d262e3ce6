"""`qpal compare --model` on robots with one kind of parameter off: which kind is named, on how many.

    python scripts/study.py mjcf_causes --seeds 0:1 --out runs/mjcf_causes.jsonl

Models of one and two actuators (servos and motors), logs of 6 s at 10 ms with noise of 1 mrad, made by MuJoCo alone
(tests/robots.py). Off is one kind at one drawn drive, nothing, or something that no model here has: a spring, a cubic
spring, cogging, friction at one place, a weight at the end. Draws whose departure without noise is below 0.1 degrees
RMS at every joint are drawn again. "right": the kind alone is named; "one of several": named with others, or among
those that act alike.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from study import MISSING, Study, markdown

from twin.mjcf import comparison, logs, robot

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
import robots

TS, DURATION, NOISE = 0.01, 6.0, 1e-3  # [s], [s], [rad]
LEAST = np.deg2rad(0.1)
FORCE = np.array([4.0, 1.5])  # [N m] of the legs that are moved by motors
LEG = robots.PENDULUM.replace('axis="0 1 0"/>', 'axis="0 1 0" armature="0.01" damping="0.2" frictionloss="0.15"/>')
CART = robots.CART.replace('damping="0.3"', 'damping="0.6" armature="0.02" frictionloss="0.1"')
MODELS = {
    "servo": (robots.SERVO, ("servo",)),
    "motor": (robots.MOTOR, ("motor",)),
    "leg": (LEG, (robots.HIP, robots.KNEE)),
    "cart": (CART, ("cart", "pole")),
}
SERVOS = ("servo", "leg")
ALL = ("armature", "damping", "frictionloss", "delay", "bias", "backlash")
KINDS = {name: (*ALL, *(("kp", "kv") if name in SERVOS else ("gain",))) for name in MODELS}
FOREIGN = ("spring", "cubic", "cogging", "place", "weight")
NOTHING = "nothing"
VERDICTS = ("right", "one of several", "lacking", NOTHING, "wrong")


def commands(model, rng):
    """Levels and a chirp together (N, n)."""
    N, n = round(DURATION / TS), len(MODELS[model][1])
    t = np.arange(N) * TS
    parts = [robots.levels(rng, 1, N, 40, 0.5)[:, 0] + robots.chirp(t, 0.2, 2.5, 0.25) for _ in range(n)]
    return np.column_stack(parts) * (1.0 if model in SERVOS else FORCE[:n] / 0.5 if n > 1 else 1.5)


def draw(model, off, rng):
    """What `robots.record` is given beside the model: hidden values, changes of the spec, forces, and a play (n,)."""
    text, names = MODELS[model]
    n, truth = len(names), {"delay": 0.0}
    k, factor = int(rng.integers(n)), float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.2)))
    name, play, keep, force = names[k], np.zeros(n), lambda spec: spec, None
    spec = robots.mujoco.MjSpec.from_string(text)
    joint = spec.joint(spec.actuator(name).target)
    if off in ("armature", "frictionloss"):
        truth[f"{name}.{off}"] = factor * float(getattr(joint, off))
    elif off == "damping":
        truth[f"{name}.damping"] = factor * float(joint.damping[0])
    elif off == "delay":
        truth["delay"] = float(rng.uniform(0.004, 0.03))
    elif off == "bias":
        truth[f"{name}.bias"] = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.15))
    elif off == "backlash":
        play[k] = rng.uniform(0.01, 0.05)
    elif off in ("kp", "kv", "gain"):
        factor = factor ** (1.0 if off == "kv" else 0.4)

        def keep(spec):
            part = spec.actuator(name)
            if off in ("kp", "gain"):
                part.gainprm[0] *= factor
            part.biasprm[{"kp": 1, "kv": 2, "gain": 0}[off]] *= factor
            return spec

    elif off in FOREIGN:
        if (model, off) == ("cart", "weight"):
            k, name = 1, names[1]  # a weight on a cart is the cart's armature
        keep, force = foreign(off, name, k, n, float(rng.uniform(0.5, 2.0)), model)
    return truth, keep, force, play


def foreign(off, name, k, n, size, model):
    """Something that no parameter of the model is: a change of the spec, and a force of positions and speeds."""
    strength = size * (1.0 if model == "cart" and k == 0 else 0.3)  # [N or N m]
    only = np.eye(n)[k]
    if off == "weight":

        def keep(spec):
            body = spec.joint(spec.actuator(name).target).parent
            body.add_geom(type=robots.mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02] * 3, pos=[0, 0, -0.25], mass=0.3 * size)
            return spec

        return keep, None
    torques = {
        "spring": lambda q, v: -6.0 * strength * q,
        "cubic": lambda q, v: -12.0 * strength * q**3,
        "cogging": lambda q, v: strength * np.sin(18.0 * q),
        "place": lambda q, v: -2.0 * strength * np.tanh(v / 0.05) * np.exp(-(((q - 0.2) / 0.1) ** 2)),
    }
    return lambda spec: spec, lambda q, v: only * torques[off](q, v)


def log_of(model, off, seed):
    """The log of a robot and its departure without noise (n,)."""
    text, names = MODELS[model]
    rng = np.random.default_rng(
        [seed, list(MODELS).index(model), (*ALL, "kp", "kv", "gain", *FOREIGN, NOTHING).index(off)]
    )
    u = commands(model, rng)
    nominal = robots.record(text, {"delay": 0.0}, names, u, TS, 0.0, rng)
    while True:
        truth, keep, force, play = draw(model, off, rng)
        y = robots.record(text, truth, names, u, TS, 0.0, rng, keep, force)
        for i in range(1, len(y) if play.any() else 0):
            y[i] = np.clip(y[i - 1], y[i] - play / 2, y[i] + play / 2)
        departure = np.sqrt(np.mean((y - nominal) ** 2, axis=0))
        if off == NOTHING or departure.max() > LEAST:
            return logs.RobotLog("log", u, y + NOISE * rng.standard_normal(y.shape), TS), departure


def cases(options):
    """Models, what is off, and seeds."""
    every = [(model, off) for model in options.models.split(",") for off in (*KINDS[model], *FOREIGN)]
    own = [(model, off, seed) for seed in options.seeds for model, off in every]
    return [*own, *((model, NOTHING, k) for k in range(options.nothing) for model in options.models.split(","))]


def score(case, options):
    """What was named, and the departure [deg]."""
    model, off, seed = case
    log, departure = log_of(model, off, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        path.write_text(MODELS[model][0])
        rig = robot.read(path, MODELS[model][1])
    cpu = time.process_time()
    result = comparison.compare(rig, log, threads=options.threads)
    alike = result.chain[0].alike if result.chain else ()
    return {
        "off": off,
        "verdict": verdict(off, result),
        "named": result.named,
        "alike": alike,
        "departure": float(np.degrees(departure.max())),
        "cpu": time.process_time() - cpu,
    }


def verdict(off, result):
    """One of `VERDICTS`."""
    if not result.named:
        return NOTHING if result.nothing else "lacking"
    if result.named == (off,):
        return "right"
    return "one of several" if off in result.named or off in result.chain[0].alike else "wrong"


def line(row):
    """A case as it ends."""
    named, alike = (",".join(row[name]) or MISSING for name in ("named", "alike"))
    return f"{row['case']} {row['verdict']} ({named}; like {alike}) {row['departure']:.2f} deg, {row['cpu']:.0f} s"


def summary(rows, options):
    """A row for each that was off."""
    cells = []
    for off in dict.fromkeys(row["off"] for row in rows):
        own = [row for row in rows if row["off"] == off]
        counts = [sum(row["verdict"] == name for row in own) or MISSING for name in VERDICTS]
        sizes = [row["departure"] for row in own]
        cells.append((off, len(own), *counts, f"{min(sizes):.2f} to {max(sizes):.2f}"))
    return markdown(("off", "n", *VERDICTS, "departure [deg]"), cells, 1)


STUDY = Study(
    cases=cases,
    score=score,
    summary=summary,
    seeds="0:1",
    line=line,
    options={
        "--models": {"default": ",".join(MODELS)},
        "--nothing": {"type": int, "default": 3, "help": "logs of each model with nothing off"},
        "--threads": {"type": int, "default": 1, "help": "of one comparison"},
    },
)
