"""A fit as a Modelica model that needs no library: parameters in a record for each block, a step at every sample."""

import os
import re
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import write_text
from sysid.export import closed_form
from sysid.export.c_structs import Structs, Value
from sysid.export.modelica_text import HELPERS, WORDS, function, real, word
from sysid.export.program import AnyFit, Offset, c_program
from sysid.model.wiring import Layer, Unit, identifier, whole

_ONE = r"(1|[pnumkMG]?(V|A|N|W|J|Pa|Hz|m|s|g|K|rad)\d?)"
_UNIT = re.compile(rf"{_ONE}([./]{_ONE})*")


@checked
def write(fit: AnyFit, path: str | os.PathLike, **scale: Offset) -> Path:
    """Write `source` to a file, complete or not at all; the model has the file's name, as Modelica wants it."""
    return write_text(path, source(fit, Path(path).stem, **scale))


@checked
def source(fit: AnyFit, name: str = "exported", u_offset: Offset = None, y_offset: Offset = None) -> str:
    """Text of the model NAME: the fit's free run with input u and output y, sampled every `Ts` seconds from time 0.

    Filters and speeds start from rest, positions and backlash at the fit's initial values, as in `Fit.simulate(u)`. It
    takes and gives the levels of raw records: u_offset (nu,) and y_offset (ny,) are what was removed from the
    estimation data, by default as the fit knows it. Raises InputError for a block without a formula and a name that is
    not an identifier.
    """
    if identifier(name) in WORDS:
        raise InputError(f"{name!r} has a meaning in Modelica; give another name")
    structs = Structs(fit, name, c_program(fit, u_offset, y_offset))
    form = closed_form.text(fit, u_offset=u_offset, y_offset=y_offset)
    return _Text(structs, name).source(form)


