"""Free runs from a fitted initial state beside runs from rest, over plants, windows, noise and how a record begins.

python scripts/study.py initial_windows [--seeds 0:120]

Each plant (output error of order 1 to 6) is fitted to one record and run over others that begin at rest, in the middle
of an experiment, or at a constant level. The first `window` outputs give the initial state; the error counts after
them, over 200 samples, as a share [%] of the standard deviation of the noise-free output (root mean square error of the
free run against the noise-free output). The mean over plants of (error - error from rest) must not be positive.
"""

import argparse
from typing import Any

import numpy as np
from study import Study, markdown

from sysid import IOData, fit
from sysid.bench.drawing.plants import draw_filter
from sysid.bench.drawing.signals import excitation
from sysid.estimation.free_run import resting_theta
from sysid.estimation.initial_state import estimate_initial
from sysid.model.chain import Chain

WINDOWS = (2, 5, 10, 20, 50, 200)
BEGINS = ("at rest", "in the middle", "at a level")
SCORED = 200
INPUTS = ("aprbs", "multisine", "slow noise", "random steps")


def record(chain: Chain, theta: np.ndarray, u: np.ndarray, noise: float, rng: np.random.Generator) -> IOData:
    """A record of the plant from rest with white noise of this standard deviation."""
    return IOData(u, chain.simulate(theta, u) + noise * rng.standard_normal(len(u)), 1.0)


def errors(seed: int) -> dict[tuple[str, int], tuple[int, float, np.ndarray]]:
    """By beginning and window: order, noise [dB], and the errors [%] from rest, by least squares and as simulated."""
    rng = np.random.default_rng([13, seed])
    order = 1 + seed % 6
    block, theta, _ = draw_filter(rng, 1000, order, "linear")
    chain = Chain((block,), structure="output_error")
    kind = INPUTS[int(rng.integers(4))]
    u = excitation(kind, 1000, rng)
    clean = chain.simulate(theta, u)
    level = float(rng.uniform(10.0, 60.0))
    noise = float(clean.std()) * 10 ** (-level / 20)
    model = fit(chain, record(chain, theta, u, noise, rng), starts=2)
    rows = {}
    for begin in BEGINS:
        u = excitation(kind, 2000, rng)
        begin_sample = {"at rest": 0, "in the middle": 1000, "at a level": 1000}[begin]
        if begin == "at a level":
            u[:begin_sample] = u[begin_sample]
        clean = chain.simulate(theta, u)[begin_sample:]
        u = u[begin_sample:]
        size = float(clean.std())
        data = IOData(u, clean + noise * rng.standard_normal(len(u)), 1.0)
        for window in WINDOWS:
            window_end = slice(window, window + SCORED)
            rest = chain.simulate(resting_theta(chain, model.theta), u)
            plain = chain.simulate(estimate_initial(chain, model.theta, data.select(0, window)), u)
            simulated = model.simulate(data, n_init=window)
            shares = [float(np.sqrt(np.mean((y - clean)[window_end] ** 2))) / size for y in (rest, plain, simulated)]
            rows[begin, window] = order, level, 100 * np.array(shares)
    return rows


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, Any]:
    """See `errors`; a list of each beginning and window."""
    rows = errors(*case)
    return {"errors": [[*key, order, level, *shares] for key, (order, level, shares) in rows.items()]}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """The table by beginning and window, and the worst class of order and noise."""
    plants, seeds = len(rows), [row["case"][0] for row in rows]
    runs = [{(begin, window): rest for begin, window, *rest in row["errors"]} for row in rows]
    headings = ["begins", "window", "rest", "least squares", "simulate"]
    headings += ["mean excess over rest", "std. error", "largest"]
    cells = []
    for begin in BEGINS:
        for window in WINDOWS:
            e = np.array([run[begin, window][2:] for run in runs])
            excess, mean = e[:, 2] - e[:, 0], e.mean(axis=0)
            spread = excess.std() / np.sqrt(plants)
            cells.append([begin, window, *(f"{m:.3g}" for m in mean), f"{excess.mean():+.3f}", f"{spread:.3f}"])
            cells[-1].append(f"{excess.max():+.2f}")
    lines = [f"{plants} plants, seeds {seeds[0]} to {seeds[-1]}; errors in % of the output, after the window"]
    lines += [markdown(headings, cells), "\nMean excess over rest by order and by noise, all windows:"]
    for begin in BEGINS:
        order, level, rest, _, simulated = np.array([run[begin, w] for run in runs for w in WINDOWS]).T
        groups = [(f"order {k}", order == k) for k in range(1, 7)]
        groups += [(f"{d}-{d + 10} dB", (level >= d) & (level < d + 10)) for d in range(10, 60, 10)]
        means = (f"{name} {(simulated - rest)[group].mean():+.3f}" for name, group in groups if group.any())
        lines.append(f"{begin}: " + ", ".join(means))
    return "\n".join(lines)


STUDY = Study(cases=lambda options: ((seed,) for seed in options.seeds), score=score, summary=summary, seeds="0:120")
