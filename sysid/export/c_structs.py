"""NAME.h: the structs of parameters and states of a fitted chain in C99, and the numbers in them."""

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import readable
from sysid.block.compiler.text import word
from sysid.block.writing import CCode
from sysid.export.program import AnyFit, Program, channel_counts
from sysid.model.wiring import Unit

LONGEST = 60  # letters of a text from a file in a comment
LIBM = ("exp", "log", "sqrt", "pow", "sin", "cos", "acos", "tanh", "floor")
CALLED = re.compile(rf"\b({'|'.join(LIBM)})\(")


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


class Structs:
    """The structs of one model, and its header."""

    def __init__(self, fit: AnyFit, name: str, program: Program[CCode]) -> None:
        self.name, self.program, self.Ts = name, program, fit.Ts
        self.n_in, self.n_out = channel_counts(fit)
        self.single_channel = self.n_in == self.n_out == 1
        origin = fit.origin
        self.u_unit, self.y_unit = map(in_comment, origin.si_units if origin else ("", ""))
        self.units = {unit.name: unit for layer in program.layers for row in layer for unit, _ in row}.values()
        short = {unit.name: re.sub(r"^block\d+_", "", unit.name) for unit in self.units}
        count = Counter(short.values())
        fine = {k: v for k, v in short.items() if count[v] == 1 and re.match("[A-Za-z]", v)}
        self.short = {k: word(fine.get(k, k), ("u_offset", "y_offset", "none")) for k in short}

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
{self.head()};

#ifdef __cplusplus
}}
#endif

#endif
"""

    def _usage(self) -> list[str]:
        name = self.name
        call = f"y = {name}_step(&s, &p, u)" if self.single_channel else f"{name}_step(&s, &p, u, y)"
        used = sorted({word for code in self.program.codes.values() for word in CALLED.findall(_all(code))})
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

    def head(self) -> str:
        """NAME_step as it is declared."""
        name = self.name
        if self.single_channel:
            return f"double {name}_step({name}_state *s, const {name}_params *p, double u)"
        signals = f"const double u[{self.n_in}], double y[{self.n_out}]"
        return f"void {name}_step({name}_state *s, const {name}_params *p, {signals})"


_newline, _newline_in, _blank = "\n", "\n   ", "\n\n"


def in_comment(text: str) -> str:
    """A text that comes from a file, for a comment of C, which it cannot end: on one line, and cut where it is long."""
    words = " ".join(readable(text).split()).replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")
    return words if len(words) <= LONGEST else f"{words[: LONGEST - 3]}..."


def _struct(lines: list[str], name: str) -> str:
    return "\n".join(["typedef struct {", *lines, f"}} {name};"])


def _all(code: CCode) -> str:
    return f"{code.begin}\n{code.body}"
