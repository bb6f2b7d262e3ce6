"""Drawn processes, fitted from nothing but their kind: how often are all values right, and how often do intervals hold?

    python scripts/study.py process_recovery --seeds 0:120 [--start cut|step]

Time constants of 2 to 100 samples, damping ratios of 0.1 to 0.9, delays of 0 to 20 samples that are no whole number,
gains of both signs, noise 20 to 60 dB below the output, steps or a pseudo-random binary input. Outputs are sums of step
responses in closed form, which share no code with the block. `rest`: the record begins at rest; `cut`: it is the end of
a longer one, so that the input before it, which a delay lets through, is not known; `step`: one step behind a rest of 5
to 60 samples, and nothing else.
"""

import argparse
from typing import Any

import numpy as np
from study import Study, markdown

import sysid
from sysid.data.record import IOData
from sysid.workflow.named_values import named_values

KINDS = ("P1D", "P2D", "P2DU")
_HALF, _LOSS = 2.0, 1.02  # half intervals that an estimate may miss by, and the loss by that of the truth
_BEFORE = 600  # samples before a record that is cut


def step_response(kind: str, m: dict[str, float], t: np.ndarray) -> np.ndarray:
    """Of a gain of 1 and no delay, at times t [s]; zero before the step."""
    t = np.maximum(t, 0.0)
    if kind == "P1D":
        return 1.0 - np.exp(-t / m["T1"])
    if kind == "P2D":
        a, b = m["T1"], m["T2"]
        return 1.0 - (a * np.exp(-t / a) - b * np.exp(-t / b)) / (a - b)
    decay, w = m["zeta"] * m["wn"], m["wn"] * np.sqrt(1.0 - m["zeta"] ** 2)
    return 1.0 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))


def draw(kind: str, rng: np.random.Generator, start: str) -> tuple[IOData, dict[str, float], float]:
    """A record, the true values, and the mean square of its noise."""
    Ts = float(10 ** rng.uniform(-3.0, 1.0))
    slow = float(np.exp(rng.uniform(np.log(2.0), np.log(100.0))))
    truth = {"K": float(10 ** rng.uniform(-2.0, 2.0) * rng.choice([-1.0, 1.0]))}
    if kind == "P2DU":
        truth |= {"wn": 1.0 / (slow * Ts), "zeta": float(rng.uniform(0.1, 0.9))}
    else:
        truth |= {"T1": slow * Ts}
    if kind == "P2D":
        truth["T2"] = truth["T1"] * float(rng.uniform(0.2, 0.8))
    truth["Td"] = float(rng.uniform(0.0, 20.0)) * Ts
    N = int(np.clip(rng.uniform(10.0, 20.0) * slow, 400, 2000))
    before = _BEFORE if start == "cut" else 0
    if rng.uniform() < 0.5:
        hold = int(rng.integers(2, 1 + int(2.0 * slow)))
        u = np.repeat(rng.choice([-1.0, 1.0], (N + before) // hold + 1), hold)
    else:
        hold = int(np.clip(2.0 * slow, 20, N // 6))
        u = np.repeat(rng.normal(size=(N + before) // hold + 1), hold)
    u = u[: N + before] * 10 ** rng.uniform(-1.0, 1.0)
    if start == "step":
        u = np.where(np.arange(N) < rng.integers(5, 61), 0.0, u[0])
    jumps, t = np.diff(u, prepend=0.0), np.arange(len(u)) * Ts
    y = np.zeros(len(u))
    for k in np.flatnonzero(jumps):
        y += truth["K"] * jumps[k] * step_response(kind, truth, t - t[k] - truth["Td"])
    u, y = u[before:], y[before:] + rng.normal() * np.std(y)
    e = np.std(y) * 10 ** (-rng.uniform(20.0, 60.0) / 20.0) * rng.normal(size=N)
    return IOData(u, y + e, Ts), truth, float(np.mean(e**2))


def cases(options: argparse.Namespace) -> list[tuple[str, str, int]]:
    """The kinds in turn."""
    return [(options.start, KINDS[seed % len(KINDS)], seed) for seed in options.seeds]


def score(case: tuple[str, str, int], options: argparse.Namespace) -> dict[str, Any]:
    """By value: its error in half intervals. And the loss by that of the truth."""
    start, kind, seed = case
    data, truth, noise = draw(kind, np.random.default_rng([seed, 39]), start)
    fit = sysid.fit(sysid.structures.process(kind, offset="free"), data)
    found = dict(zip([s.name for s in fit.model.slots if s.words], named_values(fit, data), strict=True))
    if kind == "P2D" and found["T1"].value < found["T2"].value:
        found["T1"], found["T2"] = found["T2"], found["T1"]
    errors = {}
    for name, value in truth.items():
        known = found[name]
        if known.low is None or known.high is None:
            errors[name] = None
            continue
        half = known.high - known.value if truth[name] > known.value else known.value - known.low
        errors[name] = abs(value - known.value) / max(half, 1e-300)
    return {"errors": errors, "loss": fit.criteria.mse / noise, "seconds": fit.seconds, "samples": data.N}


def _recovered(row: dict[str, Any]) -> bool:
    return row["loss"] <= _LOSS and all(e is not None and e <= _HALF for e in row["errors"].values())


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """By kind: shares that are right, the loss, and how often intervals hold the truth."""
    lines = []
    for kind in KINDS:
        own = [row for row in rows if row["case"][1] == kind]
        errors = [e for row in own for e in row["errors"].values()]
        held = [e <= 1.0 for e in errors if e is not None]
        good = sum(map(_recovered, own))
        least = sum(row["loss"] <= _LOSS for row in own)
        share = f"{100.0 * np.mean(held):.1f} % of {len(held)}" if held else "–"
        seconds = f"{np.median([row['seconds'] for row in own]):.2f}" if own else "–"
        lines.append((kind, str(len(own)), str(good), str(least), share, str(len(errors) - len(held)), seconds))
    head = ("kind", "processes", "all right", "loss at most 1.02", "intervals that hold", "not determined", "seconds")
    return markdown(head, lines)


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:120",
    options={"--start": {"choices": ("rest", "cut", "step"), "default": "rest", "help": "how the record begins"}},
    line=lambda row: f"{row['case']}: loss {row['loss']:.3f}, errors {row['errors']}",
)
