"""End stops and backlash that a fit shows of records that have none.

    python scripts/study.py no_phantoms [--seeds 0:40]

Motors without stops are drawn and recorded, half of them by the library's own chain and half by a plain loop that is
written here: Euler steps of a motor with friction, lag and delay. Joints with both ends, friction and no backlash are
recorded by the library's chain. Every record has N = 1000 samples and noise of 0.05 to 0.5 % of its range.
"""

import argparse
from typing import Any

import numpy as np
from study import Study, words

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.excitations import Sweep
from sysid.joint.posterior import JointFit, fit_joint
from sysid.structures import actuated_joint

TS, N, FINE = 0.1, 1000, 200  # [s], samples, Euler steps a sample


def draw_motor(rng: np.random.Generator) -> dict[str, float]:
    """A motor: gain [1/s/V] of a range of about 1, lag and delay [s], friction up and down [V], a load [V]."""
    rise = rng.uniform(0.5, 3.0)
    return {
        "gain": rng.uniform(0.01, 0.05),
        "lag": rng.uniform(0.02, 0.15),
        "delay": rng.uniform(0.0, 0.1),
        "rise": rise,
        "fall": rise * rng.uniform(0.6, 1.6),
        "stick": rise * rng.uniform(0.0, 0.3),
        "load1": rng.uniform(0.0, 0.5),
    }


def inputs(rng: np.random.Generator, half: float) -> np.ndarray:
    """Random times and levels."""
    return Sweep(12.0, half, jitter=0.5, shrink=0.5).generate(N, TS, rng)


def by_chain(p: dict[str, float], u: np.ndarray, stops: bool) -> np.ndarray:
    """Position (N,) of the library's motor, with stops at 0 and 1 or none."""
    chain = actuated_joint(motor=Motor(load=2, stops=stops, stribeck=True, substeps=4), knots=None, play=False)
    values = {
        **{"gain": p["gain"] * TS, "lag": p["lag"] / TS, "delay": p["delay"] / TS, "x0": 0.5, "upper": 1.0},
        **{name: p[name] for name in ("rise", "fall", "stick", "load1")},
        "stick_speed": 0.05 * p["gain"] * TS,
    }
    return chain.simulate(np.array([values.get(name.split(".")[-1], 0.0) for name in chain.names]), u)


def by_loop(p: dict[str, float], u: np.ndarray) -> np.ndarray:
    """The same without stops, by Euler steps; friction at rest holds what is below it."""
    h, x, v, y = TS / FINE, 0.5, 0.0, np.empty(N)
    delay, stick = round(p["delay"] / h), p["stick"]
    for k in range(N):
        y[k] = x
        for i in range(FINE):
            j = k * FINE + i - delay
            w = u[max(j, 0) // FINE] - p["load1"] * x
            if v == 0.0 and -(p["fall"] + stick) <= w <= p["rise"] + stick:
                continue
            way = np.sign(v) if v != 0.0 else np.sign(w)
            drag = (p["rise"] if way > 0 else -p["fall"]) + way * stick * np.exp(-((v / (0.05 * p["gain"])) ** 2))
            new = v + h / p["lag"] * (p["gain"] * (w - drag) - v)
            v = 0.0 if v != 0.0 and new * v < 0.0 else new
            x += h * v
    return y


def record(kind: str, seed: int) -> IOData:
    """A record of one kind: "chain" and "loop" without stops, "ends" with both."""
    rng = np.random.default_rng([seed, 14, 7])
    p = draw_motor(rng)
    crossing = 1.0 / (p["gain"] * (12.0 - max(p["rise"], p["fall"])))
    u = inputs(rng, (1.2 if kind == "ends" else 0.7) * crossing)
    y = by_loop(p, u) if kind == "loop" else by_chain(p, u, kind == "ends")
    noise = np.exp(rng.uniform(*np.log([0.0005, 0.005])))
    return IOData(u, y + noise * np.ptp(y) * rng.normal(size=N), TS, y_unit="rad")


def phantoms(kind: str, joint: JointFit) -> str:
    """What the joint shows that the record has not, "" if nothing."""
    if kind != "ends":
        return "" if joint.ends in ("none", "straight") else f"stops: {joint.ends}"
    return ", ".join(name for name in joint.shown if name == "play.width")


def cases(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Kind and seed: of the two kinds without stops half as many as of the one with ends."""
    share = {kind: options.seeds if kind == "ends" else options.seeds[: len(options.seeds) // 2] for kind in KINDS}
    return [(kind, seed) for kind in options.kinds for seed in share[kind]]


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, Any]:
    """What a joint shows that its record has not, and how its search went."""
    data = record(*case)
    joint = fit_joint(data)
    fit = joint.fit.fit_percent(data)
    facts = {"parts": list(joint.shown), "fit": fit, "warnings": list(joint.warnings)}
    return {"phantoms": phantoms(case[0], joint), **facts}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """How many records of each kind got what is not there, and which."""
    lines = []
    for kind in options.kinds:
        group = [row for row in rows if row["case"][0] == kind]
        wrong = [row for row in group if row["phantoms"]]
        for row in wrong:
            facts = f"{row['parts']}, {row['fit']:.2f} %, {row['warnings']}"
            lines.append(f"  {kind} {row['case'][1]}: {row['phantoms']}; {facts}")
        lines.append(f"{kind}: {len(wrong)} of {len(group)} with what is not there")
    return "\n".join(lines)


KINDS = ("chain", "loop", "ends")
STUDY = Study(cases, score, summary, seeds="0:40", options={"--kinds": {"type": words, "default": list(KINDS)}})
