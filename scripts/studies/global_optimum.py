"""How often the search reaches the optimum of the plain loss: drawn plants, loss over that of fits begun at the truth.

Plants have orders 1 to 4, maps of eleven families, N 1000 to 4000, 10 to 60 dB. The model has the true orders and the
structure's default maps, or with --own the plant's own maps. Fits from the truth begin at the true filters, with the
break points at quantiles and at the true kinks; the best of them is the reference.

    python scripts/study.py global_optimum --seeds 0:20 --structures wiener hammerstein_wiener
"""

import argparse
import time
import zlib
from pathlib import Path

import numpy as np
from study import Row, Study

from sysid.bench.drawing.plants import CHAINS, Plant, draw_chain, scale_gains
from sysid.bench.drawing.signals import INPUTS, excitation
from sysid.blocks import PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.objective import Objective
from sysid.model.chain import Chain
from sysid.structures import TABLE

PLAIN = Objective(knots=0)


def draw_record(structure: str, seed: int) -> tuple[Plant, IOData, float, str]:
    """A plant, its record, the noise variance, and what was drawn."""
    rng = np.random.default_rng([seed, zlib.crc32(structure.encode()), 13])
    N, kind = int(rng.integers(1000, 4001)), str(rng.choice(INPUTS))
    u = excitation(kind, N, rng)
    plant = None
    while plant is None:
        plant = scale_gains(draw_chain(structure, N, rng), u)
    y, snr = plant.run(u), rng.uniform(10.0, 60.0)
    size = float(y.std()) * 10 ** (-snr / 20)
    return plant, IOData(u, y + size * rng.standard_normal(N), 1.0), size**2, f"{plant.given}; {kind} {N}, {snr:.0f} dB"


def model_of(plant: Plant) -> Chain:
    nb, nf, nk = plant.orders
    return TABLE[plant.chain.structure](nb=nb, nf=nf, nk=nk).model()


def from_truth(plant: Plant, model: Chain, data: IOData) -> float:
    """The smallest loss of fits that begin at the true filters and curves."""
    starts = []
    for way in ("quantiles", "kinks", "even"):
        theta, x = [], data.u[:, 0]
        for true, block in zip(plant.chain.blocks, model.blocks, strict=False):
            part = plant.theta[plant.chain.index(true)]
            if (isinstance(block, PiecewiseLinear) and not isinstance(true, PiecewiseLinear)) or block != true:
                places = _places(true, part, x, block.n, way)
                theta.append(np.concatenate([places, true.output(part, places)]))
            else:
                theta.append(part)
            x = true.output(part, x)
        theta += [np.zeros(block.n_parameters) for block in model.blocks[len(theta) :]]  # an offset of the output
        starts.append(np.concatenate(theta))
        if model.blocks == plant.chain.blocks:
            break
    return min(fit_chain(model, data, start=s, objective=PLAIN).criteria.mse for s in starts)


