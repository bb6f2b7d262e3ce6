"""How often the intervals of poles, gains, curves and outputs hold the truth, and how far poles are off the bound.

Plants of orders 1 to 4 in five structures are fitted with the model that they are, so nothing but the noise stands
between the fit and the truth. Noise is white or AR(1). Each row of the table is a plant under a noise; the percentages
are of all quantities of a kind over all records, with the standard error over records. Poles whose interval is
unbounded, because a zero cancels them within the accuracy of the record, are counted apart. "pole / bound" is the RMSE
over the bound of least squares at the true covariance of the noise (white: Cramer-Rao) of the worst pole whose bound is
below a tenth of its distance to the circle; in brackets of all poles, where there is none.

    python scripts/study.py interval_coverage --seeds 0:200 --lags auto
    python scripts/study.py interval_coverage --plants wiener4 --noises 0 --start truth --figure calibration.png
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from study import MISSING, Row, Study, markdown

from sysid.base.poles import pairs
from sysid.blocks import PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.noise_model import NoiseModel
from sysid.excitations import Aprbs
from sysid.model.chain import Chain
from sysid.structures.hammerstein import hammerstein
from sysid.structures.hammerstein_wiener import hammerstein_wiener
from sysid.structures.output_error import output_error
from sysid.structures.wiener import wiener
from sysid.structures.wiener_hammerstein import wiener_hammerstein
from sysid.uncertainty import bands, curves, intervals
from sysid.uncertainty.information import Information, information, information_at

LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
KINDS = ("poles", "gain", "curves", "outputs")
_BENT = [-1.5, -0.5, 0.6, 1.6, -1.0, -0.6, 0.7, 1.2]  # x and y of four knots


@dataclass(frozen=True)
class Plant:
    chain: Chain
    theta: np.ndarray


def _filter(poles, nb=None, gain=1.0):
    """b (nb,), f (n,) and a state at rest, with these poles and this gain."""
    f = np.real(np.poly(poles))
    b = np.array([1.0, -0.4, 0.2, 0.1])[: nb or len(poles)]
    return [*(gain * b * f.sum() / b.sum()), *f[1:]]


def plants() -> dict[str, Plant]:
    """Name -> plant: its structure and its number of poles."""
    pair, slow = [0.8 + 0.3j, 0.8 - 0.3j], [0.95 + 0.1j, 0.95 - 0.1j]
    four, weak = [*slow, 0.5 + 0.5j, 0.5 - 0.5j], [*slow, 0.7, 0.4]  # the record hardly shows the last two of `weak`
    map4 = PiecewiseLinear(knots=4)
    structures = {
        "oe1": (output_error(1, 1, 1), _filter([0.9])),
        "oe2": (output_error(2, 2, 1), _filter(pair)),
        "oe4": (output_error(4, 4, 1), _filter(four)),
        "oe4_weak": (output_error(4, 4, 1), _filter(weak)),
        "hammerstein2": (hammerstein(2, 2, 1, map4), [*_BENT, *_filter([0.95, 0.8])]),
        "wiener3": (wiener(3, 3, 1, map4), [*_filter([*pair, 0.9]), "x0", *_BENT]),
        "wiener4": (wiener(4, 4, 1, map4), [*_filter(four), "x0", *_BENT]),
        "wiener4_weak": (wiener(4, 4, 1, map4), [*_filter(weak), "x0", *_BENT]),
        "hw2": (hammerstein_wiener(2, 2, 1, "saturation", map4), [-1.0, 1.4, *_filter(pair), "x0", *_BENT]),
        "hw3": (hammerstein_wiener(3, 3, 1, "saturation", map4), [-1.0, 1.4, *_filter([*slow, 0.6]), "x0", *_BENT]),
        "wh2": (
            wiener_hammerstein(1, 1, 1, middle=map4),
            [*_filter([0.9]), "x0", *_BENT, *_filter([0.6]), "x0"],
        ),
    }
    return {name: Plant(chain, _at_rest(chain, parameters)) for name, (chain, parameters) in structures.items()}


def _at_rest(chain, parameters):
    """theta with zeros for the initial states."""
    theta = np.zeros(len(chain.names))
    theta[~chain.initial] = [v for v in parameters if v != "x0"]
    return theta


def record(plant: Plant, seed: int, memory: float, N: int, noise: float):
    """A record of a span of 2 with steps of 1 to 20 samples, its noise-free output, and the deviation of the noise."""
    rng = np.random.default_rng([seed, 613])
    u = Aprbs(2.0, 1.0, 20.0).generate(N, 1.0, rng)
    y = plant.chain.simulate(plant.theta, u)
    size = noise * float(y.std())
    e = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(N + 300))[300:]
    return IOData(u, y + size * e, 1.0), y, size


def bound_at_truth(plant: Plant, data: IOData, memory: float, size: float) -> Information:
    """The covariance of least squares at the truth with the true covariance of the noise."""
    noise_model = NoiseModel(np.array([1.0, -memory]), size**2 * (1 - memory**2))
    return information_at(plant.chain, plant.theta, data, noise=noise_model)


def score(case: tuple[str, float, int], options: argparse.Namespace) -> Row:
    """For every way and level the share of quantities that hold by kind, and the pole errors over the bound."""
    name, memory, seed = case
    plant = plants()[name]
    data, y, size = record(plant, seed, memory, options.samples, options.noise)
    starts = int(options.starts) if options.starts.isdigit() else options.starts
    fit = fit_chain(plant.chain, data, **({"start": plant.theta} if options.start == "truth" else {"starts": starts}))
    true = bound_at_truth(plant, data, memory, size)
    row = {"held": {}, "warned": list(fit.warnings), "mse": fit.criteria.mse / size**2}
    for way in map(_way, options.lags):
        info = true_at(fit, data, memory, size) if way == "true" else information(fit, data, way)
        row["held"][str(way)] = [_shares_that_hold(plant, true, info, level, y) for level in LEVELS]
    roots, fitted_poles = intervals.poles(true), fit.poles
    true_index, fit_index = pairs(np.array([z.value for z in roots]), fitted_poles)
    row["off"] = [
        float(abs(fitted_poles[i] - roots[k].value) / roots[k].std) for k, i in zip(true_index, fit_index, strict=True)
    ]
    row["bound"] = [z.std / max(1.0 - abs(z.value), 1e-12) for z in roots]
    row["poles"] = [[z.real, z.imag] for z in fitted_poles[fit_index].tolist()]
    return row


def true_at(fit, data, memory, size):
    """The same covariance at the fit: what an interval could be if the noise were known."""
    noise_model = NoiseModel(np.array([1.0, -memory]), size**2 * (1 - memory**2))
    return information_at(fit.model, fit.theta, data, noise=noise_model, n_init=fit.n_init)


def _shares_that_hold(
    plant: Plant, true: Information, info: Information, level: float, y: np.ndarray
) -> dict[str, float]:
    """The share of each kind of quantity whose interval holds, and of poles left open."""
    out = {}
    roots, true_roots = intervals.poles(info, level), intervals.poles(true, level)
    index, true_index = pairs(np.array([z.value for z in roots]), np.array([z.value for z in true_roots]))
    poles = []
    for a, b in ((roots[i], true_roots[k]) for i, k in zip(index, true_index, strict=True)):
        if b.value.imag < 0:
            continue
        if not np.isfinite(a.real.lower):
            continue
        poles.append(_in(a.real, b.value.real))
        if b.value.imag > 0:
            poles.append(_in(a.imag, b.value.imag))
        poles.append(_in(a.time_constant, b.time_constant.value))
    out["poles"] = float(np.mean(poles)) if poles else np.nan
    out["open"] = float(np.mean([not np.isfinite(z.real.lower) for z in roots]))
    out["gain"] = float(_in(intervals.gain(info, 0.2, level), intervals.gain(true, 0.2).value))
    maps = []
    for c in curves.curves(true, points=13):
        band = curves.curve(info, c.role, c.band.x[1:-1], level=level).band
        moves = c.band.std[1:-1] > 1e-9  # a saturation's slope of one is not estimated
        values = c.band.value[1:-1]
        maps += ((band.lower <= values) & (values <= band.upper))[moves].tolist()
    out["curves"] = float(np.mean(maps)) if maps else np.nan
    run = bands.linear(info, level=level)
    out["outputs"] = float(np.mean(((run.lower <= y) & (y <= run.upper))[37::47]))
    return out


def _in(interval, true) -> bool:
    return bool(interval.lower <= true <= interval.upper)


def table(rows: dict, ways) -> str:
    """A row for each plant, noise and way."""
    headings, lines = ["plant", "noise", "intervals", "n", *KINDS, "poles left open", "pole / bound"], []
    for (name, memory), group in rows.items():
        for way in ways:
            cells = []
            for kind in KINDS:
                share = np.array([r["held"][str(way)][LEVELS.index(0.95)][kind] for r in group])
                if np.isnan(share).all():
                    cells.append(MISSING)
                    continue
                share = share[~np.isnan(share)]
                spread = share.std(ddof=1) / np.sqrt(len(share)) if len(share) > 1 else np.nan
                cells.append(f"{100 * share.mean():.1f} ± {100 * spread:.1f}")
            open_share = np.mean([r["held"][str(way)][LEVELS.index(0.95)]["open"] for r in group])
            pole_errors = np.sqrt(np.mean(np.square([r["off"] for r in group]), axis=0))
            near = np.median([r["bound"] for r in group], axis=0) < 0.1
            worst = f"{pole_errors[near].max():.2f}" if near.any() else f"({pole_errors.max():.2f})"
            colour = f"AR(1) {memory:g}" if memory else "white"
            cells += [f"{100 * open_share:.0f} %", worst]
            lines.append([name, colour, way, len(group), *cells])
    return markdown(headings, lines)


def draw(rows: dict, ways, path: Path) -> None:
    """Held share over nominal level, one panel a kind of quantity and one line a plant and noise."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    fig, axes = plt.subplots(len(ways), len(KINDS), figsize=(3.2 * len(KINDS), 3.1 * len(ways)), squeeze=False)
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.85, len({m for _, m in rows})))
    colour_of = dict(zip(sorted({m for _, m in rows}), colours, strict=True))
    for line, way in zip(axes, ways, strict=True):
        for ax, kind in zip(line, KINDS, strict=True):
            ax.plot([0.45, 1], [0.45, 1], color="0.7", linewidth=0.8)
            for (_, memory), group in rows.items():
                shares = [np.nanmean([r["held"][str(way)][k][kind] for r in group]) for k in range(len(LEVELS))]
                ax.plot(LEVELS, shares, ".-", color=colour_of[memory], linewidth=0.8, label=f"AR(1) {memory:g}")
            ax.set(title=f"{kind}, lags {way}", xlabel="nominal", ylabel="held", xlim=(0.45, 1), ylim=(0.45, 1))
    labels = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
    axes[0, 0].legend(labels.values(), labels.keys(), fontsize=7)
    fig.tight_layout()
    fig.savefig(path, dpi=110)


def cases(options: argparse.Namespace) -> list[tuple[str, float, int]]:
    """Plants, noises and seeds."""
    return [(name, memory, seed) for name in options.plants for memory in options.noises for seed in options.seeds]


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """The table, and the figure if asked for."""
    groups: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row["case"][:2]), []).append(row)
    ways = [_way(text) for text in options.lags]
    if options.figure:
        draw(groups, ways, options.figure)
    return table(groups, ways)


def _way(text: str):
    """What `information` takes for its lags."""
    return None if text == "white" else int(text) if text.isdigit() else text


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:40",
    options={
        "--plants": {"nargs": "+", "default": list(plants())},
        "--noises": {"nargs": "+", "type": float, "default": [0.0, 0.5, 0.8], "help": "AR(1) coefficients"},
        "--samples": {"type": int, "default": 2000},
        "--noise": {"type": float, "default": 0.03, "help": "deviation of the noise over that of the output"},
        "--lags": {"nargs": "+", "default": ["auto"], "help": "white, auto, a number, or true (known noise)"},
        "--start": {"choices": ("truth", "search"), "default": "truth"},
        "--starts": {"default": "1", "help": "of a search: a number or auto"},
        "--figure": {"type": Path},
    },
)
