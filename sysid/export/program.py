"""A fit as the exporters take it, a program: units with their code, wired from input to output, and offsets of levels.

A nonlinear ARX network is one unit: the same text in C99 and Python, and its equations. Its state: the last na outputs
and the last nk + nb - 1 inputs, latest first, and 1 after the run has diverged. A new run starts from zeros, as
`NlarxFit.simulate` does for an input alone.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from sysid.base.errors import InputError
from sysid.block.writing import Code, Writer, number
from sysid.estimation.free_run import resting_theta
from sysid.estimation.result import Fit
from sysid.model.wiring import Layer, Unit, layers, offsets, written
from sysid.nlarx.result import NlarxFit

AnyFit = Fit | NlarxFit
Offset = float | np.ndarray | None
NETWORK = "network"


@dataclass(frozen=True)
class Program:
    """Layers of units, the code of each unit by its name, and what is taken off u (nu,) and put on y (ny,)."""

    layers: tuple[Layer, ...]
    codes: dict[str, Code]
    u_offset: np.ndarray
    y_offset: np.ndarray


def program(fit: AnyFit, way: str, u_offset: Offset = None, y_offset: Offset = None) -> Program:
    """The fit in `way`, "c" or "python"; offsets are those of the fit unless others are given.

    Raises InputError for a block without a formula, and for numbers that are not finite.
    """
    u0, y0 = level_offsets(fit, u_offset, y_offset)
    if isinstance(fit, NlarxFit):
        if not network_is_finite(fit):
            raise InputError("a parameter of this model is not finite; fit it again before writing it out")
        return Program(network_layers(fit), {NETWORK: network_code(fit, way)}, u0, y0)
    fit_layers = layers(fit.model, resting_theta(fit.model, fit.theta))  # the run of `Fit.simulate` for an input alone
    codes = {u.name: written(u, way)(u.theta) for layer in fit_layers for row in layer for u, _ in row}
    return Program(fit_layers, codes, u0, y0)


def level_offsets(fit: AnyFit, u_offset: Offset = None, y_offset: Offset = None) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (nu,) and (ny,): those given, else those of the fit, else zero."""
    n_in, n_out = channel_counts(fit)
    fit_offsets = (fit.u_offset, fit.y_offset)
    u0, y0 = (0.0 if o is None else o for o in fit_offsets)
    return (
        offsets(u0 if u_offset is None else u_offset, n_in, "u_offset"),
        offsets(y0 if y_offset is None else y_offset, n_out, "y_offset"),
    )


def channel_counts(fit: AnyFit) -> tuple[int, int]:
    """Number of inputs and of outputs."""
    return (1, 1) if isinstance(fit, NlarxFit) else fit.model.channels


@dataclass(frozen=True)
class _NetworkBlock:
    """What the wiring asks of a block."""

    channels: tuple[int, int] = (1, 1)


def network_layers(fit: NlarxFit) -> tuple[Layer, ...]:
    """The network as a chain of one unit."""
    return ((((Unit(NETWORK, cast(Any, _NetworkBlock()), fit.theta), 0),),),)


def network_code(fit: NlarxFit, way: str) -> Code:
    """Body of the exported function of x in `way`, "c" or "python"."""
    model, network = fit.model, fit.network
    past = model.nk + model.nb - 1 if model.nb else 0
    lines = (_network_in_c if way == "c" else _network_in_python)(fit, _regressors(fit), model.na, past)
    tables = {"L": fit.theta[1 : 1 + network.n]}
    if network.units and network.m:
        units = fit.theta[1 + network.n :].reshape(network.units, network.m + 2)
        tables |= {"T": network.T.ravel(), "S": units[:, 0], "B": units[:, 1], "C": units[:, 2:].ravel()}
    return Code("\n".join(lines), model.na + past + 1, tables)


def _regressors(fit: NlarxFit) -> list[str]:
    """Each regressor less its mean."""
    model = fit.model
    names = [f"s[{i}]" for i in range(model.na)]
    names += [f"s[{model.na + lag - 1}]" if lag else "x" for lag in range(model.nk, model.nk + model.nb)]
    return [f"{name} - ({number(mu)})" for name, mu in zip(names, fit.network.mu, strict=True)]