def _places(true, part: np.ndarray, x: np.ndarray, knots: int, way: str) -> np.ndarray:
    """Break points (knots,) of a map: even, at quantiles of its input, or at the kinks of the true map."""
    if way == "even":
        return np.linspace(x.min(), x.max(), knots)
    places = np.quantile(x, np.linspace(0, 1, knots))
    if way == "kinks":
        fine = np.linspace(x.min(), x.max(), 4001)
        bend = np.abs(np.diff(true.output(part, fine), 2))
        bends = np.flatnonzero(bend > max(0.02 * bend.max(), 1e-9))
        groups = np.split(bends, np.flatnonzero(np.diff(bends) > 3) + 1) if len(bends) else []
        kinks = [fine[1 + g[len(g) // 2]] for g in groups][: knots - 2]
        if len(kinks) < knots - 2:  # the others halve the widest gaps
            positions = sorted([x.min(), *kinks, x.max()])
            while len(positions) < knots:
                k = int(np.argmax(np.diff(positions)))
                positions.insert(k + 1, 0.5 * (positions[k] + positions[k + 1]))
            places = np.array(positions)
    gap = 0.012 * (places[-1] - places[0])
    for k in range(1, knots):
        places[k] = max(places[k], places[k - 1] + gap)
    return places


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Loss of the default fit over that of the best fit from the truth, and how the fit went."""
    structure, seed = case
    plant, data, variance, description = draw_record(structure, seed)
    model = plant.chain if options.own else model_of(plant)
    start = time.process_time()
    try:
        fit = fit_chain(model, data, starts=options.starts or "auto", objective=PLAIN)
    except Exception as e:
        return {"structure": structure, "seed": seed, "ratio": np.inf, "error": str(e), "given": description}
    seconds = time.process_time() - start
    bar = from_truth(plant, model, data)
    return {
        "structure": structure,
        "seed": seed,
        "ratio": fit.criteria.mse / bar,
        "fit": fit.fit_percent(data),
        "bar": bar / variance,
        "own": fit.criteria.mse / variance,
        "seconds": seconds,
        "warned": list(fit.warnings),
        "agreed": fit.agreed,
        "won": fit.members[int(np.argmin(fit.losses))] if fit.members else "",
        "given": description,
    }


def draw(rows: list[Row], path: Path) -> None:
    """Loss over that from the truth as shares of the plants, and how often each member gave the first leader."""
    import matplotlib.pyplot as plt

    figure, (axes, bars) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for structure in dict.fromkeys(r["structure"] for r in rows):
        ratio = np.sort([min(r["ratio"], 10.0) for r in rows if r["structure"] == structure])
        axes.step(
            ratio, 100 * (1 + np.arange(len(ratio))) / len(ratio), where="post", label=f"{structure} ({len(ratio)})"
        )
    axes.axvline(1.01, color="0.5", linestyle=":", label="1 % and 10 % above")
    axes.axvline(1.1, color="0.5", linestyle=":")
    axes.set(xscale="log", xlim=(0.5, 10), xlabel="loss / loss of a fit begun at the truth", ylabel="plants [%]")
    axes.legend(fontsize=8)
    winners = [r.get("won", "") for r in rows if r.get("won")]
    names = sorted(set(winners), key=winners.count)
    bars.barh(names, [winners.count(name) for name in names])
    bars.set(xlabel="plants on which this member led the race")
    figure.suptitle("A line that stands at 100 % left of 1.01 reached the optimum on every plant")
    figure.savefig(path, dpi=130)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """By structure: how many fits reached the optimum, silent failures and seconds; then the worst cases."""
    if options.figure:
        draw(rows, options.figure)
    lines = []
    for structure in [*options.structures, "all"]:
        group = [r for r in rows if structure in (r["structure"], "all")]
        ratio, s = np.array([r["ratio"] for r in group]), np.array([r.get("seconds", np.nan) for r in group])
        silent = sum(1 for r in group if r["ratio"] > 1.1 and not r.get("warned"))
        lines.append(
            f"{structure:20s} n {len(group):4d}  within 1 % {100 * np.mean(ratio <= 1.01):5.1f} %  10 % "
            f"{100 * np.mean(ratio <= 1.1):5.1f} %  silent {silent}  median {np.nanmedian(s):.2f} s  "
            f"longest {np.nanmax(s):.2f} s (CPU)  lower than the truth's {np.mean(ratio < 0.99):.2f}"
        )
    for r in sorted(rows, key=lambda r: -r["ratio"])[: options.worst]:
        lines.append(
            f"{r['ratio']:10.4g} {r['structure']} {r['seed']}: {r['given']} {r.get('agreed')} {r.get('warned')}"
        )
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((structure, seed) for seed in options.seeds for structure in options.structures),
    score=score,
    summary=summary,
    seeds="0:10",
    options={
        "--structures": {"nargs": "+", "default": list(CHAINS)},
        "--own": {"action": "store_true", "help": "the plant's own maps"},
        "--starts": {"type": lambda text: text if text == "auto" else int(text)},
        "--worst": {"type": int, "default": 8},
        "--figure": {"type": Path, "help": "draw the shares and what each member won"},
    },
)
