"""Whether records that no motor made are refused, and records of the twin's legs are called joints.

    python scripts/study.py not_a_joint [--records 60] [--seeds 0:30] [--kinds linear,tanks,...] [--data FOLDER]

Records: linear filters, state spaces, Hammerstein-Wiener models, tanks, networks, oscillators, bilinear systems and
noise, drawn from the seed, and pieces of public records (`--data`, or $QPAL_RECORDS, or ../shared/data). Legs: the
stand-ins of `twin.bench` on a sweep that reaches both ends and on random levels, one for each of `--seeds`; the seeds
of the records begin with the first of these.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter
from study import Study, words

from sysid.data.record import IOData
from sysid.excitations import Aprbs, Multisine, Prbs, Sweep
from sysid.joint.posterior import fit_joint
from sysid.joint.verdict import verdict

N, TS = 1250, 0.1
Rng = np.random.Generator


def drive(rng: Rng) -> np.ndarray:
    """An input (N,): random levels, steps, a sweep, a multisine, binary or white, of 0.5 to 20 units."""
    size = float(np.exp(rng.uniform(np.log(0.5), np.log(20.0))))
    kind = int(rng.integers(6))
    if kind == 5:
        return size * rng.uniform(-1.0, 1.0, N)
    signals = (
        Aprbs(size),
        Aprbs(size, hold=4.0) if "hold" in Aprbs.__dataclass_fields__ else Aprbs(size),
        Prbs(size),
        Multisine(size),
        Sweep(size, 7.0, jitter=0.4, shrink=0.4),
    )
    return signals[kind].generate(N, TS, rng)


def poles(rng: Rng, order: int) -> np.ndarray:
    """Denominator of a stable filter, with time constants of 1 to 60 samples."""
    a = np.ones(1)
    while len(a) <= order:
        r = np.exp(-1.0 / np.exp(rng.uniform(0.0, np.log(60.0))))
        if order - len(a) >= 1 and rng.random() < 0.4:
            a = np.convolve(a, [1.0, -2.0 * r * np.cos(rng.uniform(0.02, 0.6)), r * r])
        else:
            a = np.convolve(a, [1.0, -r])
    return a


def filter_signal(rng: Rng, u: np.ndarray, order: int) -> np.ndarray:
    """u through a random stable filter, scaled to a deviation of 1."""
    y = lfilter(np.r_[np.zeros(rng.integers(1, 4)), rng.normal(size=rng.integers(1, 3))], poles(rng, order), u)
    return y / max(float(np.std(y)), 1e-12)


def linear(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A filter of order 1 to 4."""
    u = drive(rng)
    return u, filter_signal(rng, u, int(rng.integers(1, 5)))


