"""What a fit loses on inputs that it has not seen: drawn plants, points of fit below the plant itself.

Plants of the chain structures with orders 1 to 4 and maps of eleven families, N 200 to 4000, 10 to 60 dB; the model has
the true orders and the structure's default maps. Each fit runs free on another draw of its own kind of input and on
another kind, 3000 samples. "inside" are those whose maps meet less than 1 % of signals that the record has not shown;
the others extrapolate, which no record settles. "bands" are the shares of measured unseen samples that the 50 % and the
95 % band of the free run hold, and of plants on which the 95 % band holds less than 85 %.

    python scripts/study.py unseen_loss --seeds 0:25 --figure loss.png
    python scripts/study.py unseen_loss --seeds 0:25 --memory 0.8    # coloured noise
"""

import argparse
import time
import zlib
from pathlib import Path

import numpy as np
from study import Row, Study

from sysid.base.errors import InputError
from sysid.bench.drawing.plants import CHAINS, Plant, draw_chain, scale_gains
from sysid.bench.drawing.signals import INPUTS, coloured, excitation
from sysid.block.block import StaticBlock
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.objective import Objective
from sysid.structures import TABLE
from sysid.uncertainty import bands
from sysid.uncertainty.information import Information, information

N_UNSEEN, SETTLED = (
    3000,
    300,
)  # samples of an unseen run, and those of its start that do not count: they give its initial state
OUTSIDE = 0.01  # share of samples beyond the range of the record
LEVELS = (0.5, 0.95)
OBJECTIVES = {"knots 0": Objective(knots=0), "default": Objective()}


def draw_record(structure: str, seed: int, memory: float) -> tuple[Plant, IOData, float, dict[str, np.ndarray], str]:
    """A plant, its record, the deviation of the noise, inputs of its own and of another kind, and what was drawn."""
    rng = np.random.default_rng([seed, zlib.crc32(structure.encode()), 33])
    N, kind = int(np.exp(rng.uniform(np.log(200), np.log(4000)))), str(rng.choice(INPUTS))
    u = excitation(kind, N, rng)
    plant = None
    while plant is None:
        plant = scale_gains(draw_chain(structure, N, rng), u)
    y, snr = plant.run(u), rng.uniform(10.0, 60.0)
    size = float(y.std()) * 10 ** (-snr / 20)
    data = IOData(u, y + size * coloured(N, memory, rng), 1.0)
    other = str(rng.choice([k for k in INPUTS if k != kind]))
    unseen = {"same kind": excitation(kind, N_UNSEEN, rng), "another kind": excitation(other, N_UNSEEN, rng)}
    return plant, data, size, unseen, f"{plant.given}; {kind}, then {other}; N {N}, {snr:.0f} dB"


def outside(plant: Plant, seen: np.ndarray, u: np.ndarray) -> float:
    """Largest share of samples at which a map of the plant meets what it has not met in the record."""
    runs = [plant.chain.signals(plant.theta, x)[:-1] for x in (seen, u)]
    pairs = zip(plant.chain.blocks, *runs, strict=True)
    shares = [np.mean((b < a.min()) | (b > a.max())) for block, a, b in pairs if isinstance(block, StaticBlock)]
    return float(max(shares, default=0.0))


def loss(y: np.ndarray, yhat: np.ndarray, noise: np.ndarray) -> float:
    """Points of fit percent that the free run yhat (N,) of the measured y (N,) is below that of the plant itself."""
    return float(100.0 * (np.linalg.norm(y - yhat) - np.linalg.norm(noise)) / np.linalg.norm(y - y.mean()))


def score(case: tuple[str, int], options: argparse.Namespace) -> Row:
    """Losses of every objective on both kinds of unseen input."""
    structure, seed = case
    plant, data, size, unseen, given = draw_record(structure, seed, options.memory)
    nb, nf, nk = plant.orders
    model = TABLE[structure](nb=nb, nf=nf, nk=nk).model()
    row: Row = {"structure": structure, "seed": seed, "given": given}
    row["outside"] = {kind: outside(plant, data.u[:, 0], u) for kind, u in unseen.items()}
    noise = size * coloured(N_UNSEEN, options.memory, np.random.default_rng(seed))
    for name, objective in OBJECTIVES.items():
        start = time.process_time()
        try:
            fit = fit_chain(model, data, objective=objective)
        except InputError as error:
            row[name] = {"error": str(error)}
            continue
        row[name] = {"seconds": time.process_time() - start, "d": fit.criteria.d, "warned": list(fit.warnings)}
        try:
            info = information(fit, data)
        except InputError:  # without a band no sample is held
            info = None
        for kind, u in unseen.items():
            y = plant.run(u) + noise
            row[name][f"held, {kind}"] = [share_held(info, u, y, level) for level in LEVELS] if info else [0.0, 0.0]
            yhat = fit.runs(IOData(u, y, 1.0))[0].y[:, 0]
            row[name][kind] = loss(y[SETTLED:], yhat[SETTLED:], noise[SETTLED:])
    return row


