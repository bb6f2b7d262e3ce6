"""The nonlinear state space of one input and one output as C99, Python and equations."""

from typing import Any

import numpy as np

from sysid.block.writing import Code, Writer, number


def _tables(block: Any, theta: np.ndarray) -> dict[str, np.ndarray]:
    m = block.split(theta)
    tables = {"A": m.A, "B": m.B, "C": m.C, "E": m.E, "F": m.F, "W": m.W, "V": m.V, "b": m.b, "b0": np.tanh(m.b)}
    return {name: np.ravel(part) for name, part in tables.items() if part.size}


def _monomials(block: Any, x: str, u: str) -> list[str]:
    """Each monomial as a product, state i as `x` with its number."""
    names = [*(x.format(i) for i in range(block.nx)), *([u] * block.nu)]
    return ["*".join(n for n, k in zip(names, row, strict=True) for _ in range(k)) for row in block.powers.tolist()]


def c(block: Any, theta: np.ndarray) -> Code:
    """One sample: the output, then the state."""
    m, (u0, us, y0, ys) = block.split(theta), (float(v[0]) for v in block.scales())
    nx, units, n = block.nx, block.units, block.features
    lines = [f"const double u = (x - ({number(u0)})) / ({number(us)});", f"double y, next[{nx}];"]
    if n:
        lines.append(f"double f[{n}];")
    if units:
        lines += [
            f"for (int k = 0; k < {units}; ++k) {{",
            "    double z = b[k];",
            f"    for (int j = 0; j < {nx}; ++j) z += W[{nx} * k + j] * s[j];",
            "    f[k] = tanh(z + V[k] * u) - b0[k];",
            "}",
        ]
    lines += [f"f[{units + k}] = {v};" for k, v in enumerate(_monomials(block, "s[{}]", "u"))]
    lines += [f"y = {number(m.d[0])} + ({number(m.D[0, 0])}) * u;", f"for (int j = 0; j < {nx}; ++j) y += C[j] * s[j];"]
    if m.F.size:
        lines.append(f"for (int k = 0; k < {n}; ++k) y += F[k] * f[k];")
    lines += [
        f"for (int i = 0; i < {nx}; ++i) {{",
        "    next[i] = B[i] * u;",
        f"    for (int j = 0; j < {nx}; ++j) next[i] += A[{nx} * i + j] * s[j];",
        *([f"    for (int k = 0; k < {n}; ++k) next[i] += E[{n} * i + k] * f[k];"] if n else []),
        "}",
        f"for (int i = 0; i < {nx}; ++i) s[i] = next[i];",
        f"return {number(y0)} + ({number(ys)}) * y;",
    ]
    return Code("\n".join(lines), nx, _tables(block, theta))


def python(block: Any, theta: np.ndarray) -> Code:
    """The same in Python."""
    m, (u0, us, y0, ys) = block.split(theta), (float(v[0]) for v in block.scales())
    nx, units, n = block.nx, block.units, block.features
    lines = [f"u = (x - ({number(u0)})) / ({number(us)})", "f = []"]
    if units:
        look = f"sum(W[{nx} * k + j] * s[j] for j in range({nx}))"
        lines.append(f"f += [math.tanh(b[k] + {look} + V[k] * u) - b0[k] for k in range({units})]")
    if len(block.powers):
        lines.append(f"f += [{', '.join(_monomials(block, 's[{}]', 'u'))}]")
    lines.append(f"y = {number(m.d[0])} + ({number(m.D[0, 0])}) * u + sum(C[j] * s[j] for j in range({nx}))")
    if m.F.size:
        lines.append(f"y += sum(F[k] * f[k] for k in range({n}))")
    more = f" + sum(E[{n} * i + k] * f[k] for k in range({n}))" if n else ""
    lines += [
        f"s[:] = [B[i] * u + sum(A[{nx} * i + j] * s[j] for j in range({nx})){more} for i in range({nx})]",
        f"return {number(y0)} + ({number(ys)}) * y",
    ]
    return Code("\n".join(lines), nx, _tables(block, theta))


def equations(block: Any, theta: np.ndarray, w: Writer) -> list[str]:
    """One line for the output, one for each state, one for each unit; the input and the output are scaled."""
    m, (u0, us, y0, ys) = block.split(theta), (float(v[0]) for v in block.scales())
    x = [f"x{i}" for i in range(1, block.nx + 1)]
    f = [f"f{k}" for k in range(1, block.units + 1)]
    f += _named(block)
    lines = [f"v(t) = ({w.sum([(1.0, f'{w.x}(t)'), (-u0, '')])})/{w.num(us)}, states and f at t"]
    now = [(m.d[0], ""), *zip(m.C[0], x, strict=True), (m.D[0, 0], "v"), *zip(m.F[0], f, strict=False)]
    lines.append(f"{w.y}(t) = {w.sum([(y0, '')])} + {w.num(ys)}*({w.sum(now)})")
    for i in range(block.nx):
        terms = [*zip(m.A[i], x, strict=True), (m.B[i, 0], "v"), *zip(m.E[i], f, strict=True)]
        lines.append(f"  x{i + 1}(t+1) = {w.sum(terms)}")
    for k in range(block.units):
        inside = w.sum([(m.b[k], ""), *zip(m.W[k], x, strict=True), (m.V[k, 0], "v")])
        lines.append(f"  f{k + 1} = {w.sum([(-float(np.tanh(m.b[k])), '')])} + tanh({inside})")
    return lines


def _named(block: Any) -> list[str]:
    """Each monomial as it is read: x1^2*v."""
    names = [*(f"x{i}" for i in range(1, block.nx + 1)), "v"]
    return [
        "*".join(name if k == 1 else f"{name}^{k}" for name, k in zip(names, row, strict=True) if k)
        for row in block.powers.tolist()
    ]
