"""The channel of a column whose role is known: the unit of its header, the sign of its words, and notes on both."""

from sysid.base.quantities import SHARE, display_quantity
from sysid.channels.column import Column, label, unit_in_brackets
from sysid.channels.conversion import COUNTS, convert, unit_of_file
from sysid.channels.mapping import Channel
from sysid.data.words import Word, with_sign, word_of


def guess_channel(role: str, column: Column, why: list[str], remarks: dict[str, str]) -> Channel:
    """The channel of a column in the unit of its header, and what is to be said of that unit."""
    unit, name, entry = column.header.mapped_unit, column.name, f"unit of [[{role}]] in a mapping"
    conversion = convert(unit)
    if unit == "":
        text = unit_in_brackets(name)
        statement = f"names {text!r}, which is no known unit" if text else "names no unit"
        why.append(f"column {name!r} {statement}: its numbers stay as they are; set {entry} if you know it")
        remarks[f"{role}.unit"] = "not known: set it"
    elif unit == COUNTS:
        why.append(f"column {name!r} holds counts: its numbers stay as they are; set adc or scale of [[{role}]]")
    elif not conversion.known:
        why.append(f"column {name!r} has the unknown unit {unit!r}: its numbers stay as they are")
        remarks[f"{role}.unit"] = "not known: the numbers stay as they are"
    elif conversion.unit != unit:
        end = {SHARE: "a share of 1", "": "a plain number"}.get(conversion.unit, conversion.unit)
        shown = display_quantity("", unit_of_file(unit)).unit
        end += f" and is shown in {shown}" if shown != conversion.unit else ""
        why.append(f"column {name!r} goes from {unit} to {end}: its header names {unit}")
    word = word_of(column.values) or Word()
    if word.evidence:
        why.append(_word_text(role, column, word))
    read = word if word.sure else Word()
    return Channel(column=name, unit=unit, name=label(name, role, unit), signed=read.signed, sign_bit=read.sign_bit)


def _word_text(role: str, column: Column, word: Word) -> str:
    """What is said of numbers that are words without their sign, or may be."""
    x, values = column.finite, with_sign(column.finite, word.signed, word.sign_bit)[0]
    become, place = f"{x.min():g} to {x.max():g} become {values.min():g} to {values.max():g}", f"of [[{role}]]"
    if word.sure:
        off = word.entry.split(" = ")[0]
        return f"column {column.name!r} holds {word.kind}: {become}; if not, set {off} = 0 {place} in a mapping"
    return f"column {column.name!r} may hold {word.kind}; if so, set {word.entry} {place} in a mapping: {become}"
