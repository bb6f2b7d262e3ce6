"""Does the choice between structures by parts of other kinds lose less on other inputs, and how sure is it?

The plants and records of `unseen_loss`, N from 400. Candidates are the five chain structures with the true orders and
default maps. Each is judged on the two interleaved folds and on the six of other kinds, then fitted to the whole record
and run over another draw of its own kind of input and over another kind; the error is that to the noise-free output.
"regret" is the error of the choice less that of the best candidate, in points of fit. "sure" compares every pair: how
often the one that is said to be better is better.

    python scripts/study.py other_kinds --seeds 0:12
"""

import argparse
import itertools
import math
from dataclasses import replace

import numpy as np
from study import Row, Study
from unseen_loss import SETTLED, draw_record

from sysid.base.errors import InputError
from sysid.bench.drawing.plants import CHAINS, Plant
from sysid.data.record import IOData
from sysid.model.recipes import Recipe
from sysid.selection.folds import folds, folds_of_other_kinds
from sysid.selection.judge import Effort, Job, fitted, judge, judge_by_kind
from sysid.selection.table import Row as Judged
from sysid.selection.table import choose_by_kind, confidence, mean_log, ranked
from sysid.structures import TABLE

KINDS = ("same kind", "another kind")
EFFORT = Effort(4, 100, 4.0)
EDGES = (0.5, 0.7, 0.9, 0.95, 0.99, 1.0)
LEAST = 400  # samples


def errors(plant: Plant, data: IOData, unseen: dict[str, np.ndarray], c: Recipe) -> dict[str, float]:
    """The error [% of the deviation] of a fit to the whole record on every unseen input."""
    try:
        fit = fitted(c, c.scale(data), "auto", 0, EFFORT)
    except InputError:
        return dict.fromkeys(KINDS, math.inf)
    values = {}
    for kind, u in unseen.items():
        y = plant.run(u)
        e = (y - np.ravel(fit.simulate(c.scale(IOData(u, y, 1.0)), SETTLED)))[SETTLED:]
        values[kind] = float(100.0 * np.linalg.norm(e) / np.linalg.norm(y[SETTLED:] - y[SETTLED:].mean()))
    return {kind: e if math.isfinite(e) else math.inf for kind, e in values.items()}


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """The regret of both choices, and of every pair how sure it is and which of the two is better."""
    structure, seed = case
    plant, data, _, unseen, given = draw_record(structure, seed)
    row: Row = {"structure": structure, "seed": seed, "given": given}
    if data.N < LEAST:
        return row
    judged: dict[Recipe, Judged] = {}
    for name in CHAINS:
        c = TABLE[name](*plant.orders)
        interleaved = judge(Job(c, folds(data), EFFORT, "auto", 0, 3, whole=True))
        others = judge_by_kind(Job(c, folds_of_other_kinds(data), EFFORT, "auto", 0, 0, whole=True))
        assert interleaved is not None
        assert others is not None
        same = [mean_log(part) for part in np.split(interleaved.errors, 2)]
        judged[c] = replace(interleaved, kinds=np.concatenate([same, others]))
    true = {c: errors(plant, data, unseen, c) for c in judged}
    rows, before = ranked(judged)
    after = choose_by_kind(rows)
    for kind in KINDS:
        best = min(min(e[kind] for e in true.values()), 100.0)
        row[kind] = {w: min(true[r.candidate][kind], 100.0) - best for w, r in (("folds", before), ("kinds", after))}
    row["right"] = {"folds": before.candidate.name == structure, "kinds": after.candidate.name == structure}
    row["pairs"] = []
    for i, a in enumerate(rows):
        for b in rows[:i]:
            first, second = (a, b) if confidence(a, b) >= 0.5 else (b, a)
            better = [true[first.candidate][kind] < true[second.candidate][kind] for kind in KINDS]
            row["pairs"].append([confidence(first, second), *better])
    return row


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Regret by choice and kind of input, and how often a choice that is so sure is right."""
    rows = [r for r in rows if "pairs" in r]
    lines = []
    for kind in KINDS:
        for way in ("folds", "kinds"):
            x = np.array([r[kind][way] for r in rows])
            right = np.mean([r["right"][way] for r in rows])
            lines.append(
                f"{kind:12s} by {way:5s} n {len(x)}: regret mean {x.mean():.2f}, 90 % "
                f"{np.quantile(x, 0.9, method='higher'):.2f}, above 3 points {100 * np.mean(x > 3):.0f} %, worst "
                f"{x.max():.1f}; the plant's structure {100 * right:.0f} %"
            )
    pairs = np.array([p for r in rows for p in r["pairs"]], dtype=float)
    for low, high in itertools.pairwise(EDGES):
        within = pairs[(pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == 1.0))]
        if len(within):
            shares = ", ".join(f"{kind} {100 * within[:, k + 1].mean():.0f} %" for k, kind in enumerate(KINDS))
            lines.append(f"sure to {100 * low:.0f}-{100 * high:.0f} %: n {len(within)}, better on {shares}")
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: (
        (structure, seed) for seed in options.seeds for structure in CHAINS if structure != "output_error"
    ),
    score=score,
    summary=summary,
    seeds="0:10",
)
