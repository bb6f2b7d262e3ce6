"""Makes and certifies the dynamic reference records: python scripts/certificates/certify.py [NAME ...]

Each record is drawn, its optimum found in doubles from many starts, brought to 50 digits by Newton's method, proved to
be the only stationary point of a box (Krawczyk), and, where the plan has a domain, proved to be the global optimum.
Nothing here calls the library; mpmath is in the extra `dev`. Writes sysid/bench/certificate/records.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from definitions import PLANS, Plan
from jets import slopes_of_reals
from mpmath import mp
from proofs import Problem, deviations, growth, krawczyk, lowest, polished
from scipy.optimize import least_squares
from systems import outputs

OUT = Path(__file__).resolve().parents[2] / "sysid" / "bench" / "certificate" / "records"
DRAWS = 40  # of the noise, until the lowest loss found has no sample at a kink: there it has no gradient
STARTS = 30  # of the search in doubles
SHOWN = 20  # digits that are printed of a certified value
# Difficulty: the condition number of the Jacobian with unit columns at the optimum says how many digits an estimate
# loses to parameters that can stand for each other, one or two; and searches that begin within 0.4 and 1.3 times the
# truth may end elsewhere: one in ten is a nuisance, more than half make the start decide.
LEVELS = ((10.0, 0.9, "lower"), (100.0, 0.5, "average"), (np.inf, 0.0, "higher"))


def run(plan: Plan, values: Any, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Output (N,) and its derivatives (N, n) in doubles."""
    problem = Problem(plan.blocks, plan.fixed, list(plan.free), (), ())
    rows = outputs(plan.blocks, problem.theta([float(v) for v in values], float, False), u.tolist(), slopes_of_reals)
    return np.array([r.value for r in rows]), np.array([[g or 0.0 for g in r.gradient] for r in rows], dtype=float)


def drawn(plan: Plan, draw: int) -> tuple[np.ndarray, np.ndarray]:
    """u, y (N,): steps on a grid of tenths, and noise; both of few decimals."""
    rng = np.random.default_rng([crc32(plan.name.encode()), draw])
    u = np.repeat(rng.integers(-20, 21, ceil(plan.N / plan.hold)) / 10.0, plan.hold)[: plan.N]
    blocks, values = plan.source or (plan.blocks, plan.free)
    clean, e = run(replace(plan, blocks=blocks, free=values), values.values(), u)[0], rng.standard_normal(plan.N + 50)
    for t in range(1, len(e)):
        e[t] += plan.colour * e[t - 1]
    e = e[50:] * np.sqrt(1.0 - plan.colour**2)
    return u, np.round(clean + plan.noise * clean.std() * e, 4)


def best(plan: Plan, truth: list[float], u: np.ndarray, y: np.ndarray, starts: int = STARTS) -> tuple[np.ndarray, int]:
    """The lowest point of searches from the truth and around it, and how many of them came to its loss."""
    truth, rng, found = np.array(truth), np.random.default_rng(0), []
    for k in range(starts):
        start = truth if k == 0 else truth * rng.uniform(0.4, 1.3, len(truth))
        try:
            with np.errstate(all="ignore"):
                at = least_squares(
                    lambda p: run(plan, p, u)[0] - y, start, lambda p: run(plan, p, u)[1], xtol=1e-14, ftol=1e-14,
                    gtol=1e-14, x_scale=np.abs(truth), max_nfev=200,
                )  # fmt: skip
        except (ValueError, OverflowError):
            continue
        found.append((float(at.cost), at.x))
    cost, theta = min(found, key=lambda pair: pair[0])
    return theta, sum(c <= cost * (1.0 + 1e-6) for c, _ in found)


def start_of(names: list[str], theta: list[float], share: float) -> dict[str, float]:
    """A start: every pole nearer to zero by `share`, everything else times `share`; three digits."""
    values = {}
    for name, value in zip(names, theta, strict=True):
        letter, order = name.split(".")[1][0], name.split(".")[1][1:]
        factor = share ** int(order) if letter == "f" and order.isdigit() else share
        values[name] = float(f"{value * factor:.3g}")
    return values


