"""How fits depend on the units of a record: each structure is fitted to one record in several units, and compared.

A change of unit is a factor, a sign or an offset of a signal, or another sampling time. The fits must be the same
fits: for a power of two and another sampling time the outputs agree to the bit, for a sign but for the rounding of a
map that is turned round, for other factors and for offsets to rounding. An offset is tried where the structure has
parameters that take it up. Joints, servos, coupled drives and motor profiles
have starts and limits in volts and angles, and are left out. Prints JSON with the number of comparisons and of those
that differ, for every change.

    python scripts/study.py unit_equivariance --seeds 0:3
    python scripts/study.py unit_equivariance --only hammerstein wiener
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from study import Study

import sysid
from sysid.blocks import STATIC, CubicSpline
from sysid.nlarx.model import Nlarx

S = sysid.structures
NEAR = 0.01  # [%] of the output's spread: fits that differ by more are not the same fit
POWERS = ("u * 2^10", "u / 2^20", "y * 2^10", "y / 2^20", "u * 2^7, y / 2^9", "Ts * 1000")
BITS = (*POWERS, "u * -1", "y * -1", "u * -1, y * -1")
FACTORS = ("u * 1000", "y * 1e-5")
OFFSETS = ("u + 7", "y - 3")
FREE = ("cubic_spline", "piecewise_linear", "polynomial", "sigmoid_network", "wavelet_network")

CASES: dict[str, Callable[[], object]] = {"output_error": lambda: S.output_error(2, 2, 1)}
CASES |= {f"hammerstein {name}": lambda name=name: S.hammerstein(2, 2, 1, input=name) for name in STATIC}
CASES |= {f"wiener {name}": lambda name=name: S.wiener(2, 2, 1, output=name) for name in STATIC}
CASES |= {
    "hammerstein monotone": lambda: S.hammerstein(2, 2, 1, input=CubicSpline(6, monotone=True)),
    "hammerstein_wiener": lambda: S.hammerstein_wiener(2, 3, 1),
    "hammerstein_wiener polynomial sigmoid_network": lambda: S.hammerstein_wiener(
        2, 2, 1, input="polynomial", output="sigmoid_network"
    ),
    "hammerstein_wiener cubic_spline wavelet_network": lambda: S.hammerstein_wiener(
        2, 2, 1, input="cubic_spline", output="wavelet_network"
    ),
    "hammerstein_wiener dead_zone saturation": lambda: S.hammerstein_wiener(
        2, 2, 1, input="dead_zone", output="saturation"
    ),
    "wiener_hammerstein": lambda: S.wiener_hammerstein(2, 2, 0, 2, 2, 1),
    "wiener_hammerstein polynomial": lambda: S.wiener_hammerstein(2, 2, 0, 2, 2, 1, middle="polynomial"),
    "state_space": lambda: S.state_space(2, 3),
    "state_space polynomial": lambda: S.state_space(2, 0, degree=2),
    "nlarx": lambda: Nlarx(2, 2, 1),
    "nlarx simulation": lambda: Nlarx(2, 2, 1, units=4, focus="simulation"),
    "hammerstein of two inputs": lambda: S.hammerstein(2, 2, 1, nu=2),
}


def record(seed: int, inputs: int = 1, N: int = 500) -> sysid.IOData:
    """A plant with a dead zone before a filter of two poles and a bend behind it, and a little noise."""
    rng = np.random.default_rng([seed, 5])
    u = np.repeat(rng.normal(0.3, 1.0, (N // 5, inputs)), 5, axis=0)
    x = np.where(np.abs(u) > 0.3, u - 0.3 * np.sign(u), 0.0).sum(axis=1)
    poles, y = rng.uniform(0.3, 0.85, 2), np.zeros(N)
    for t in range(2, N):
        y[t] = poles.sum() * y[t - 1] - poles.prod() * y[t - 2] + (1 - poles).prod() * (x[t - 1] + 0.3 * x[t - 2])
    y = y + 0.15 * y**2
    return sysid.IOData(u, y + 0.01 * np.std(y) * rng.standard_normal(N), 1.0)


def change_units(data: sysid.IOData, change: str) -> tuple[sysid.IOData, float, float]:
    """The record in other units, and the factor and offset of its output."""
    u, y, gain, zero = data.u, data.y, 1.0, 0.0
    for part in change.split(", "):
        if part.startswith("Ts"):
            return replace(data, Ts=1000.0 * data.Ts), 1.0, 0.0
        signal, sign, number = part.split()
        value = float(2 ** int(number[2:])) if number.startswith("2^") else float(number)
        factor = {"*": value, "/": 1.0 / value}.get(sign, 1.0)
        offset = {"+": value, "-": -value}.get(sign, 0.0)
        if signal == "u":
            u = factor * u + offset
        else:
            y, gain, zero = factor * y + offset, factor, offset
    return replace(data, u=u, y=y), gain, zero


def outputs(model, data: sysid.IOData) -> np.ndarray:
    """What the fitted model says of its own record: from its own states at the first sample, as the fit judges it."""
    fit = sysid.fit(model, data)
    if isinstance(model, Nlarx):
        return fit.predict(data) if model.focus == "prediction" else fit.simulate(data)
    return fit.model.outputs(fit.theta, data.u).ravel()


def takes(name: str, change: str) -> bool:
    """Whether a structure has parameters for this change."""
    if change not in OFFSETS:
        return True
    if name.startswith(("state_space", "nlarx")):
        return True
    if change in OFFSETS[:1]:
        return name.startswith("hammerstein") and any(kind in (*FREE, "monotone") for kind in name.split()[1:2])
    return name.startswith(("wiener ", "hammerstein_wiener ")) and name.split()[-1] in FREE


def difference(plain: np.ndarray, run: np.ndarray, gain: float, zero: float) -> tuple[float, bool]:
    """Distance of two runs [%] of the first one's spread, and whether they are the same to the bit."""
    in_plain_units = (run - zero) / gain
    with np.errstate(invalid="ignore"):
        distance = 100.0 * float(np.sqrt(np.mean((in_plain_units - plain) ** 2)) / (np.std(plain) or 1.0))
    same = bool(np.array_equal(in_plain_units, plain))
    return (0.0 if same else distance), same


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, Any]:
    """By change: the distance of the fit from that to the plain record, and whether they are the same to the bit."""
    name, seed = case
    data, row = record(seed, 2 if "two inputs" in name else 1), {}
    plain = outputs(CASES[name](), data)
    for change in options.changes:
        if takes(name, change):
            data_in_units, gain, zero = change_units(data, change)
            row[change] = difference(plain, outputs(CASES[name](), data_in_units), gain, zero)
    return {"changes": row}


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> dict[str, Any]:
    """Comparisons, how many fits differ, how many differ in a bit, the widest distance and its case, by change."""
    counts: dict[str, dict] = {
        c: {"compared": 0, "other_fit": 0, "other_bits": 0, "widest": 0.0} for c in options.changes
    }
    for row in rows:
        for change, (distance, is_equal) in row["changes"].items():
            count = counts[change]
            count["compared"] += 1
            count["other_fit"] += not distance <= NEAR
            count["other_bits"] += not is_equal
            if not distance <= count["widest"]:
                count |= {"widest": distance, "case": "{}, seed {}".format(*row["case"])}
    bits = [counts[c] for c in BITS if c in counts]
    total = {key: sum(count[key] for count in counts.values()) for key in ("compared", "other_fit")}
    exact = {"exact": sum(c["compared"] for c in bits), "other_bits": sum(c["other_bits"] for c in bits)}
    return {"changes": counts, **total, "powers_of_two_and_signs": exact}


def cases(options: argparse.Namespace) -> list[tuple[str, int]]:
    """Structures and seeds."""
    names = [name for name in CASES if not options.only or name.startswith(tuple(options.only))]
    return [(name, seed) for seed in options.seeds for name in names]


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:1",
    options={
        "--only": {"nargs": "*", "default": [], "help": "structures whose name begins so"},
        "--changes": {"nargs": "*", "default": [*BITS, *FACTORS, *OFFSETS]},
    },
    line=lambda row: "{}, seed {}".format(*row["case"]),
)