def share_held(info: Information, u: np.ndarray, y: np.ndarray, level: float) -> float:
    """The share of the settled samples of y (N,) that the band of the free run holds."""
    run = bands.linear(info, IOData(u, y, 1.0), level=level, noise=True)
    return float(np.mean(((run.lower <= y) & (y <= run.upper))[SETTLED:]))


def losses(rows: list[Row], name: str, kind: str, inside: bool) -> np.ndarray:
    """Losses of one objective; infinite for a fit that ended in an error."""
    chosen = [r for r in rows if not inside or r["outside"][kind] < OUTSIDE]
    return np.array([r[name].get(kind, np.inf) for r in chosen])


def draw(rows: list[Row], path: Path) -> None:
    """Losses as shares of the plants."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(11, 4.2), sharey=True, layout="constrained")
    for axes, kind in zip(panels, ("same kind", "another kind"), strict=True):
        for color, name in zip(("tab:orange", "tab:blue"), OBJECTIVES, strict=True):
            for style, inside in (("-", True), (":", False)):
                x = np.sort(np.clip(losses(rows, name, kind, inside), 1e-3, 100.0))
                label = f"{name}, {'inside' if inside else 'all'} ({len(x)})"
                axes.step(x, 100 * np.arange(1, len(x) + 1) / len(x), style, color=color, where="post", label=label)
        axes.set(xscale="log", xlim=(1e-3, 100), xlabel="points of fit below the plant itself", title=kind)
        axes.legend(fontsize=8)
    panels[0].set_ylabel("plants [%]")
    figure.suptitle("Further left is better: with more break points and a prior, a fit loses less on unseen inputs")
    figure.savefig(path, dpi=130)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Median, 90 % and worst loss and the share above 3 points, by kind, structure and objective; the worst cases."""
    if options.figure:
        draw(rows, options.figure)
    lines = []
    for kind in ("same kind", "another kind"):
        for structure in [*options.structures, "all"]:
            group = [r for r in rows if structure in (r["structure"], "all")]
            for name in OBJECTIVES:
                seconds = np.median([r[name].get("seconds", np.nan) for r in group])
                for inside in (True, False):
                    x = losses(group, name, kind, inside)
                    chosen = [r for r in group if not inside or r["outside"][kind] < OUTSIDE]
                    held = np.array([r[name].get(f"held, {kind}", [0.0, 0.0]) for r in chosen])
                    if len(x):
                        shares = "  ".join(f"{100 * share:.0f} %" for share in held.mean(axis=0))
                        lines.append(
                            f"{kind:12s} {structure:20s} {name:9s} {'inside' if inside else 'all':6s} n {len(x):4d}  "
                            f"median {np.median(x):6.2f}  90 % {np.quantile(x, 0.9, method='higher'):7.2f}  above 3 "
                            f"{100 * np.mean(x > 3):3.0f} %  worst {x.max():7.1f}  {seconds:.2f} s CPU  "
                            f"bands {shares}, {100 * np.mean(held[:, 1] < 0.85):.0f} %"
                        )
    for name in OBJECTIVES:
        for r in sorted(rows, key=lambda r: -r[name].get("another kind", np.inf))[: options.worst]:
            lines.append(f"{name}: {r[name]} outside {r['outside']} {r['structure']} {r['seed']}: {r['given']}")
    return "\n".join(lines)


STUDY = Study(
    cases=lambda options: ((structure, seed) for seed in options.seeds for structure in options.structures),
    score=score,
    summary=summary,
    seeds="0:10",
    options={
        "--structures": {"nargs": "+", "default": [name for name in CHAINS if name != "output_error"]},
        "--memory": {"type": float, "default": 0.0, "help": "of the noise: correlation of neighbouring samples"},
        "--worst": {"type": int, "default": 3},
        "--figure": {"type": Path, "help": "draw the losses"},
    },
)
