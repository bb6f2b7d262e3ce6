"""A fitted chain as NAME.h and NAME.c in C99: a state struct, a struct of parameters, NAME_init and NAME_step.

The parameters stay variable: the code of each block reads them from the struct, whose first values are the fit's.
"""

import os
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import write_text
from sysid.block.writing import CCode, number
from sysid.export import closed_form
from sysid.export.c_structs import CALLED, LIBM, Structs, Value
from sysid.export.program import AnyFit, Offset, Program, c_program
from sysid.model.wiring import Layer, Unit, identifier, whole

LARGEST_FLOAT = float(np.finfo(np.float32).max)
_HELPERS = {
    "min_of": "(double a, double b)\n{\n    return b < a ? b : a;",
    "max_of": "(double a, double b)\n{\n    return b > a ? b : a;",
    "place_of": "(long i, long n)\n{\n    return i < 0 ? 0 : (i < n ? i : n - 1);",
    "sum_of": "(const double *a, const double *b, int n)\n{\n    double sum = 0.0;\n"
    "    for (int i = 0; i < n; ++i) sum += a[i] * b[i];\n    return sum;",
}
_BARE = re.compile(r"(?m)^( *)((?:for|if) \([^()]*\)) ([^{\s].*;)( /\*.*\*/)?$")  # a statement that lacks braces
_CONVERGED = re.compile(r"(fabs\(\w+\) <= )[\d.]+e-\d+( \* \w+\) \{\s+break;)")  # the end of an iteration


@dataclass(frozen=True)
class Source:
    """Text of NAME.h and NAME.c, and the numbers of both structs in their order, all of one type."""

    header: str
    text: str
    parameters: tuple[Value, ...]
    states: tuple[Value, ...]
    feeds: bool  # whether an output hangs on the input of the same sample


@checked
def write(fit: AnyFit, path: str | os.PathLike, single: bool = False, **scale: Offset) -> Path:
    """Write NAME.c and beside it NAME.h, each whole or not at all; the file's name is NAME."""
    file = Path(path)
    made = written_source(fit, file.stem, single, **scale)
    write_text(file.with_suffix(".h"), made.header)
    return write_text(file, made.text)


@checked
def source(fit: AnyFit, name: str = "model", u_offset: Offset = None, y_offset: Offset = None) -> str:
    """Text of NAME.c; see `written_source`."""
    return written_source(fit, name, False, u_offset, y_offset).text


@checked
def written_source(
    fit: AnyFit, name: str, single: bool = False, u_offset: Offset = None, y_offset: Offset = None
) -> Source:
    """The fit's free run in C99 (which compiles as C++ too), in double precision or, if `single`, in float.

    Filters and speeds start from rest, positions and backlash at the fit's initial values (NAME_init), as in
    `Fit.simulate(u)`. It takes and gives the levels of raw records: u_offset (nu,) and y_offset (ny,) are what was
    removed from the estimation data, by default as the fit knows it (`Fit.u_offset`, `Fit.y_offset`); they are
    parameters too. With one input and one output `double NAME_step(state, parameters, u)`, else
    `void NAME_step(state, parameters, u[], y[])`. Raises InputError for a block without a formula.
    """
    identifier(name)
    text = _Text(fit, name, c_program(fit, u_offset, y_offset))
    comment = closed_form.text(fit, u_offset=u_offset, y_offset=y_offset).rstrip().replace("*/", "* /").split("\n")
    header, body = text.header(comment), text.source()
    parameters = tuple(v for unit in text.units for v in text.parameters(unit)) + text.offsets()
    if single:
        large = [v for v in parameters if LARGEST_FLOAT < abs(v.start) < np.inf]
        if large:
            raise InputError(
                f"{large[0].name} is {large[0].start:.3g}, and a float holds up to {LARGEST_FLOAT:.3g}; leave --single "
                "(single=True) out"
            )
        header, body = _single(header), _single(body)
    states = tuple(v for unit in text.units for v in text.states(unit)) or (Value("none", 0.0),)
    return Source(header, body, parameters, states, _feeds(text.program))


def _feeds(program: Program[CCode]) -> bool:
    """Whether there is a way from the input to the output through units that all feed through."""
    wet = [True] * len(program.u_offset)
    for layer in program.layers:
        alone = whole(layer)
        if alone is not None:
            wet = [any(wet) and program.codes[alone.name].feeds] * len(layer)
        else:
            wet = [any(wet[i] and program.codes[unit.name].feeds for unit, i in row) for row in layer]
    return any(wet)


def _single(text: str) -> str:
    """The same in float; comments stay."""

    def code(part: str) -> str:
        part = re.sub(r"\bdouble\b", "float", part)
        part = re.sub(rf"\b(fabs|{'|'.join(LIBM)})\(", r"\1f(", part)
        return re.sub(r"(?<![\w.])(?:\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)", lambda m: _float(m[0]), part)

    text = _CONVERGED.sub(r"\g<1>1e-05\2", text)  # in float an error may never fall to 1e-9; what is left is its square
    parts = re.split(r"(/\*.*?\*/)", text, flags=re.DOTALL)
    return "".join(part if k % 2 else code(part) for k, part in enumerate(parts))


def _float(literal: str) -> str:
    short = str(np.float32(min(float(literal), LARGEST_FLOAT)))
    return f"{short}f" if re.search("[.e]", short) else f"{short}.0f"


