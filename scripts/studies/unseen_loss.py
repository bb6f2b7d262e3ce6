"""What a fit loses on inputs that it has not seen: drawn plants, points of fit below the plant itself.

Plants of the chain structures with orders 1 to 4 and maps of eleven families, N 200 to 4000, 10 to 60 dB; the model has
the true orders and the structure's default maps. Each fit runs free on another draw of its own kind of input and on
another kind, 3000 samples. "inside" are those whose maps meet less than 1 % of signals that the record has not shown;
the others extrapolate, which no record settles. "bands" are the shares of measured unseen samples that the 50 % and
the 95 % band of the free run hold, and of plants on which the 95 % band holds less than 85 %. "said" counts the
default fits that lose more than 3 points and say so: by a warning, or by a band that still holds 85 %. "named" counts
the shapes that the default names for maps: right ones of those that the plants have, and wrong ones of all other maps.

    python scripts/study.py unseen_loss --seeds 0:25 --figure loss.png    # beside it the worst runs: loss-worst.png
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
from sysid.blocks import DeadZone, DeadZoneSaturation, Polynomial, Saturation
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.objective import Objective
from sysid.model.chain import Chain
from sysid.structures import TABLE
from sysid.uncertainty import bands
from sysid.uncertainty.information import Information, information

N_UNSEEN, SETTLED = (
    3000,
    300,
)  # samples of an unseen run, and those of its start that do not count: they give its initial state
OUTSIDE = 0.01  # share of samples beyond the range of the record
LEVELS = (0.5, 0.95)
BAD, ENOUGH = 3.0, 0.85  # points lost, and the share of samples that a band of 95 % should at least hold
OBJECTIVES = {"knots 0": Objective(knots=0), "no shapes": Objective(shapes=False), "default": Objective()}
COLORS = ("tab:orange", "tab:green", "tab:blue")
NAMED = (Polynomial, Saturation, DeadZone, DeadZoneSaturation)
DRAWN = 4  # worst runs in a figure, and how many samples of them
DRAWN_SAMPLES = 300


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
        row[name]["mse"] = fit.criteria.mse / size**2
        pairs = [(shape(plant.chain, role), shape(fit.model, role)) for role in map_roles(plant.chain)]
        row[name]["named"] = pairs
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


def map_roles(chain: Chain) -> list[str]:
    """The roles of the maps that may have a shape."""
    return [block.role for block in chain.blocks if isinstance(block, StaticBlock)]


def shape(chain: Chain, role: str) -> str:
    """The kind of a map with its degree; empty for one that is no shape."""
    block = next(block for block in chain.blocks if block.role == role)
    return f"{type(block).__name__}{getattr(block, 'degree', '')}" if isinstance(block, NAMED) else ""


def share_held(info: Information, u: np.ndarray, y: np.ndarray, level: float) -> float:
    """The share of the settled samples of y (N,) that the band of the free run holds."""
    run = bands.linear(info, IOData(u, y, 1.0), level=level, noise=True)
    return float(np.mean(((run.lower <= y) & (y <= run.upper))[SETTLED:]))


def losses(rows: list[Row], name: str, kind: str, inside: bool) -> np.ndarray:
    """Losses of one objective; infinite for a fit that ended in an error."""
    chosen = [r for r in rows if not inside or r["outside"][kind] < OUTSIDE]
    return np.array([r[name].get(kind, np.inf) for r in chosen])


def said(rows: list[Row], kind: str) -> tuple[int, int]:
    """Of the default fits that lose more than `BAD` points, how many say so, and how many there are."""
    bad = [r["default"] for r in rows if r["default"].get(kind, np.inf) > BAD]
    told = [fit for fit in bad if fit.get("error") or fit["warned"] or fit[f"held, {kind}"][1] >= ENOUGH]
    return len(told), len(bad)


def draw(rows: list[Row], path: Path, memory: float) -> None:
    """Losses as shares of the plants, and how much of the unseen samples the 95 % band holds on each plant."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, 2, figsize=(11, 8), sharey=True, layout="constrained")
    for (axes, below), kind in zip(panels.T, ("same kind", "another kind"), strict=True):
        for color, name in zip(COLORS, OBJECTIVES, strict=True):
            for style, inside in (("-", True), (":", False)):
                x = np.sort(np.clip(losses(rows, name, kind, inside), 1e-3, 100.0))
                label = f"{name}, {'inside' if inside else 'all'} ({len(x)})"
                axes.step(x, 100 * np.arange(1, len(x) + 1) / len(x), style, color=color, where="post", label=label)
            held = np.sort([r[name].get(f"held, {kind}", [0.0, 0.0]) for r in rows], axis=0)
            share = 100 * np.arange(1, len(held) + 1) / len(held)
            for level, values, style in zip(LEVELS, held.T, (":", "-"), strict=True):
                label = f"{name}, {100 * level:g} % band: {100 * values.mean():.1f} %"
                below.step(100 * values, share, style, color=color, where="post", label=label)
        for level in LEVELS:
            below.axvline(100 * level, color="0.6", linewidth=0.8)
        axes.set(xscale="log", xlim=(1e-3, 100), xlabel="points of fit below the plant itself", title=kind)
        below.set(xlim=(0, 100), xlabel="samples in the band [%]")
        axes.legend(fontsize=7)
        below.legend(fontsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("plants [%]")
    figure.suptitle("Above, further left is better; below, a step at the grey line of its level is right")
    figure.savefig(path, dpi=110)
    draw_worst(rows, path.with_name(f"{path.stem}-worst{path.suffix}"), memory)


def draw_worst(rows: list[Row], path: Path, memory: float) -> None:
    """The worst default fits over another kind of input where they err most, with their bands."""
    import matplotlib.pyplot as plt

    kind = "another kind"
    worst = sorted(rows, key=lambda r: -r["default"].get(kind, np.inf))[:DRAWN]
    figure, panels = plt.subplots(len(worst), 1, figsize=(11, 2.6 * len(worst)), layout="constrained")
    for axes, r in zip(panels, worst, strict=True):
        plant, data, _, unseen, given = draw_record(r["structure"], r["seed"], memory)
        nb, nf, nk = plant.orders
        fit = fit_chain(TABLE[r["structure"]](nb=nb, nf=nf, nk=nk).model(), data)
        y = plant.run(unseen[kind])
        record = IOData(unseen[kind], y, 1.0)
        yhat = fit.runs(record)[0].y[:, 0]
        middle = SETTLED + int(np.argmax(np.abs(y - yhat)[SETTLED:]))  # the largest error
        t = slice(max(middle - DRAWN_SAMPLES // 2, SETTLED), middle + DRAWN_SAMPLES // 2)
        axes.plot(np.arange(N_UNSEEN)[t], y[t], color="black", linewidth=1.0, label="plant")
        axes.plot(np.arange(N_UNSEEN)[t], yhat[t], color="tab:blue", linewidth=1.0, label="model, free run")
        try:
            band = bands.linear(information(fit, data), record, level=0.95, noise=True)
            axes.fill_between(np.arange(N_UNSEEN)[t], band.lower[t], band.upper[t], alpha=0.2, label="95 % band")
        except InputError:
            pass
        axes.set_ylim(y.min() - np.ptp(y), y.max() + np.ptp(y))
        axes.set_title(
            f"{r['structure']} {r['seed']}, {r['default'].get(kind, np.inf):.1f} points: {given}", fontsize=7
        )
        axes.set_ylabel("y")
    panels[0].legend(fontsize=8, ncols=3)
    panels[-1].set_xlabel("sample")
    figure.savefig(path, dpi=110)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """Median, 90 % and worst loss and the share above 3 points, by kind, structure and objective; the worst cases."""
    if options.figure:
        draw(rows, options.figure, options.memory)
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
                            f"{100 * np.mean(x > BAD):3.0f} %  worst {x.max():7.1f}  {seconds:.2f} s CPU  "
                            f"bands {shares}, {100 * np.mean(held[:, 1] < ENOUGH):.0f} %"
                        )
        told, lost = said(rows, kind)
        lines.append(f"{kind:12s} said: {told} of {lost}")
    pairs = [pair for r in rows for pair in r["default"].get("named", [])]
    shapes, others = [p for p in pairs if p[0]], [p for p in pairs if not p[0]]
    right, other = (sum(b == a for a, b in shapes), sum(b not in (a, "") for a, b in shapes))
    lines.append(
        f"named: {right} of {len(shapes)} shapes, {other} as another one; {sum(b != '' for _, b in others)} of "
        f"{len(others)} maps that are none"
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
