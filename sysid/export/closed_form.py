"""The closed form of a fitted chain as text: difference equations and maps with numbers, one line for each block.

Static formulas use * and ^ and the functions min, max, exp, floor, so that they can be copied into a calculation.
"""

from sysid.base.checks import checked
from sysid.base.quantities import SHARE
from sysid.block.block import StaticBlock
from sysid.block.writing import Writer
from sysid.estimation.result import Fit
from sysid.export.c_structs import in_comment
from sysid.export.program import AnyFit, Offset, level_offsets, network_equations
from sysid.model.wiring import layers, whole, written
from sysid.nlarx.result import NlarxFit


@checked
def text(fit: AnyFit, digits: int | None = 6, u_offset: Offset = None, y_offset: Offset = None) -> str:
    """The fit as formulas from u to y, block by block; digits=None writes every number exactly.

    t is the sample number; initial states are not part of the model and are left out. A line says what u and y are
    counted from, where that is not zero: u_offset (nu,) and y_offset (ny,), by default those of the fit. Raises
    InputError for a block that is a user's function.
    """
    head = [f"{fit.model.structure}, one sample every {fit.Ts:g} s", *map(in_comment, units_of_record(fit))]
    lines = [*head, *_levels(fit, digits, u_offset, y_offset)]
    if isinstance(fit, NlarxFit):
        return "\n".join([*lines, "", *network_equations(fit, digits)]) + "\n"
    layers_of_fit = layers(fit.model, fit.theta)
    names, signals = _signals(fit), _channels("u", fit.model.channels[0])
    for block, layer, name in zip(fit.model.blocks, layers_of_fit, names, strict=True):
        outputs = _channels(name, len(layer))
        lines += ["", f"{block.role}:"]
        unit = whole(layer)
        if unit is not None:
            names_of = Writer(", ".join(signals), ", ".join(outputs), digits)
            lines += written(unit, "equations")(unit.theta, names_of)
            signals = outputs
            continue
        for output, units in zip(outputs, layer, strict=True):
            alone = len(units) == 1
            for unit, i in units:
                y = output if alone else f"{output}_{signals[i]}"
                lines += written(unit, "equations")(unit.theta, Writer(signals[i], y, digits))
            if not alone:
                lines.append(f"{output} = " + " + ".join(f"{output}_{signals[i]}" for _, i in units))
        signals = outputs
    return "\n".join(lines) + "\n"


def units_of_record(fit: AnyFit) -> list[str]:
    """Names and units of the record that was fitted, none or one line: a file's degrees are radians here."""
    was = fit.origin
    if was is None or not (was.u_unit or was.y_unit):
        return []
    u_unit, y_unit = (unit or "?" for unit in was.si_units)
    shares = [name for name, unit in (("u", was.u_unit), ("y", was.y_unit)) if SHARE in unit]
    hint = f", {' and '.join(shares)} as 0.4 for 40 %" if shares else ""
    return [f"u is {was.u_name} [{u_unit}] and y is {was.y_name} [{y_unit}]{hint}"]


def _levels(fit: AnyFit, digits: int | None, u_offset: Offset, y_offset: Offset) -> list[str]:
    """What has to be taken off the input before the formulas, and put on the output behind them."""
    w, lines = Writer("", "", digits), []
    u0, y0 = level_offsets(fit, u_offset, y_offset)
    for name, value in zip(_channels("u", len(u0)), u0, strict=True):
        lines += [f"{name} = {w.sum([(1.0, 'input'), (-float(value), '')])}"] if value else []
    for name, value in zip(_channels("y", len(y0)), y0, strict=True):
        lines += [f"output = {w.sum([(1.0, name), (float(value), '')])}"] if value else []
    return lines


def _signals(fit: Fit) -> list[str]:
    """Names of the block outputs: w after a map, x after a filter, y at the end, numbered if they repeat."""
    names: list[str] = []
    for block in fit.model.blocks[:-1]:
        static = all(isinstance(part, StaticBlock) for _, part in block.parts())
        letter = "w" if static else "x"
        count = sum(n.startswith(letter) for n in names)
        names.append(f"{letter}_{count + 1}" if count else letter)
    return [*names, "y"]


def _channels(name: str, n: int) -> list[str]:
    return [name] if n == 1 else [f"{name}{i}" for i in range(1, n + 1)]
