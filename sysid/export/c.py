"""A fitted chain as NAME.h and NAME.c in C99: a state struct, a struct of parameters, NAME_init and NAME_step.

The parameters stay variable: the code of each block reads them from the struct, whose first values are the fit's.
"""

import os
import re
import textwrap
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.files import write_text
from sysid.block.compiler.text import word
from sysid.block.writing import CCode, number
from sysid.export import closed_form
from sysid.export.program import AnyFit, Offset, Program, c_program, channel_counts
from sysid.model.wiring import Layer, Unit, identifier, whole

_HELPERS = {
    "min_of": "(double a, double b)\n{\n    return b < a ? b : a;",
    "max_of": "(double a, double b)\n{\n    return b > a ? b : a;",
    "place_of": "(long i, long n)\n{\n    return i < 0 ? 0 : (i < n ? i : n - 1);",
    "sum_of": "(const double *a, const double *b, int n)\n{\n    double sum = 0.0;\n"
    "    for (int i = 0; i < n; ++i) sum += a[i] * b[i];\n    return sum;",
}
_LIBM = ("exp", "log", "sqrt", "pow", "sin", "cos", "tanh", "floor")
_CONVERGED = re.compile(r"(fabs\(\w+\) <= )[\d.]+e-\d+( \* \w+\) \{\s+break;)")  # the end of an iteration
_CALLED = re.compile(rf"\b({'|'.join(_LIBM)})\(")


@dataclass(frozen=True)
class Value:
    """One number of a struct: its name with the block's, what it starts with, unit, and bounds.

    `place` is the position of a parameter in theta of its block; None for an offset and for a state. An `initial` one
    acts at the start only.
    """

    name: str
    start: float
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    place: int | None = None
    initial: bool = False


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
    if single:
        header, body = _single(header), _single(body)
    parameters = tuple(v for unit in text.units for v in text.parameters(unit)) + text.offsets()
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
        part = re.sub(r"\bdouble\b", "float", part).replace("HUGE_VAL", "HUGE_VALF")
        part = re.sub(rf"\b(fabs|{'|'.join(_LIBM)})\(", r"\1f(", part)
        return re.sub(r"(?<![\w.])(?:\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)", lambda m: _float(m[0]), part)

    text = _CONVERGED.sub(r"\g<1>1e-05\2", text)  # in float an error may never fall to 1e-9; what is left is its square
    parts = re.split(r"(/\*.*?\*/)", text, flags=re.DOTALL)
    return "".join(part if k % 2 else code(part) for k, part in enumerate(parts))


def _float(literal: str) -> str:
    largest = float(np.finfo(np.float32).max)
    short = str(np.float32(min(float(literal), largest)))
    return f"{short}f" if re.search("[.e]", short) else f"{short}.0f"


