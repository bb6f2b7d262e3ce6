"""A fit as the exporters take it, a program: units with their code, wired from input to output, and offsets of levels.

A nonlinear ARX network is one unit: its text in C99 and Python, and its equations. Its state: the last na outputs and
the last nk + nb - 1 inputs, latest first, and 1 after the run has diverged. A new run starts from zeros, as
`NlarxFit.simulate` does for an input alone.
"""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Slot
from sysid.block.writing import CCode, Code, Writer, number
from sysid.estimation.free_run import at_rest
from sysid.estimation.result import Fit
from sysid.model.wiring import Layer, Unit, layers, offsets, written
from sysid.nlarx.result import NlarxFit

AnyFit = Fit | NlarxFit
Offset = float | np.ndarray | None
NETWORK = "network"
C = TypeVar("C", Code, CCode)


@dataclass(frozen=True)
class Program(Generic[C]):
    """Layers of units, the code of each unit by its name, and what is taken off u (nu,) and put on y (ny,)."""

    layers: tuple[Layer, ...]
    codes: dict[str, C]
    u_offset: np.ndarray
    y_offset: np.ndarray


def program(fit: AnyFit, u_offset: Offset = None, y_offset: Offset = None) -> Program[Code]:
    """The fit in Python; offsets are those of the fit unless others are given.

    Raises InputError for a block without a formula, and for numbers that are not finite.
    """
    return _program(fit, "python", u_offset, y_offset)


def c_program(fit: AnyFit, u_offset: Offset = None, y_offset: Offset = None) -> Program[CCode]:
    """The same in C99."""
    return _program(fit, "c", u_offset, y_offset)


def _program(fit: AnyFit, way: str, u_offset: Offset, y_offset: Offset) -> Program[Any]:
    u0, y0 = level_offsets(fit, u_offset, y_offset)
    if isinstance(fit, NlarxFit):
        if not network_is_finite(fit):
            raise InputError("a parameter of this model is not finite; fit it again before writing it out")
        code = _network_in_c(fit) if way == "c" else _network_in_python(fit)
        return Program(network_layers(fit), {NETWORK: code}, u0, y0)
    fit_layers = layers(*at_rest(fit.model, fit.theta))  # the run of `Fit.simulate` for an input alone
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
    """What the wiring and C ask of a block."""

    names: tuple[str, ...]
    channels: tuple[int, int] = (1, 1)

    def slots(self) -> tuple[Slot, ...]:
        return tuple(Slot(name) for name in self.names)


def network_layers(fit: NlarxFit) -> tuple[Layer, ...]:
    """The network as a chain of one unit."""
    return ((((Unit(NETWORK, cast(Any, _NetworkBlock(fit.network.names)), fit.theta), 0),),),)


def _past(fit: NlarxFit) -> int:
    """Number of inputs that are kept."""
    return fit.model.nk + fit.model.nb - 1 if fit.model.nb else 0


def _regressors(fit: NlarxFit, past_y: list[str], past_u: list[str]) -> list[str]:
    """Each regressor less its mean."""
    model = fit.model
    names = past_y + [past_u[lag - 1] if lag else "x" for lag in range(model.nk, model.nk + model.nb)]
    return [f"{name} - ({number(mu)})" for name, mu in zip(names, fit.network.mu, strict=True)]


def _network_in_python(fit: NlarxFit) -> Code:
    n, m, units, na, past = fit.network.n, fit.network.m, fit.network.units, fit.model.na, _past(fit)
    tables = {"L": fit.theta[1 : 1 + n]}
    kept = [f"s[{i}]" for i in range(na + past)]
    lines = [
        f"d = [{', '.join(_regressors(fit, kept[:na], kept[na:]))}]",
        f"y = {number(fit.theta[0])}",
        f"for i in range({n}):",
        "    y = y + L[i] * d[i]",
    ]
    if units and m:
        shapes = fit.theta[1 + n :].reshape(units, m + 2)
        tables |= {"T": fit.network.T.ravel(), "S": shapes[:, 0], "B": shapes[:, 1], "C": shapes[:, 2:].ravel()}
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
    return Code("\n".join([*lines, "return y"]), na + past + 1, tables)


def _network_in_c(fit: NlarxFit) -> CCode:
    n, m, units, na, past = fit.network.n, fit.network.m, fit.network.units, fit.model.na, _past(fit)
    fields: dict[str, int | tuple[int, ...]] = {"y0": 0, "L": tuple(range(1, 1 + n))}
    tables = {}
    past_y, past_u = [f"s->past_y[{i}]" for i in range(na)], [f"s->past_u[{i}]" for i in range(past)]
    lines = [
        f"const double d[{n}] = {{{', '.join(_regressors(fit, past_y, past_u))}}};",
        "double y = p->y0;",
        f"for (int i = 0; i < {n}; ++i) y += p->L[i] * d[i];",
    ]
    if units and m:
        at = np.arange(1 + n, len(fit.theta)).reshape(units, m + 2)
        fields |= {
            name: tuple(part.ravel().tolist()) for name, part in zip("SBC", np.split(at, [1, 2], 1), strict=True)
        }
        tables["T"] = fit.network.T.ravel()
        wavelets = fit.network.wavelets
        lines += [
            f"double c[{m}];",
            f"for (int j = 0; j < {m}; ++j) {{",
            "    c[j] = 0.0;",
            f"    for (int i = 0; i < {n}; ++i) c[j] += T[{n} * j + i] * d[i];",
            "}",
            f"for (int k = 0; k < {units}; ++k) {{",
            "    double z = 0.0;",
            f"    for (int j = 0; j < {m}; ++j) z += (c[j] - p->C[{m} * k + j]) * (c[j] - p->C[{m} * k + j]);",
            "    z = p->B[k] * p->B[k] * z;",
            "    double g = exp(-0.5 * z);",
            *(
                [f"    if (k < {wavelets}) g = ({m}.0 - z) * g; /* wavelets, then scaling functions */"]
                if wavelets
                else []
            ),
            "    y += p->S[k] * g;",
            "}",
        ]
    lines += [
        f"if (s->diverged != 0.0 || !(fabs(y) <= {number(fit.limit)})) {{",
        "    s->diverged = 1.0;",
        "    y = (double)INFINITY;",
        "}",
    ]
    for name, count, value in (("past_y", na, "y"), ("past_u", past, "x")):
        if count > 1:
            lines.append(f"for (int i = {count - 1}; i > 0; --i) s->{name}[i] = s->{name}[i - 1];")
        lines += [f"s->{name}[0] = {value};"] if count else []
    states = {"diverged": 0} | {name: k for name, k in (("past_y", na), ("past_u", past)) if k}
    feeds = bool(fit.model.nb) and fit.model.nk == 0
    unread = [] if feeds or past else ["(void)x;"]
    return CCode("\n".join([*unread, *lines, "return y;"]), states, fields, tables=tables, feeds=feeds)


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