class _Text:
    """The text of one model."""

    def __init__(self, structs: Structs, name: str) -> None:
        self.structs, self.name = structs, name
        self.codes = structs.program.codes
        taken = ("u", "y", "held", "started", "Ts", "signal", *HELPERS, name)
        self.short = {
            unit.name: f"{s}_" if (s := structs.short[unit.name]) in WORDS or s in taken else s
            for unit in structs.units
        }

    def source(self, form: str) -> str:
        """The whole model."""
        structs, name = self.structs, self.name
        n_in, n_out = structs.n_in, structs.n_out
        functions = [function(f"Step_{self.short[unit.name]}", self.codes[unit.name]) for unit in structs.units]
        helpers = [text for each, text in HELPERS.items() if any(f"{each}(" in f for f in functions)]
        records = [self.record(unit) for unit in structs.units if self.codes[unit.name].fields]
        own = [
            f"  parameter Values_{self.short[u.name]} {self.short[u.name]};"
            for u in structs.units
            if self.codes[u.name].fields
        ]
        own += [f"  parameter {_declared(v, v.name)};" for v in structs.offsets()]
        held, lines = self.steps()
        states = [
            _held(f"{self.short[unit.name]}_{field}", n)
            for unit in structs.units
            for field, n in self.codes[unit.name].states.items()
        ]
        one = structs.single_channel
        size, each = (("", ""), "") if one else ((f"[{n_in}]", f"[{n_out}]"), "each ")
        ends = "held" if one else f"{{{', '.join(f'held_{j}' for j in range(1, n_out + 1))}}}"
        parts = [
            f'model {name} "Exported model, one sample every {structs.Ts:g} s"',
            *(f"  // {line}".rstrip() for line in form.rstrip().split("\n")),
            "  connector RealInput = input Real;",
            "  connector RealOutput = output Real;",
            *records,
            *helpers,
            *functions,
            f'  constant Real Ts(unit = "s") = {real(structs.Ts)} "from sample to sample";',
            *own,
            f"  RealInput u{size[0]}{_port(structs.u_unit, each)};",
            f"  RealOutput y{size[1]}{_port(structs.y_unit, each)};",
            "protected",
            *states,
            *held,
            "  discrete Boolean started(start = false, fixed = true);",
            "algorithm",
            "  when sample(0.0, Ts) then",
            *(f"    {line}" for line in lines),
            "    started := true;",
            "  end when;",
            "equation",
            f"  y = {ends};",
            f"end {name};",
        ]
        return "\n".join(parts) + "\n"

    def record(self, unit: Unit) -> str:
        """The parameters of a unit."""
        name = f"Values_{self.short[unit.name]}"
        rows = [f"    {_declared(v, self.parameter(v))};" for v in self.structs.parameters(unit)]
        return "\n".join([f"  record {name}", *rows, f"  end {name};"])

    def parameter(self, value: Value) -> str:
        """A parameter's name in the record of its unit."""
        return word(re.sub(r"\W", "_", value.name.partition(".")[2]))

    def call(self, target: str, unit: Unit, signal: str) -> str:
        """The statement that steps a unit."""
        code, short = self.codes[unit.name], self.short[unit.name]
        values = {v.place: f"{short}.{self.parameter(v)}" for v in self.structs.parameters(unit)}
        arguments = [signal, *(["not pre(started)"] if code.begin else [])]
        for at in code.fields.values():
            arguments.append(values[at] if isinstance(at, int) else f"{{{', '.join(values[k] for k in at)}}}")
        states = [f"{short}_{field}" for field in code.states]
        arguments += [f"pre({state})" for state in states]
        targets = f"({', '.join([target, *states])})" if states else target
        return f"{targets} := Step_{short}({', '.join(arguments)});"

    def steps(self) -> tuple[list[str], list[str]]:
        """Declarations of what is held from sample to sample, and the statements of a sample."""
        structs, one = self.structs, self.structs.single_channel
        now = ["u - u_offset"] if one else [f"u[{i}] - u_offset{i}" for i in range(1, structs.n_in + 1)]
        held, lines = [], []
        for k, layer in enumerate(structs.program.layers, 1):
            names, now, more = self.layer(k, layer, now)
            held += names
            lines += more
        for j, value in enumerate(now, 1):
            name, offset = ("held", "y_offset") if one else (f"held_{j}", f"y_offset{j}")
            held.append(_held(name))
            lines.append(f"{name} := {value} + {offset};")
        return held, lines

    def layer(self, k: int, layer: Layer, now: list[str]) -> tuple[list[str], list[str], list[str]]:
        """Of one block: declarations, what comes out, and statements."""
        alone = whole(layer)
        if alone is not None:
            name = f"signal{k}"
            outs = [f"{name}[{j}]" for j in range(1, len(layer) + 1)]
            return [_held(name, len(layer))], outs, [self.call(name, alone, f"{{{', '.join(now)}}}")]
        held, outs, lines = [], [], []
        for j, row in enumerate(layer, 1):
            terms = [f"signal{k}_{j}" if len(row) == 1 else f"signal{k}_{j}_{i}" for i in range(1, len(row) + 1)]
            held += [_held(term) for term in terms]
            lines += [self.call(term, unit, now[i]) for term, (unit, i) in zip(terms, row, strict=True)]
            outs.append(" + ".join(terms))
        return held, outs, lines


def _held(name: str, length: int = 0) -> str:
    """A number, or a row of them, that keeps its value from sample to sample."""
    if length:
        return f"  discrete Real {name}[{length}](each start = 0.0, each fixed = true);"
    return f"  discrete Real {name}(start = 0.0, fixed = true);"


def _declared(value: Value, name: str) -> str:
    """A parameter with its unit, bounds and value; a unit that Modelica does not know is told in words."""
    known = bool(_UNIT.fullmatch(value.unit))
    parts = [f'unit = "{value.unit}"'] if known else []
    ends = (("min", value.lower), ("max", value.upper))
    parts += [f"{key} = {real(end)}" for key, end in ends if np.isfinite(end)]
    said = f' "{_quoted(value.unit)}"' if value.unit and not known else ""
    return f"Real {name}{_bracketed(parts)} = {real(value.start)}{said}"


def _bracketed(parts: list[str]) -> str:
    return f"({', '.join(parts)})" if parts else ""


def _port(unit: str, each: str) -> str:
    """Unit of a port, as an attribute or in words."""
    if _UNIT.fullmatch(unit):
        return f'({each}unit = "{unit}")'
    return f' "{_quoted(unit)}"' if unit else ""


def _quoted(text: str) -> str:
    return text.replace("\\", "/").replace('"', "'")