class _Text:
    """The text of one model."""

    def __init__(self, fit: AnyFit, name: str, program: Program[CCode]) -> None:
        self.name, self.program, self.Ts = name, program, fit.Ts
        self.n_in, self.n_out = channel_counts(fit)
        self.single_channel = self.n_in == self.n_out == 1
        origin = fit.origin
        self.u_unit, self.y_unit = (origin.u_unit, origin.y_unit) if origin else ("", "")
        self.units = {unit.name: unit for layer in program.layers for row in layer for unit, _ in row}.values()
        short = {unit.name: re.sub(r"^block\d+_", "", unit.name) for unit in self.units}
        count = Counter(short.values())
        fine = {k: v for k, v in short.items() if count[v] == 1 and re.match("[A-Za-z]", v)}
        self.short = {k: word(fine.get(k, k), ("u_offset", "y_offset", "none")) for k in short}

    # The two structs

    def parameters(self, unit: Unit) -> tuple[Value, ...]:
        """The parameters of a unit in the order of its struct."""
        code, slots = self.program.codes[unit.name], unit.block.slots()
        places = [k for at in code.fields.values() for k in ((at,) if isinstance(at, int) else at)]
        found = []
        for k in places:
            slot, value = slots[k], float(unit.theta[k])
            upper = max(min(slot.upper, code.limits.get(k, np.inf)), value)
            name = f"{self.short[unit.name]}.{slot.name}"
            found.append(Value(name, value, slot.unit, min(slot.lower, value), upper, k, slot.initial))
        return tuple(found)

    def offsets(self) -> tuple[Value, ...]:
        """The offsets of input and output."""
        found = []
        for name, values, unit in (
            ("u_offset", self.program.u_offset, self.u_unit),
            ("y_offset", self.program.y_offset, self.y_unit),
        ):
            names = [name] if self.single_channel else [f"{name}{i}" for i in range(1, len(values) + 1)]
            found += [Value(n, float(v), unit) for n, v in zip(names, values, strict=True)]
        return tuple(found)

    def states(self, unit: Unit) -> tuple[Value, ...]:
        """The states of a unit in the order of its struct."""
        short = self.short[unit.name]
        return tuple(
            Value(f"{short}.{field}{f'[{i}]' if length else ''}", 0.0)
            for field, length in self.program.codes[unit.name].states.items()
            for i in range(length or 1)
        )

    def header(self, comment: list[str]) -> str:
        """Text of NAME.h."""
        name, guard = self.name, f"{self.name.upper()}_H"
        codes = self.program.codes
        structs, parameters, states = [], [], []
        for unit in self.units:
            code, short = codes[unit.name], self.short[unit.name]
            if code.fields:
                structs.append(_struct(self._parameter_lines(unit), f"{name}_{short}_params"))
                parameters.append(f"    {name}_{short}_params {short};")
            if code.states:
                lines = [f"    double {field}{f'[{n}]' if n else ''};" for field, n in code.states.items()]
                structs.append(_struct(lines, f"{name}_{short}_state"))
                states.append(f"    {name}_{short}_state {short};")
        for field, n, of in (("u_offset", self.n_in, self.u_unit), ("y_offset", self.n_out, self.y_unit)):
            what = "taken off the input" if field[0] == "u" else "put on the output"
            size = "" if self.single_channel else f"[{n}]"
            parameters.append(f"    double {field}{size}; /* {what}{f' [{of}]' if of else ''} */")
        return f"""/* {name}: exported model.

{_newline.join(f"   {line}".rstrip() for line in comment)}

   {_newline_in.join(self._usage())}
*/
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

enum {{ {name}_inputs = {self.n_in}, {name}_outputs = {self.n_out} }};

{_blank.join(structs)}{_blank if structs else ""}{_struct(parameters, f"{name}_params")}

{_struct(states or ["    double none;"], f"{name}_state")}

extern const double {name}_Ts; /* seconds from sample to sample */
extern const {name}_params {name}_fit; /* the values of the fit */

void {name}_init({name}_state *s, const {name}_params *p);
{self._head()};

#ifdef __cplusplus
}}
#endif

#endif
"""

    def _usage(self) -> list[str]:
        name = self.name
        call = f"y = {name}_step(&s, &p, u)" if self.single_channel else f"{name}_step(&s, &p, u, y)"
        used = sorted({word for code in self.program.codes.values() for word in _CALLED.findall(_all(code))})
        libm = f"libm is needed for {', '.join(used)}: a table in their place would be another model." if used else ""
        return [
            f"{name}_params p = {name}_fit; {name}_state s; {name}_init(&s, &p); then {call} at every sample.",
            "A parameter may be changed between samples; initial values (x0, v0) act in the next init.",
            libm or "It needs no libm.",
            "No memory is allocated, nothing is kept outside of s.",
        ]

    def _parameter_lines(self, unit: Unit) -> list[str]:
        code, values = self.program.codes[unit.name], {v.place: v for v in self.parameters(unit)}
        lines = []
        for field, at in code.fields.items():
            each = [values[k] for k in ((at,) if isinstance(at, int) else at)]
            names = [v.name.partition(".")[2] for v in each]
            words = [] if isinstance(at, int) else [names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"]
            units = {v.unit for v in each} - {""}
            words += [f"[{', '.join(sorted(units))}]"] if units else []
            words += [f"up to {v.upper:g}" for v in each if v.place in code.limits]
            size = "" if isinstance(at, int) else f"[{len(at)}]"
            lines.append(f"    double {field}{size};" + (f" /* {', '.join(words)} */" if words else ""))
        return lines

    # The functions

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
        math = re.search(r"\bHUGE_VAL\b|\bfabs\(", body + self._values()) or _CALLED.search(body)
        begins = [
            f"    {name}_{self.short[unit.name]}_init({self._arguments(unit, step=False)});"
            for unit in self.units
            if codes[unit.name].begin
        ]
        init = [
            f"void {name}_init({name}_state *s, const {name}_params *p)",
            *("{", "    memset(s, 0, sizeof *s);"),
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
        return "\n\n".join(parts) + "\n"

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

    def _head(self) -> str:
        name = self.name
        if self.single_channel:
            return f"double {name}_step({name}_state *s, const {name}_params *p, double u)"
        signals = f"const double u[{self.n_in}], double y[{self.n_out}]"
        return f"void {name}_step({name}_state *s, const {name}_params *p, {signals})"

    def _step(self) -> str:
        at = "" if self.single_channel else "[{}]"
        signals = [f"u{at.format(i)} - p->u_offset{at.format(i)}" for i in range(self.n_in)]
        lines = [] if any(code.states for code in self.program.codes.values()) else ["(void)s;"]
        for k, layer in enumerate(self.program.layers, 1):
            more, signals = self._layer(k, layer, signals)
            lines += more
        ends = [f"{signal} + p->y_offset{at.format(j)}" for j, signal in enumerate(signals)]
        ends = [f"return {ends[0]};"] if self.single_channel else [f"y[{j}] = {end};" for j, end in enumerate(ends)]
        return "\n".join([self._head(), "{", *(f"    {line}" for line in [*lines, *ends]), "}"])

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
_newline, _newline_in, _blank = "\n", "\n   ", "\n\n"


def _struct(lines: list[str], name: str) -> str:
    return "\n".join(["typedef struct {", *lines, f"}} {name};"])


def _all(code: CCode) -> str:
    return f"{code.begin}\n{code.body}"


def _value(value: float) -> str:
    return number(value).replace("inf", "HUGE_VAL")


def _braces(values: np.ndarray | list[float]) -> str:
    text = f"{{{', '.join(_value(v) for v in values)}}}"
    return text if len(text) < _WIDE else textwrap.fill(text, _WIDE, subsequent_indent="        ")