class _Text(Structs):
    """The text of one model."""

    def source(self) -> str:
        """Text of NAME.c."""
        name, codes = self.name, self.program.codes
        functions = [text for unit in self.units for text in self._functions(unit)]
        body = "\n".join(functions)
        helpers = [
            f"static {'long' if k == 'place_of' else 'double'} {k}{v}\n}}"
            for k, v in _HELPERS.items()
            if re.search(rf"\b{k}\(", body)
        ]
        math = re.search(r"\bINFINITY\b|\bfabs\(", body + self._values()) or CALLED.search(body)
        begins = [
            f"    {name}_{self.short[unit.name]}_init({self._arguments(unit, step=False)});"
            for unit in self.units
            if codes[unit.name].begin
        ]
        init = [
            f"void {name}_init({name}_state *s, const {name}_params *p)",
            *("{", "    (void)memset(s, 0, sizeof *s);"),
            *(begins or ["    (void)p;"]),
            "}",
        ]
        parts = [
            f"/* {name}: see {name}.h */",
            "\n".join([*(["#include <math.h>"] if math else []), "#include <string.h>", f'#include "{name}.h"']),
            f"const double {name}_Ts = {number(self.Ts)};",
            f"const {name}_params {name}_fit = {{\n{self._values()}\n}};",
            *helpers,
            *functions,
            "\n".join(init),
            self._step(),
        ]
        return _BARE.sub(r"\1\2 {\4\n\1    \3\n\1}", "\n\n".join(parts) + "\n")

    def _values(self) -> str:
        lines = []
        for unit in self.units:
            values, rows = {v.place: v.start for v in self.parameters(unit)}, []
            for at in self.program.codes[unit.name].fields.values():
                rows.append(_value(values[at]) if isinstance(at, int) else _braces([values[k] for k in at]))
            lines += [f"    {{{', '.join(rows)}}}, /* {self.short[unit.name]} */"] if rows else []
        for offset in (self.program.u_offset, self.program.y_offset):
            lines.append(f"    {_value(offset[0]) if self.single_channel else _braces(offset)},")
        return "\n".join(lines)

    def _functions(self, unit: Unit) -> list[str]:
        """Step of a unit, after its begin where it has one."""
        code, name = self.program.codes[unit.name], f"{self.name}_{self.short[unit.name]}"
        state = [f"{name}_state *s"] if code.states else []
        params = [f"const {name}_params *p"] if code.fields else []
        found = []
        if code.begin:
            unread = [] if "p->" in code.begin or not params else ["    (void)p;"]
            lines = [f"    {line}" for line in code.begin.split("\n")]
            found.append(
                "\n".join([f"static void {name}_init({', '.join(state + params)})", "{", *unread, *lines, "}"])
            )
        tables = [f"    static const double {k}[{len(v)}] = {_braces(v)};" for k, v in code.tables.items()]
        body = [f"    {line}" for line in code.body.split("\n")]
        for word_, given in (("s", state), ("p", params)):
            body = [f"    (void){word_};", *body] if given and f"{word_}->" not in code.body else body
        n_in, n_out = code.channels
        single = code.channels == (1, 1)
        signals = ["double x"] if single else [f"const double x[{n_in}]", f"double y[{n_out}]"]
        head = f"static {'double' if single else 'void'} {name}_step({', '.join(state + params + signals)})"
        return [*found, "\n".join([head, "{", *tables, *body, "}"])]

    def _arguments(self, unit: Unit, *signals: str, step: bool = True) -> str:
        code, short = self.program.codes[unit.name], self.short[unit.name]
        state, params = ([f"&s->{short}"] if code.states else []), ([f"&p->{short}"] if code.fields else [])
        return ", ".join([*state, *params, *(signals if step else ())])

    def _step(self) -> str:
        at = "" if self.single_channel else "[{}]"
        signals = [f"u{at.format(i)} - p->u_offset{at.format(i)}" for i in range(self.n_in)]
        lines = [] if any(code.states for code in self.program.codes.values()) else ["(void)s;"]
        for k, layer in enumerate(self.program.layers, 1):
            more, signals = self._layer(k, layer, signals)
            lines += more
        ends = [f"{signal} + p->y_offset{at.format(j)}" for j, signal in enumerate(signals)]
        ends = [f"return {ends[0]};"] if self.single_channel else [f"y[{j}] = {end};" for j, end in enumerate(ends)]
        return "\n".join([self.head(), "{", *(f"    {line}" for line in [*lines, *ends]), "}"])

    def _layer(self, k: int, layer: Layer, signals: list[str]) -> tuple[list[str], list[str]]:
        """Lines of one block, and the names of what comes out of it."""
        unit = whole(layer)
        if unit is not None:
            lines = [f"const double v{k}[{len(signals)}] = {{{', '.join(signals)}}};", f"double x{k}[{len(layer)}];"]
            lines.append(f"{self._call(unit, f'v{k}', f'x{k}')};")
            return lines, [f"x{k}[{j}]" for j in range(len(layer))]
        names = [f"x{k}" if len(layer) == 1 else f"x{k}_{j}" for j in range(1, len(layer) + 1)]
        terms = [" + ".join(self._call(unit, signals[i]) for unit, i in row) for row in layer]
        return [f"const double {n} = {row};" for n, row in zip(names, terms, strict=True)], names

    def _call(self, unit: Unit, *signals: str) -> str:
        return f"{self.name}_{self.short[unit.name]}_step({self._arguments(unit, *signals)})"


_WIDE = 110  # characters; a compiler need not take more than 4095


def _value(value: float) -> str:
    return number(value).replace("inf", "(double)INFINITY")


def _braces(values: np.ndarray | list[float]) -> str:
    text = f"{{{', '.join(_value(v) for v in values)}}}"
    return text if len(text) < _WIDE else textwrap.fill(text, _WIDE, subsequent_indent="        ")
