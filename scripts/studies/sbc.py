"""Whether true values are spread as the reported distributions say: simulation-based calibration.

Of every case one value of each kind is drawn: a pole (real or imaginary part), the static gain, a map at a place
that its signal meets, a sample of the noise-free free run from rest on an input that the fit has not seen; of a joint,
every physical value. The probability integral transform of the true value, F((true - value) / std) with the
distribution that intervals use, is uniform on (0, 1) if the report is right (Dawid 1984, J. R. Stat. Soc. A 147). Its
empirical distribution is compared with a band that holds all of it in 95 % of the samples of a uniform variable:
binomial limits at 99 places, whose common level is found by simulation (Saeilynoja, Buerkner, Vehtari 2022, Stat.
Comput. 32, section 2). "open" are values that the report gives no distribution, with its reason in --reasons.

The prior: one to three poles, of Wiener-Hammerstein one in each filter; time constants log-uniform, 2 to 30 samples;
two poles are a pair of angle 0.1 to 1 with probability 1/2; coefficients of B normal, so that zeros fall anywhere, also
on poles; filters scaled to the deviation of their output; maps of four knots whose slopes are log-normal with
deviation 0.7, saturations from -1.4 to -0.6 and 0.6 to 1.4; noise 1 to 10 % of the output, log-uniform, white or AR(1);
1000 samples of an input of steps. The fit is that of the structure, as it comes. Joints are legs drawn within 40 % of
nominal, from two logs of the twin with all its imperfections (`drawn_joints`), whose noise is that of its converter.

    python scripts/study.py sbc --seeds 0:500 --workers 2 --out runs/sbc.jsonl --figure sbc.png --counts sbc.json
    python scripts/study.py sbc --structures actuated_joint --seeds 0:50 --out runs/sbc.jsonl
"""

import argparse
import json
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.special import stdtr
from scipy.stats import binom, norm
from study import Row, Study, markdown

import twin
from sysid.base.files import write_text
from sysid.base.poles import pairs
from sysid.blocks import PiecewiseLinear
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.excitations import Aprbs
from sysid.joint.values import distinct_values, joint_values
from sysid.model.chain import Chain
from sysid.report.release import LEVELS, intervals_grid
from sysid.structures.hammerstein import hammerstein
from sysid.structures.hammerstein_wiener import hammerstein_wiener
from sysid.structures.output_error import output_error
from sysid.structures.wiener import wiener
from sysid.structures.wiener_hammerstein import wiener_hammerstein
from sysid.uncertainty import bands, curves, intervals
from sysid.uncertainty.information import Information, information, information_at

SAMPLES, UNSEEN, SETTLED = 1000, 300, 20
KNOTS = np.array([-1.5, -0.5, 0.5, 1.5])
PLACES = np.arange(1, 100) / 100.0  # of the empirical distribution
KNOWN = 1e-9  # deviation of a value that no record has to tell: a saturation's slope of one
JOINT = "actuated_joint"
TWIN = "the twin's"
KINDS = ("pole", "gain", "map", "output")  # of chains, in the order of the table


def draw_filter(n: int, u: np.ndarray, rng: np.random.Generator) -> tuple[list[float], np.ndarray]:
    """b (n,) and f (n,) of n poles, whose output under u has the deviation 1, and this output."""
    poles: list[complex] = []
    while len(poles) < n:
        modulus = np.exp(-1.0 / np.exp(rng.uniform(np.log(2.0), np.log(30.0))))
        angle = rng.uniform(0.1, 1.0)
        pair = n - len(poles) >= 2 and rng.random() < 0.5
        poles += [modulus * np.exp(1j * angle), modulus * np.exp(-1j * angle)] if pair else [modulus]
    f, b = np.real(np.poly(poles)), rng.standard_normal(n)
    y = lfilter([0.0, *b], f, u)
    return [*(b / y.std()), *f[1:]], y / y.std()


def draw_map(rng: np.random.Generator) -> list[float]:
    """Places and values of four knots."""
    y = np.concatenate([[0.0], np.cumsum(np.exp(0.7 * rng.standard_normal(3)))])
    return [*KNOTS, *(y - y.mean())]


