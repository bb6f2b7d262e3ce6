"""Random short fits over all structures on odd records: what does not end as it should, as JSON.

A record is short, and may have constant parts, steps, two levels, a huge or tiny unit, an offset, outliers, missing
samples or pure noise. Counted are errors without a type of the library's own, results that are not finite, fits beyond
their budget of time, and fits whose loss on their own record is above that of their linear start or of a constant.
A chain without a parameter for an offset is compared with a constant of zero. Prints JSON, with the cases by seed.

    python scripts/study.py random_fits --seeds 0:200
    python scripts/study.py random_fits --seeds 1234:1235
"""

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from study import Study

import sysid
from sysid.blocks import STATIC, PiecewiseLinear, UnitGain
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.normal import Normal
from sysid.estimation.starts import starts as make_starts
from sysid.nlarx.model import Nlarx

S = sysid.structures
BUDGET = 5.0  # [s] of a fit, by the clock
GRACE = 5.0  # [s] for the last step and the covariance; judged by processor time, for a machine that is busy
LEAST = 1.0001  # ratio of losses above which one is worse: half a hundredth of a per cent of the output
TOLD = ("further from the output than", "did not converge")  # warnings with which a fit says that it is a bad one
MAPS = tuple(STATIC)


def model(rng: np.random.Generator):
    """A model of a drawn structure, and its name."""
    nb, nf, nk = int(rng.integers(1, 4)), int(rng.integers(1, 4)), int(rng.integers(0, 3))
    first_map, second_map = str(rng.choice(MAPS)), str(rng.choice(MAPS))
    makers: dict[str, Callable] = {
        "output_error": lambda: S.output_error(nb, nf, nk),
        "hammerstein": lambda: S.hammerstein(nb, nf, nk, input=first_map),
        "wiener": lambda: S.wiener(nb, nf, nk, output=second_map),
        "hammerstein_wiener": lambda: S.hammerstein_wiener(nb, nf, nk, input=first_map, output=second_map),
        "wiener_hammerstein": lambda: S.wiener_hammerstein(nb, nf, nk, middle=first_map),
        "state_space": lambda: S.state_space(nf, int(rng.integers(0, 4))),
        "nlarx": lambda: Nlarx(nf, nb, nk, units=int(rng.integers(0, 5))),
        "nlarx simulation": lambda: Nlarx(nf, nb, nk, units=int(rng.integers(0, 5)), focus="simulation"),
        "motor_profile": S.motor_profile,
        "coupled_drives": S.coupled_drives,
    }
    weights = np.array([2, 4, 4, 6, 2, 2, 2, 2, 1, 1], dtype=float)
    name = str(rng.choice(list(makers), p=weights / weights.sum()))
    return makers[name](), f"{name} {first_map} {second_map}"