def state_space(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A random stable state space of order 3 to 6 with a direct part."""
    u, n = drive(rng), int(rng.integers(3, 7))
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.8, 0.98) / max(abs(np.linalg.eigvals(A)))
    b, c, d, x, y = rng.normal(size=n), rng.normal(size=n), 0.3 * rng.normal(), np.zeros(n), np.empty(N)
    for k in range(N):
        y[k] = c @ x + d * u[k]
        x = A @ x + b * u[k]
    return u, y


def bend(rng: Rng, x: np.ndarray) -> np.ndarray:
    """A random static curve over x: saturation, dead zone, cubic, or exponential."""
    x = x / np.std(x)
    kind, share = int(rng.integers(4)), rng.uniform(0.5, 1.5)
    if kind == 0:
        return np.clip(x, -share, share)
    if kind == 1:
        return np.sign(x) * np.maximum(np.abs(x) - 0.6 * share, 0.0)
    if kind == 2:
        return x + 0.2 * share * x**2 + 0.1 * x**3
    return np.tanh(x - 0.5) + 0.1 * x


def hammerstein_wiener(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A curve, a filter, and, half of the time, a second curve."""
    u = drive(rng)
    y = filter_signal(rng, bend(rng, u), int(rng.integers(1, 4)))
    return u, bend(rng, y) if rng.random() < 0.5 else y


def tanks(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """One or two tanks with outflow by Torricelli's law; the last one may overflow."""
    u = drive(rng)
    u = u - u.min()
    flows, heights = rng.uniform(0.02, 0.2, 2), np.array([1.0, 1.0]) * np.mean(u)
    two, top, y = rng.random() < 0.6, np.inf if rng.random() < 0.5 else 1.5, np.empty(N)
    for k in range(N):
        y[k] = heights[1] if two else heights[0]
        out = flows * np.sqrt(np.maximum(heights, 0.0) * max(np.mean(u), 1e-9))
        heights = heights + np.array([flows[0] * u[k] - out[0], out[0] - out[1]])
        heights = np.clip(heights, 0.0, top * np.mean(u))
    return u, y


def network(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A recurrent network of 3 to 6 units."""
    u, n = drive(rng), int(rng.integers(3, 7))
    v = u / np.std(u)
    W, b, c, x, y = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n), np.zeros(n), np.empty(N)
    W *= rng.uniform(0.5, 1.1) / max(abs(np.linalg.eigvals(W)))
    leak = rng.uniform(0.02, 0.6, n)
    for k in range(N):
        y[k] = c @ x
        x = (1.0 - leak) * x + leak * np.tanh(W @ x + b * v[k] + 0.2)
    return u, y


def oscillator(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A mass on a hardening spring."""
    u = drive(rng)
    v, w, zeta, hard = u / np.std(u), rng.uniform(0.1, 0.8), rng.uniform(0.03, 0.8), rng.uniform(0.1, 2.0)
    x, s, y = 0.0, 0.0, np.empty(N)
    for k in range(N):
        y[k] = x
        for _ in range(8):
            s += (w * w * (v[k] - x - hard * x**3) - 2 * zeta * w * s) / 8
            x += s / 8
    return u, y


def bilinear(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A heat exchanger: the input is a flow that multiplies the state."""
    u = drive(rng)
    flow = (u - u.min()) / np.ptp(u) + 0.1
    a, x, y = rng.uniform(0.01, 0.2), 0.5, np.empty(N)
    b = a * rng.uniform(0.3, 2.0)
    for k in range(N):
        y[k] = x
        x += a * (1.0 - x) - b * flow[k] * x
    return u, y


def noise(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """An output that has nothing to do with the input: white, coloured, or wandering."""
    u, e = drive(rng), rng.normal(size=N)
    kind = int(rng.integers(3))
    return u, e if kind == 0 else filter_signal(rng, e, 2) if kind == 1 else np.cumsum(e)


KINDS: dict[str, Callable[[Rng], tuple[np.ndarray, np.ndarray]]] = {
    "linear": linear,
    "state_space": state_space,
    "hammerstein_wiener": hammerstein_wiener,
    "tanks": tanks,
    "network": network,
    "oscillator": oscillator,
    "bilinear": bilinear,
    "noise": noise,
}


def draw_record(kind: str, seed: int) -> IOData:
    """The record `seed` of a kind, with noise of 0.2 to 5 % and another unit and offset."""
    rng = np.random.default_rng([seed, 41, list(KINDS).index(kind)])
    u, y = KINDS[kind](rng)
    y = y + np.exp(rng.uniform(*np.log([0.002, 0.05]))) * np.std(y) * rng.normal(size=N)
    scale = float(np.exp(rng.uniform(*np.log([0.01, 100.0]))))
    return IOData(u, scale * (y + rng.choice([0.0, 0.0, 3.0])), TS)


def public(folder: Path) -> dict[str, IOData]:
    """Records of a tank, a heater, an oscillating circuit and a flexible arm."""
    tank = np.genfromtxt(folder / "cascaded_tanks" / "dataBenchmark.csv", delimiter=",", skip_header=1)
    dryer = np.loadtxt(folder / "daisy" / "hair_dryer.dat")
    arm = np.loadtxt(folder / "daisy" / "robot_arm.dat")
    box = 1e3 * np.genfromtxt(folder / "silverbox" / "SNLS80mV.csv", delimiter=",", skip_header=1)[:, :2]
    records = {
        "cascaded_tanks": IOData(tank[:, 0], tank[:, 2], 4.0),
        "cascaded_tanks_validation": IOData(tank[:, 1], tank[:, 3], 4.0),
        "hair_dryer": IOData(dryer[:, 0], dryer[:, 1], 0.08),
        "robot_arm": IOData(arm[:, 0], arm[:, 1], 0.1),
    }
    for k, start in enumerate((45_000, 60_000, 90_000, 20_000)):
        piece = box[start : start + N]
        records[f"silverbox_{k}"] = IOData(piece[:, 0], piece[:, 1], 1 / 610.35)
    return records


def leg(seed: int) -> tuple[str, IOData]:
    """A record of a drawn leg's joint, of sweep or random levels in turn."""
    import twin
    from twin.bench.standin import StandIn, draw_parameters

    joint, kind = twin.JOINTS[seed % 3], ("sweep", "aprbs")[seed // 3 % 2]
    if kind == "aprbs":
        return f"{joint} aprbs {seed}", StandIn(joint, seed).log("aprbs", 60.0, 2).io()
    half = {"shoulder": 2.5}.get(joint, 10.0)
    options = {"jitter": 0.5, "shrink": 0.6, "half_period": half}
    log = twin.Experiment(
        joint, "sweep", 125.0, seed=seed, parameters=draw_parameters(joint, seed), options=options
    ).run()
    return f"{joint} sweep {seed}", log.io()


def cases(options: argparse.Namespace) -> list[tuple[str, Any]]:
    """Kind and seed of the records, names of the public ones, and seeds of the legs."""
    first, kinds = options.seeds[0], options.kinds
    records = [(kinds[k % len(kinds)], first + k // len(kinds)) for k in range(options.records)]
    names = list(public(Path(options.data))) if options.records and Path(options.data).is_dir() else []
    return [*records, *(("public", name) for name in names), *(("leg", seed) for seed in options.seeds)]


def score(case: tuple[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Whether the verdict on a record is right, and its figures in a line."""
    kind, key = case
    if kind == "leg":
        name, data = leg(key)
    else:
        name, data = f"{kind} {key}", public(Path(options.data))[key] if kind == "public" else draw_record(kind, key)
    v = verdict(fit_joint(data), data)
    general = f", {v.general} {v.general_seen:.1f} / {v.general_unseen:.1f}" if v.general else ""
    shares = f"friction {v.friction:.3f}, spring {v.spring:.2f}"
    figures = f"joint {v.seen:.1f} / {max(v.unseen, -999.0):.1f}, {shares}{general}; {v.reason}"
    return {"name": name, "right": v.joint == (kind == "leg"), "figures": figures}


def line(row: dict[str, Any]) -> str:
    """The verdict on one record."""
    return f"{row['name']:28s} {'ok' if row['right'] else 'WRONG':6s} {row['figures']}"


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """Every verdict, then the wrong ones counted."""
    lines = [line(row) for row in rows]
    for legs, text in ((False, "records that no motor made got physical values"), (True, "legs were refused")):
        group = [row["right"] for row in rows if (row["case"][0] == "leg") == legs]
        lines.append(f"{len(group) - sum(group)} of {len(group)} {text}")
    return "\n".join(lines)


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:30",
    options={
        "--records": {"type": int, "default": 60, "help": "records that no motor made"},
        "--kinds": {"type": words, "default": list(KINDS)},
        "--data": {"default": os.environ.get("QPAL_RECORDS", "../shared/data"), "help": "folder of public records"},
    },
    line=line,
)