def draw_plant(structure: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Chain, np.ndarray]:
    """A chain of this structure and its parameters (P,), at rest."""
    n, bent = int(rng.integers(1, 4)), PiecewiseLinear(knots=4)
    if structure == "output_error":
        chain, theta = output_error(n, n, 1), draw_filter(n, u, rng)[0]
    elif structure == "hammerstein":
        chain, knots = hammerstein(n, n, 1, bent), draw_map(rng)
        theta = [*knots, *draw_filter(n, np.interp(u, knots[:4], knots[4:]), rng)[0]]
    elif structure == "wiener":
        chain, theta = wiener(n, n, 1, bent), [*draw_filter(n, u, rng)[0], *draw_map(rng)]
    elif structure == "hammerstein_wiener":
        ends = [-rng.uniform(0.6, 1.4), rng.uniform(0.6, 1.4)]
        chain = hammerstein_wiener(n, n, 1, "saturation", bent)
        theta = [*ends, *draw_filter(n, np.clip(u, *ends), rng)[0], *draw_map(rng)]
    else:
        chain, (first, w), knots = wiener_hammerstein(1, 1, 1, middle=bent), draw_filter(1, u, rng), draw_map(rng)
        theta = [*first, *knots, *draw_filter(1, np.interp(w, knots[:4], knots[4:]), rng)[0]]
    full = np.zeros(len(chain.names))
    full[~chain.initial] = theta
    return chain, full


STRUCTURES = ("output_error", "hammerstein", "wiener", "hammerstein_wiener", "wiener_hammerstein")


def score(case: tuple[str, float, int], options: argparse.Namespace) -> Row:
    """The transform of one value of each kind, or why there is none: {"pit": {kind: number}, "open": {kind: text}}."""
    structure, memory, seed = case
    if structure == JOINT:
        return _sorted_out(joint_readings(seed))
    rng = np.random.default_rng([seed, zlib.crc32(structure.encode()), int(100 * memory)])
    u = Aprbs(2.0, 1.0, 20.0).generate(SAMPLES, 1.0, rng)
    chain, theta = draw_plant(structure, u, rng)
    y = chain.simulate(theta, u)
    size = float(y.std()) * np.exp(rng.uniform(np.log(0.01), np.log(0.1)))
    e = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(SAMPLES + 300))[300:]
    data = IOData(u, y + size * e, 1.0)
    fit = fit_chain(chain, data)
    row = _sorted_out(readings(information(fit, data), information_at(chain, theta, data), rng))
    return {**row, "mse": fit.criteria.mse / size**2, "warned": list(fit.warnings)}


def readings(info: Information, true: Information, rng: np.random.Generator) -> dict[str, tuple[float, str]]:
    """(transform, reason why there is none) by kind."""
    out = {}
    roots, true_roots = intervals.poles(info), intervals.poles(true)
    index, true_index = pairs(np.array([z.value for z in roots]), np.array([z.value for z in true_roots]))
    k = rng.choice([k for k, j in enumerate(true_index) if true_roots[j].value.imag >= 0.0])
    root, z = roots[index[k]], true_roots[true_index[k]].value
    part = (root.imag, z.imag) if z.imag > 0.0 and rng.random() < 0.5 else (root.real, z.real)
    out["pole"] = transform(info, part[0], part[1], root.note)
    gain = intervals.gain(info, 0.2)
    out["gain"] = transform(info, gain, intervals.gain(true, 0.2).value, gain.note)
    if places := [(c, k) for c in curves.curves(true, points=13) for k in range(1, 12) if c.band.std[k] > KNOWN]:
        curve, k = places[rng.integers(len(places))]
        fitted = curves.curve(info, curve.role, curve.band.x[k : k + 1]).band
        out["map"] = transform(info, _at(fitted, 0), curve.band.value[k], fitted.note)
    u = Aprbs(2.0, 1.0, 20.0).generate(UNSEEN, 1.0, rng)
    run, t = bands.linear(info, u), int(rng.integers(SETTLED, UNSEEN))
    out["output"] = transform(info, _at(run, t), true.chain.simulate(true.theta, u)[t], run.note)
    return out