@dataclass(frozen=True)
class Minimum:
    """A proved minimum of a record's loss: point, loss, relative radius of the box, digits of the numbers used."""

    point: list[Any]
    rss: Any
    radius: Any
    dps: int

    @classmethod
    def near(cls, problem: Problem, theta: Sequence[float]) -> Minimum:
        """That of a point in doubles. Raises ArithmeticError where there is none, or a kink."""
        point, at = polished(problem, theta, 50)
        if max(abs(float(p) - t) / abs(t) for p, t in zip(point, theta, strict=True)) > 1e-5:
            raise ArithmeticError("Newton's method went elsewhere")
        dps = 50 + ceil(growth(problem, theta))
        if dps > 50:
            point, at = polished(problem, point, dps)
        return cls(point, at.value, krawczyk(problem, point, dps), dps)

    def facts(self, names: Sequence[str]) -> dict[str, Any]:
        """The proof in a record."""
        centre = dict(zip(names, (mp.nstr(p, 40) for p in self.point), strict=True))
        return {"method": "Krawczyk", "centre": centre, "relative_radius": mp.nstr(self.radius, 3), "digits": self.dps}


def smooth(plan: Plan) -> tuple[np.ndarray, np.ndarray, Problem, Minimum, dict[str, Any]]:
    """The first draw whose lowest loss found has a derivative: u, y, problem, minimum, and what was counted."""
    for draw in range(DRAWS):
        u, y = drawn(plan, draw)
        theta, agreed = best(plan, list(plan.free.values()), u, y)
        problem = Problem(plan.blocks, plan.fixed, list(plan.free), *([repr(v) for v in x.tolist()] for x in (u, y)))
        try:
            return u, y, problem, Minimum.near(problem, theta), {"starts_that_agree": [agreed, STARTS], "draw": draw}
        except (ArithmeticError, ZeroDivisionError):
            continue
    raise ArithmeticError(f"{plan.name}: no draw of {DRAWS} has a smooth optimum")


def certified(plan: Plan) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """The record's facts and its data."""
    u, y, problem, minimum, counts = smooth(plan)
    names, agreed = list(plan.free), counts["starts_that_agree"][0]
    spread, condition = deviations(problem, minimum.point)
    values = [float(p) for p in minimum.point]
    facts = {
        "name": plan.name,
        "level": next(name for most, least, name in LEVELS if condition < most and agreed >= least * STARTS),
        "blocks": list(plan.blocks),
        "fixed": {name: float(value) for name, value in plan.fixed.items()},
        "N": plan.N,
        "Ts": 1.0,
        "noise": {"share": plan.noise, "pole": plan.colour},
        "start1": start_of(names, values, 0.6),
        "start2": start_of(names, values, 0.95),
        "parameters": dict(zip(names, (mp.nstr(p, SHOWN) for p in minimum.point), strict=True)),
        "deviations": dict(zip(names, (mp.nstr(s, SHOWN) for s in spread), strict=True)),
        "rss": mp.nstr(minimum.rss, SHOWN),
        "proof": minimum.facts(names) | {"condition": float(f"{condition:.3g}")} | counts,
    }
    if plan.domain:
        sides = [[plan.domain[name][k] for name in names] for k in (0, 1)]
        proof = lowest(problem, values, [float(s) for s in spread], *sides)
        facts["global"] = {
            "domain": dict(zip(names, zip(proof.low, proof.high, strict=True), strict=True)),
            "convex_half_width": dict(zip(names, (float(f"{c:.3g}") for c in proof.convex), strict=True)),
            "boxes": proof.boxes,
        }
    return facts | (second(plan, problem, u, y) if plan.second else {}), u, y


def second(plan: Plan, problem: Problem, u: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """Of a record with a proved minimum that is not the lowest: that minimum, the level, and start1 in its valley."""
    names = list(plan.free)
    minimum = Minimum.near(problem, best(plan, list(plan.second.values()), u, y, 1)[0])
    start = start_of(names, [float(p) for p in minimum.point], 0.95)
    shown = minimum.facts(names) | {"rss": mp.nstr(minimum.rss, SHOWN)}
    return {"level": LEVELS[-1][-1], "start1": start, "second_minimum": shown}


def main(names: list[str]) -> None:
    """Make the records of these names, all without any."""
    OUT.mkdir(parents=True, exist_ok=True)
    for plan in PLANS:
        if names and plan.name not in names:
            continue
        began = time.perf_counter()
        try:
            facts, u, y = certified(plan)
        except ArithmeticError as error:
            print(f"{plan.name:22} FAILED: {error} ({time.perf_counter() - began:.1f} s)", flush=True)
            continue
        rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), y.tolist(), strict=True))
        (OUT / f"{plan.name}.csv").write_text("u,y\n" + rows, encoding="ascii")
        (OUT / f"{plan.name}.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="ascii")
        proof = facts["proof"]
        print(
            f"{plan.name:22} {facts['level']:8} cond {proof['condition']:<8g} radius {proof['relative_radius']:8} "
            f"agree {proof['starts_that_agree'][0]:2} draw {proof['draw']:2} "
            f"global {facts.get('global', {}).get('boxes', '-')} {time.perf_counter() - began:.1f} s",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