def record(rng: np.random.Generator) -> sysid.IOData:
    """A short record with drawn oddities."""
    N = int(rng.integers(60, 400))
    u = {
        "noise": lambda: rng.normal(size=N),
        "steps": lambda: np.repeat(rng.normal(size=N // 20 + 1), 20)[:N],
        "levels": lambda: np.sign(np.repeat(rng.normal(size=N // 7 + 1), 7)[:N]),
        "sine": lambda: np.sin(np.arange(N) * rng.uniform(0.01, 1.0)),
        "ramp": lambda: np.arange(N) / N,
        "one step": lambda: (np.arange(N) > N // 3).astype(float),
    }[str(rng.choice(["noise", "noise", "steps", "levels", "sine", "ramp", "one step"]))]()
    x = np.tanh(2.0 * u) if rng.uniform() < 0.4 else np.where(np.abs(u) > 0.3, u, 0.0)
    y, pole = np.zeros(N), rng.uniform(0.0, 0.99)
    for t in range(1, N):
        y[t] = pole * y[t - 1] + (1.0 - pole) * x[t - 1]
    y = y**2 if rng.uniform() < 0.2 else y
    if rng.uniform() < 0.1:
        y = rng.normal(size=N)
    y = y + float(rng.choice([0.0, 1e-3, 0.1])) * (np.std(y) or 1.0) * rng.normal(size=N)
    if rng.uniform() < 0.3:
        a, b = np.sort(rng.integers(0, N, 2))
        (u if rng.uniform() < 0.5 else y)[a:b] = 0.0
    if rng.uniform() < 0.2:
        y[rng.integers(0, N, 3)] += 50.0 * (np.std(y) or 1.0) * rng.normal(size=3)
    u = u * 10.0 ** float(rng.choice([0, 0, 0, -30, -6, 6, 30])) * float(rng.choice([1.0, -1.0]))
    y = y * 10.0 ** float(rng.choice([0, 0, 0, -30, -6, 6, 30])) * float(rng.choice([1.0, -1.0]))
    if rng.uniform() < 0.3:
        u, y = u + 10.0 * np.std(u), y + 10.0 * np.std(y)
    missing = rng.uniform(size=N) < 0.1 if rng.uniform() < 0.1 else None
    return sysid.IOData(u, y, float(rng.choice([1.0, 1e-3, 60.0])), missing=missing)


def references(chain, data: sysid.IOData, seed: int) -> dict[str, float]:
    """Losses of the chain's linear start and of the constant that it can be.

    Maps that end with a prior start as straight lines: to follow the noise less than a start whose curves are free is
    what the prior is for.
    """
    straight = (UnitGain(role=b.role) if isinstance(b, PiecewiseLinear) else b for b in chain.blocks)
    chain = replace(chain, blocks=tuple(straight))
    y = data.y[data.observed]
    takes = any(s.out_shift == 1.0 for b in chain.blocks[-1:] for s in b.symmetries(b.start(data.u[:, 0])))
    losses = {"constant": float(np.mean((y - y.mean()) ** 2 if takes else y**2))}
    try:
        if chain.structure == "state_space":
            linear = replace(chain.blocks[0], units=0, degree=0, readout=False)
            chain = replace(chain, blocks=(linear, *chain.blocks[1:]))
        chain = chain.scaled(data.u, data.y)
        normalised = Normal.choose(chain, data, sysid.Objective())
        size, chain, data = normalised.size, normalised.chain, normalised.data
        theta = with_initial_states(chain, make_starts(chain, data, 1, seed)[0], data)[0]
        losses["linear_start"] = float(np.mean((data.y - chain.outputs(theta, data.u))[data.observed] ** 2)) * size**2
    except (sysid.InputError, np.linalg.LinAlgError):
        pass  # a structure without one for this record
    return losses


def network_references(model: Nlarx, data: sysid.IOData, seed: int) -> dict[str, float]:
    linear = sysid.fit(replace(model, units=0), data, seed=seed)  # by the same search: another one may end elsewhere
    scored_samples = data.observed[:, 0].copy()
    scored_samples[: model.lag] = (
        False  # these are not scored, nor, one step ahead, those with a missing sample in their past
    )
    for lag in range(1, model.na + 1 if model.focus == "prediction" else 0):
        scored_samples[model.lag :] &= data.observed[model.lag - lag : data.N - lag, 0]
    y = data.y[scored_samples]
    return {"linear_start": linear.criteria.mse, "constant": float(np.mean((y - y.mean()) ** 2))}


def tried(seed: int) -> tuple[str, list[str]]:
    """The name of a case, and what is wrong with it."""
    rng = np.random.default_rng([seed, 77])
    chain, name = model(rng)
    data, wrong = record(rng), []
    for _ in range(2):  # the second time kernels have been compiled, which no budget counts
        began = time.process_time()
        try:
            fit = sysid.fit(chain, data, seed=seed, options=sysid.Options(max_seconds=BUDGET))
            percent, refused = fit.fit_percent(data), ""
        except sysid.InputError:
            refused = " refused"
        except Exception as e:  # every other error counts
            return name, [f"untyped_errors {type(e).__name__}: {e}"]
        seconds = time.process_time() - began
        if seconds <= BUDGET + GRACE:
            break
    else:
        wrong.append(f"over_budget {seconds:.1f} s")
    if refused:
        return name + refused, wrong
    if not np.all(np.isfinite(fit.theta)) or np.isnan(percent) or not np.isfinite(fit.criteria.mse):
        wrong.append("not_finite")
    try:
        with np.errstate(all="ignore"):
            reference_losses = network_references if isinstance(chain, Nlarx) else references
            losses = reference_losses(chain, data, seed)
    except Exception:
        losses = {}  # the reference itself fails where the fit does not
    told = any(words in text for text in fit.warnings for words in TOLD)
    floor = 1e-20 * float(np.mean(data.y**2))  # both are exact
    for reference, loss in losses.items():
        if np.isfinite(loss) and fit.criteria.mse > LEAST * loss + floor:
            kind = f"worse_than_{reference}{'_told' * told}"
            wrong.append(f"{kind} by {100.0 * (fit.criteria.mse / loss - 1.0):.2g} %")
    return name, wrong


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, Any]:
    """The name of a case, and what is wrong with it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        name, wrong = tried(*case)
    return {"name": name, "wrong": wrong}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> dict[str, Any]:
    """How often each kind of fault was met, and the cases that have one."""
    counts = Counter(kind.split()[0] for row in rows for kind in row["wrong"])
    refusals = sum(row["name"].endswith("refused") for row in rows)
    cases = {f"{row['case'][0]} {row['name']}": row["wrong"] for row in rows if row["wrong"]}
    return {"fits": len(rows), "refused_with_a_sentence": refusals, **dict(sorted(counts.items())), "cases": cases}


STUDY = Study(
    cases=lambda options: ((seed,) for seed in options.seeds),
    score=score,
    summary=summary,
    seeds="0:200",
    line=lambda row: f"{row['case'][0]} {row['name']} {row['wrong'] or 'ok'}",
)
