"""The nonlinear state space as C99, Python and equations."""

from typing import Any

import numpy as np

from sysid.block.writing import CCode, Code, Writer, number


def c(block: Any) -> CCode:
    """One sample: the outputs, then the state."""
    nx, nu, ny, units, n = block.nx, block.nu, block.ny, block.units, block.features
    one = block.channels == (1, 1)
    inputs = ", ".join(_scale_text(block, "x" if one else "x[{}]"))
    lines = [f"const double u[{nu}] = {{{inputs}}};", f"double z[{ny}];", f"double next[{nx}];"]
    if n:
        lines.append(f"double f[{n}];")
    if units:
        lines += [
            f"for (int k = 0; k < {units}; ++k) {{",
            "    double v = p->b[k];",
            f"    for (int j = 0; j < {nx}; ++j) v += p->W[{nx} * k + j] * s->state[j];",
            f"    for (int j = 0; j < {nu}; ++j) v += p->V[{nu} * k + j] * u[j];",
            "    f[k] = tanh(v) - tanh(p->b[k]);",
            "}",
        ]
    lines += [f"f[{units + k}] = {v};" for k, v in enumerate(_monomials(block, "s->state"))]
    for to, first, rows, (own, through, more) in (
        ("z", "p->d[i]", ny, ("C", "D", "F" if block.readout and n else "")),
        ("next", "0.0", nx, ("A", "B", "E" if n else "")),
    ):
        lines += [
            f"for (int i = 0; i < {rows}; ++i) {{",
            f"    {to}[i] = {first};",
            f"    for (int j = 0; j < {nu}; ++j) {to}[i] += p->{through}[{nu} * i + j] * u[j];",
            f"    for (int j = 0; j < {nx}; ++j) {to}[i] += p->{own}[{nx} * i + j] * s->state[j];",
            *([f"    for (int k = 0; k < {n}; ++k) {to}[i] += p->{more}[{n} * i + k] * f[k];"] if more else []),
            "}",
        ]
    lines.append(f"for (int i = 0; i < {nx}; ++i) s->state[i] = next[i];")
    outputs = _outputs(block)
    lines += [f"return {outputs[0]};"] if one else [f"y[{j}] = {value};" for j, value in enumerate(outputs)]
    fields = {name: tuple(range(at.start, at.stop)) for name, at in block.places.items() if at.stop > at.start}
    fields.pop("x0")  # a new run begins at rest
    return CCode("\n".join(lines), {"state": nx}, fields, channels=block.channels)


def python(block: Any, theta: np.ndarray) -> Code:
    """The same in Python; of several channels x and the value are lists."""
    nx, nu, ny, units, n = block.nx, block.nu, block.ny, block.units, block.features
    one = block.channels == (1, 1)

    def product(table: str, width: int, row: str, of: str) -> str:
        return f"sum({table}[{width} * {row} + j] * {of}[j] for j in range({width}))"

    lines = [f"u = [{', '.join(_scale_text(block, 'x' if one else 'x[{}]'))}]", "f = []"]
    if units:
        look = f"b[k] + {product('W', nx, 'k', 's')} + {product('V', nu, 'k', 'u')}"
        lines.append(f"f += [math.tanh({look}) - b0[k] for k in range({units})]")
    if len(block.powers):
        lines.append(f"f += [{', '.join(_monomials(block))}]")
    readout_text = f" + {product('F', n, 'i', 'f')}" if block.readout and n else ""
    update_text = f" + {product('E', n, 'i', 'f')}" if n else ""
    lines += [
        f"z = [d[i] + {product('D', nu, 'i', 'u')} + {product('C', nx, 'i', 's')}{readout_text} for i in range({ny})]",
        f"s[:] = [{product('B', nu, 'i', 'u')} + {product('A', nx, 'i', 's')}{update_text} for i in range({nx})]",
        f"return {_outputs(block)[0] if one else '[' + ', '.join(_outputs(block)) + ']'}",
    ]
    return Code("\n".join(lines), nx, _tables(block, theta), channels=block.channels)


def equations(block: Any, theta: np.ndarray, w: Writer) -> list[str]:
    """A line for each scaled input, output, state and unit; w names all inputs and outputs, separated by commas."""
    m, (u0, us, y0, ys) = block.split(theta), block.scales()
    x, f = _names("x", block.nx), [*_names("f", block.units), *_read(block)]
    v = ["v"] if block.nu == 1 else _names("v", block.nu)
    lines = [
        f"{name}(t) = ({w.sum([(1.0, f'{signal}(t)'), (-centre, '')])})/{w.num(scale)}"
        for name, signal, centre, scale in zip(v, w.x.split(", "), u0, us, strict=True)
    ]
    F = m.F if block.readout else np.zeros((block.ny, len(f)))
    for o, signal in enumerate(w.y.split(", ")):
        terms = [(m.d[o], ""), *zip(m.C[o], x, strict=True), *zip(m.D[o], v, strict=True), *zip(F[o], f, strict=True)]
        lines.append(f"{signal}(t) = {w.num(y0[o])} + {w.num(ys[o])}*({w.sum(terms)}), states and features at t")
    for i, name in enumerate(x):
        terms = [*zip(m.A[i], x, strict=True), *zip(m.B[i], v, strict=True), *zip(m.E[i], f, strict=True)]
        lines.append(f"  {name}(t+1) = {w.sum(terms)}")
    for k in range(block.units):
        argument = w.sum([(m.b[k], ""), *zip(m.W[k], x, strict=True), *zip(m.V[k], v, strict=True)])
        lines.append(f"  f{k + 1} = tanh({argument}) - {w.num(float(np.tanh(m.b[k])))}")
    return lines


def _tables(block: Any, theta: np.ndarray) -> dict[str, np.ndarray]:
    m = block.split(theta)
    tables = {name: np.ravel(part) for name, part in m._asdict().items() if part.size and name != "x0"}
    return tables | ({"b0": np.tanh(m.b)} if block.units else {})


def _scale_text(block: Any, x: str) -> list[str]:
    u0, us, _, _ = block.scales()
    return [f"({x.format(j)} - ({number(c)})) / ({number(s)})" for j, (c, s) in enumerate(zip(u0, us, strict=True))]


def _outputs(block: Any) -> list[str]:
    _, _, y0, ys = block.scales()
    return [f"{number(c)} + ({number(s)}) * z[{j}]" for j, (c, s) in enumerate(zip(y0, ys, strict=True))]


def _monomials(block: Any, states: str = "s") -> list[str]:
    """Each monomial as a product in code."""
    names = [*(f"{states}[{i}]" for i in range(block.nx)), *(f"u[{j}]" for j in range(block.nu))]
    return [" * ".join(n for n, k in zip(names, row, strict=True) for _ in range(k)) for row in block.powers.tolist()]


def _names(letter: str, n: int) -> list[str]:
    return [f"{letter}{i}" for i in range(1, n + 1)]


def _read(block: Any) -> list[str]:
    """Each monomial as people write it: x1^2*v."""
    names = [*_names("x", block.nx), *(["v"] if block.nu == 1 else _names("v", block.nu))]
    return [
        "*".join(name if k == 1 else f"{name}^{k}" for name, k in zip(names, row, strict=True) if k)
        for row in block.powers.tolist()
    ]