def _network_in_python(fit: NlarxFit, regressors: list[str], na: int, past: int) -> list[str]:
    n, m, units = fit.network.n, fit.network.m, fit.network.units
    lines = [
        f"d = [{', '.join(regressors)}]",
        f"y = {number(fit.theta[0])}",
        f"for i in range({n}):",
        "    y = y + L[i] * d[i]",
    ]
    if units and m:
        lines += [
            f"c = [0.0] * {m}",
            f"for j in range({m}):",
            f"    for i in range({n}):",
            f"        c[j] = c[j] + T[{n} * j + i] * d[i]",
            f"for k in range({units}):",
            "    z = 0.0",
            f"    for j in range({m}):",
            f"        z = z + (c[j] - C[{m} * k + j]) * (c[j] - C[{m} * k + j])",
            "    z = B[k] * B[k] * z",
            "    g = math.exp(-0.5 * z)",
            f"    if k < {fit.network.wavelets}:  # wavelets, then scaling functions",
            f"        g = ({m} - z) * g",
            "    y = y + S[k] * g",
        ]
    lines += [
        f"if s[{na + past}] != 0.0 or not abs(y) <= {number(fit.limit)}:  # the run has diverged",
        f"    s[{na + past}] = 1.0",
        "    y = math.inf",
    ]
    lines += [f"s[0:{na}] = [y] + s[0:{na - 1}]"] if na else []
    lines += [f"s[{na}:{na + past}] = [x] + s[{na}:{na + past - 1}]"] if past else []
    return [*lines, "return y"]


def _network_in_c(fit: NlarxFit, regressors: list[str], na: int, past: int) -> list[str]:
    n, m, units = fit.network.n, fit.network.m, fit.network.units
    lines = [
        f"const double d[{n}] = {{{', '.join(regressors)}}};",
        f"double y = {number(fit.theta[0])};",
        f"for (int i = 0; i < {n}; ++i) y += L[i] * d[i];",
    ]
    if units and m:
        lines += [
            f"double c[{m}] = {{0.0}};",
            f"for (int j = 0; j < {m}; ++j)",
            f"    for (int i = 0; i < {n}; ++i) c[j] += T[{n} * j + i] * d[i];",
            f"for (int k = 0; k < {units}; ++k) {{",
            "    double z = 0.0;",
            f"    for (int j = 0; j < {m}; ++j) z += (c[j] - C[{m} * k + j]) * (c[j] - C[{m} * k + j]);",
            "    z = B[k] * B[k] * z;",
            "    double g = exp(-0.5 * z);",
            f"    if (k < {fit.network.wavelets}) g = ({m} - z) * g; /* wavelets, then scaling functions */",
            "    y += S[k] * g;",
            "}",
        ]
    lines += [
        f"if (s[{na + past}] != 0.0 || !(fabs(y) <= {number(fit.limit)})) {{ /* the run has diverged */",
        f"    s[{na + past}] = 1.0;",
        "    y = INFINITY;",
        "}",
    ]
    for first, count, value in ((0, na, "y"), (na, past, "x")):
        if count > 1:
            lines.append(f"for (int i = {first + count - 1}; i > {first}; --i) s[i] = s[i - 1];")
        lines += [f"s[{first}] = {value};"] if count else []
    return [*([] if "x" in " ".join(regressors) or past else ["(void)x;"]), *lines, "return y;"]


def network_equations(fit: NlarxFit, digits: int | None) -> list[str]:
    """The network in formulas: regressors, coordinates of the units, output."""
    network, model = fit.network, fit.model
    w = Writer("u", "y", digits)
    names = [f"{name[0]}(t-{name[1:]})" for name in model.regressors]
    centred = [f"({w.sum([(1.0, r), (-float(mu), '')])})" for r, mu in zip(names, network.mu, strict=True)]
    theta = fit.theta
    lines = ["network:"]
    for j, row in enumerate(network.T if network.units else (), 1):
        lines.append(f"x{j}(t) = {w.sum(list(zip(row.tolist(), centred, strict=True)))}")
    terms = []
    for k, index in enumerate(network.dilations, 1):
        centre = theta[index + 1 : index + 1 + network.m]
        r2 = " + ".join(f"{Writer(f'x{j}(t)', '', digits).minus(float(c))}^2" for j, c in enumerate(centre, 1))
        lines.append(f"z{k}(t) = {w.num(theta[index] ** 2)}*({r2})")
        shape = f"({network.m} - z{k}(t))*" if k <= network.wavelets else ""
        terms.append((float(theta[index - 1]), f"{shape}exp(-z{k}(t)/2)"))
    linear = list(zip(theta[1 : 1 + network.n].tolist(), centred, strict=True))
    lines.append(f"y(t) = {w.sum([(float(theta[0]), ''), *linear, *terms])}")
    return lines


def network_is_finite(fit: NlarxFit) -> bool:
    """Whether the network can be written as text."""
    return bool(np.all(np.isfinite(fit.theta)) and np.isfinite(fit.limit))
