"""Plants of a model class, identified by the command with its defaults: how near does the loss come to the noise?

    python scripts/study.py exact_classes [--seeds 0:100]

The plants are drawn and simulated here, by formulas: filters of one or two poles beside a saturation or a dead zone,
positions of motors, records that begin far from rest, and outputs with an offset of up to 1000 times their deviation.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import cont2discrete, lfilter, lfiltic
from study import Study, markdown

KINDS = ("input saturation", "output saturation", "input dead zone", "output dead zone", "position", "far", "offset")
STRUCTURES = {"input": "hammerstein", "output": "wiener"}  # the others are output errors
_LIMIT = 1.1  # times the variance of the noise


def filter_of(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """b (2,) and a of a stable filter of one or two poles and gain 1, with a delay of one sample."""
    radius, angle = rng.uniform(0.5, 0.95, 2), rng.uniform(0.1, 1.0)
    ways: tuple[Callable[[], np.ndarray], ...] = (
        lambda: np.array([1.0, -radius[0]]),
        lambda: np.poly(radius),
        lambda: np.poly(radius[0] * np.exp([1j * angle, -1j * angle])).real,
    )
    a = ways[rng.integers(3)]()
    b = np.array([0.0, 1.0, rng.uniform(-0.4, 0.6)])
    return b * a.sum() / b.sum(), a


def draw(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float, tuple[int, int]]:
    """u and the output without noise (N,), Ts, and nb, nf."""
    N, hold = int(rng.integers(400, 2001)), int(rng.integers(1, 9))
    u = np.repeat(rng.normal(size=N // hold + 1), hold)[:N]
    b, a = filter_of(rng)
    orders = 2, len(a) - 1
    side, _, shape = kind.partition(" ")
    if side in STRUCTURES:
        x = u if side == "input" else lfilter(b, a, u)
        low, high = -np.quantile(x, rng.uniform(0.05, 0.35)), np.quantile(x, rng.uniform(0.65, 0.95))
        limited = np.clip(x, -low, high)
        v = limited if shape == "saturation" else x - limited
        return u, lfilter(b, a, v) if side == "input" else v, 1.0, orders
    if kind == "position":
        gain, lag, Ts = rng.uniform(1.0, 20.0), rng.uniform(0.02, 0.5), 0.05
        zeros, poles, _ = cont2discrete(([gain], [lag, 1.0, 0.0]), Ts)
        return u, lfilter(zeros[0], poles, u), Ts, (2, 2)
    if kind == "far":
        past = rng.uniform(20.0, 100.0) * rng.choice([-1.0, 1.0]) * np.ones(len(a) - 1)
        return u, lfilter(b, a, u, zi=lfiltic(b, a, past))[0], 1.0, orders
    y = lfilter(b, a, u)
    return u, y + 10 ** rng.uniform(0.0, 3.0) * np.std(y) * rng.choice([-1.0, 1.0]), 1.0, orders


def cases(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Kinds in turn."""
    return [(KINDS[seed % len(KINDS)], seed) for seed in options.seeds]


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, Any]:
    """The mean square of the residuals over the variance of the noise."""
    kind, seed = case
    rng = np.random.default_rng([seed, 33])
    u, clean, Ts, (nb, nf) = draw(kind, rng)
    spread = np.std(clean[len(clean) // 4 :]) if kind == "far" else np.std(clean)
    noise = 10 ** rng.uniform(-2.3, -1.0) * spread * rng.normal(size=len(u))
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        np.savetxt(log, np.column_stack([u, clean + noise]), delimiter=",", header="u,y", comments="", fmt="%.12g")
        structure = STRUCTURES.get(kind.split()[0], "output_error")
        command = [sys.executable, "-m", "twin.cli", "identify", str(log), "--ts", str(Ts), "--structure", structure]
        command += ["--orders", f"{nb},{nf},1", "--out", f"{folder}/out", "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            return {"ratio": float("inf"), "said": done.stderr[-300:]}
        said = json.loads(done.stdout)
    kept = said["criteria"]["N"]
    return {"ratio": said["criteria"]["mse"] / float(np.mean(noise[:kept] ** 2)), "said": said.get("verdict", "")}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """By kind: how many are near the noise, and the worst."""
    table, lines = [], []
    for kind in KINDS:
        ratios = [row["ratio"] for row in rows if row["case"][0] == kind]
        near = sum(r <= _LIMIT for r in ratios)
        table.append([kind, len(ratios), near, f"{np.median(ratios):.3f}", f"{max(ratios):.3g}"])
    lines = [f"{row['case']}: {row['ratio']:.3g} {row['said']}" for row in rows if row["ratio"] > _LIMIT]
    headings = ["kind", "plants", f"loss at most {_LIMIT} times the noise", "median", "worst"]
    return "\n".join([markdown(headings, table), *lines])


STUDY = Study(cases, score, summary, seeds="0:100")