def _at(band: Any, k: int) -> intervals.Interval:
    value = band.value if hasattr(band, "value") else band.y
    return intervals.Interval(value[k], band.std[k], band.lower[k], band.upper[k])


def transform(info: Information, own: intervals.Interval, true: float, note: str) -> tuple[float, str]:
    """F((true - value) / std) of Student's t; nan with the reason of the report where it gives no interval."""
    if not np.isfinite(own.upper) or own.std == 0.0:
        return np.nan, note or own.note or "a deviation of 0"
    return float(stdtr(info.dof, (true - own.value) / own.std)), ""


def joint_readings(seed: int) -> dict[str, tuple[float, str]]:
    """(transform, reason) of every physical value of a drawn leg's joint."""
    from drawn_joints import TS, joint_of

    from twin.studies.beyond import twin_truth

    joint = twin.JOINTS[seed % len(twin.JOINTS)]
    p, data, fit, _ = joint_of(joint, seed)
    true, out = twin_truth(joint, TS, p), {}
    for value in distinct_values(joint_values(fit, 0.95, data, p["pot_linearity"] * p["pot_range"])):
        if value.high is None:
            out[value.name] = (np.nan, re.sub(r"[\d.−]+", "#", value.why.partition(";")[0]))
        else:  # the lower limit may be cut off
            std = (value.high - value.value) / norm.ppf(0.975)
            out[value.name] = (float(norm.cdf((true[value.name] - value.value) / std)), "")
    return out


def _sorted_out(values: dict[str, tuple[float, str]]) -> Row:
    return {
        "pit": {kind: pit for kind, (pit, _) in values.items() if np.isfinite(pit)},
        "open": {kind: why for kind, (pit, why) in values.items() if not np.isfinite(pit)},
    }


def local_level(n: int, samples: int = 4000) -> float:
    """The level of binomial limits at each of `PLACES` outside of which 5 % of uniform samples of size n ever are."""
    rng = np.random.default_rng(n)
    counts = np.array([np.searchsorted(np.sort(rng.random(n)), PLACES) for _ in range(samples)])
    return float(np.quantile(tails(counts, n).min(axis=1), 0.05))


def tails(counts: np.ndarray, n: int) -> np.ndarray:
    """Two-sided binomial probability of these counts (..., 99) below `PLACES`."""
    below, above = binom.cdf(counts, n, PLACES), binom.sf(counts - 1, n, PLACES)
    return np.minimum(2.0 * np.minimum(below, above), 1.0)


def figures_of(pit: list[float]) -> dict[str, Any]:
    """n, largest departure of the empirical distribution, whether it stays in the band, and shares held by `LEVELS`."""
    values = np.sort(pit)
    counts = np.searchsorted(values, PLACES, side="right")
    held = [float(np.mean(np.abs(2.0 * values - 1.0) <= level / 100)) for level in LEVELS]
    inside = bool(tails(counts, len(values)).min() >= local_level(len(values)))
    return {
        "n": len(values),
        "departure": float(np.abs(counts / len(values) - PLACES).max()),
        "inside": inside,
        "held": held,
    }


LEAST = 10  # values, below which there is no distribution to look at


def counts(rows: list[Row]) -> list[dict[str, Any]]:
    """A row for each structure, noise and kind: `figures_of` with the number of values that are left open."""
    table = []
    for structure, memory in dict.fromkeys(tuple(row["case"][:2]) for row in rows):
        group = [row for row in rows if tuple(row["case"][:2]) == (structure, memory)]
        noise = TWIN if structure == JOINT else f"AR(1), {memory:g}" if memory else "white"
        kinds = {kind for row in group for kind in (*row["pit"], *row["open"])}
        for kind in sorted(kinds, key=lambda kind: (KINDS.index(kind) if kind in KINDS else 0, kind)):
            pit = [row["pit"][kind] for row in group if kind in row["pit"]]
            entry = {"structure": structure, "noise": noise, "kind": kind}
            entry["open"] = sum(kind in row["open"] for row in group)
            table.append({**entry, **(figures_of(pit) if len(pit) >= LEAST else {"n": len(pit)})})
    return table


