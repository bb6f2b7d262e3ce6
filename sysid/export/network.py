"""A nonlinear ARX network as one unit for the exporters: the same text in C99 and Python, and its equations.

Its state: the last na outputs and the last nk + nb - 1 inputs, latest first, and 1 after the run has diverged. A new
run starts from zeros, as `NlarxFit.simulate` does for an input alone.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from sysid.block.writing import Code, Writer, number
from sysid.model.wiring import Layer, Unit
from sysid.nlarx.result import NlarxFit

NAME = "network"


@dataclass(frozen=True)
class _Place:
    """What the wiring asks of a block."""

    channels: tuple[int, int] = (1, 1)


def wiring(fit: NlarxFit) -> tuple[Layer, ...]:
    """The network as a chain of one unit."""
    return ((((Unit(NAME, cast(Any, _Place()), fit.theta), 0),),),)


def code(fit: NlarxFit, way: str) -> Code:
    """Body of the exported function of x in `way`, "c" or "python"."""
    model, network = fit.model, fit.network
    past = model.nk + model.nb - 1 if model.nb else 0
    lines = (_c if way == "c" else _python)(fit, _regressors(fit), model.na, past)
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


def _python(fit: NlarxFit, regressors: list[str], na: int, past: int) -> list[str]:
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


def _c(fit: NlarxFit, regressors: list[str], na: int, past: int) -> list[str]:
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


def equations(fit: NlarxFit, digits: int | None) -> list[str]:
    """The network in formulas: regressors, coordinates of the units, output."""
    network, model = fit.network, fit.model
    w = Writer("u", "y", digits)
    names = [f"{name[0]}(t-{name[1:]})" for name in model.regressors]
    shifted = [f"({w.sum([(1.0, r), (-float(mu), '')])})" for r, mu in zip(names, network.mu, strict=True)]
    theta = fit.theta
    lines = ["network:"]
    for j, row in enumerate(network.T if network.units else (), 1):
        lines.append(f"x{j}(t) = {w.sum(list(zip(row.tolist(), shifted, strict=True)))}")
    terms = []
    for k, at in enumerate(network.dilations, 1):
        centre = theta[at + 1 : at + 1 + network.m]
        r2 = " + ".join(f"{Writer(f'x{j}(t)', '', digits).minus(float(c))}^2" for j, c in enumerate(centre, 1))
        lines.append(f"z{k}(t) = {w.num(theta[at] ** 2)}*({r2})")
        shape = f"({network.m} - z{k}(t))*" if k <= network.wavelets else ""
        terms.append((float(theta[at - 1]), f"{shape}exp(-z{k}(t)/2)"))
    linear = list(zip(theta[1 : 1 + network.n].tolist(), shifted, strict=True))
    lines.append(f"y(t) = {w.sum([(float(theta[0]), ''), *linear, *terms])}")
    return lines


def finite(fit: NlarxFit) -> bool:
    """Whether the network can be written as text."""
    return bool(np.all(np.isfinite(fit.theta)) and np.isfinite(fit.limit))