def draw(rows: list[Row], path: Path) -> None:
    """Differences of all empirical distributions from the uniform one, one panel a kind, with the band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    *panels, joint, beside = figure.subplots(2, 3).ravel()
    beside.axis("off")
    for ax, kind in zip(panels, KINDS, strict=True):
        lines: dict[tuple[str, float], list[float]] = {}
        for row in rows:
            if row["case"][0] != JOINT and kind in row["pit"]:
                lines.setdefault(tuple(row["case"][:2]), []).append(row["pit"][kind])
        names = {key: f"{key[0].replace('_', ' ')}{f', AR(1) {key[1]:g}' if key[1] else ''}" for key in lines}
        looks = {key: ("--" if key[1] else "-", f"C{STRUCTURES.index(key[0])}") for key in lines}
        _panel(ax, kind, {names[key]: (pit, *looks[key]) for key, pit in lines.items()})
    known = {handle.get_label(): handle for ax in panels for handle in ax.get_lines() if handle.get_label()[0] != "_"}
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=5, fontsize=8)
    values: dict[str, list[float]] = {}
    for row in rows:
        for kind, pit in row["pit"].items() if row["case"][0] == JOINT else ():
            values.setdefault(kind, []).append(pit)
    _panel(joint, "joints", {k.replace("_", " "): (v, "-", f"C{n % 10}") for n, (k, v) in enumerate(values.items())})
    beside.legend(*joint.get_legend_handles_labels(), fontsize=8, loc="center left")
    figure.savefig(path, dpi=100)


def _panel(ax: Any, title: str, lines: dict[str, tuple[list[float], str, str]]) -> None:
    """One line for each name: its values, its style and its colour; the band is that of the median size."""
    lines = {name: line for name, line in lines.items() if len(line[0]) >= LEAST}
    if lines:
        n = int(np.median([len(pit) for pit, *_ in lines.values()]))
        half = local_level(n) / 2.0
        low, high = (limit(half, n, PLACES) / n - PLACES for limit in (binom.ppf, binom.isf))
        ax.fill_between(PLACES, low, high, color="0.9")
        ax.set_title(f"{title}, n = {n}")
    for name, (pit, style, colour) in lines.items():
        F = np.searchsorted(np.sort(pit), PLACES, side="right") / len(pit)
        ax.plot(PLACES, F - PLACES, style, color=colour, linewidth=1.2, label=name)
    ax.axhline(0.0, color="0.6", linewidth=0.8)
    ax.set(xlabel="place of the true value", ylabel="share below less place", xlim=(0, 1))


def reasons(rows: list[Row]) -> str:
    """How often each reason stands in place of a distribution."""
    found = Counter((row["case"][0], kind, why) for row in rows for kind, why in row["open"].items())
    lines = [(*key, number) for key, number in found.most_common()]
    return markdown(["structure", "value", "reason", "times"], lines, 3)


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """The table; the figure, the counts as JSON and the reasons where asked for."""
    entries = counts(rows)
    if options.figure:
        draw(rows, options.figure)
    if options.counts:
        write_text(options.counts, json.dumps(entries, indent=1) + "\n")
    return intervals_grid(entries).markdown() + (f"\n{reasons(rows)}" if options.reasons else "")


def cases(options: argparse.Namespace) -> list[tuple[str, float, int]]:
    """Structures, memories of the noise and seeds; of a joint, three seeds are its three kinds."""
    return [
        (structure, memory, seed)
        for seed in options.seeds
        for structure in options.structures
        for memory in (options.noises if structure != JOINT else [0.0])
    ]


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:500",
    options={
        "--structures": {"nargs": "+", "choices": (*STRUCTURES, JOINT), "default": [*STRUCTURES, JOINT]},
        "--noises": {"nargs": "+", "type": float, "default": [0.0, 0.8], "help": "AR(1) coefficients"},
        "--figure": {"type": Path, "help": "PNG of all differences from the uniform distribution"},
        "--counts": {"type": Path, "help": "the table as JSON"},
        "--reasons": {"action": "store_true", "help": "also why values are left open"},
    },
    selecting=("structures", "noises", "figure", "counts", "reasons"),
)
