"""Parameters of the twin as a file that a person edits: TOML or JSON, by suffix, in SI units.

A name is at the top level or, for a joint's parameter, in the table of the joint. Parameters not named are nominal:

    pot_noise = 0.002

    [thigh]
    coulomb = 40.0
"""

import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import check_regular_file, toml_values, write_text
from twin.hardware.actuator import check_rotor
from twin.hardware.linkage import end_angles
from twin.parameters import JOINTS, TABLE, Parameters, Row

LARGEST = 1_000_000  # [bytes] a file of every parameter has about ten thousand
ROWS: Mapping[str, Row] = {row.name: row for row in TABLE}


class _DamagedError(ValueError):
    """The text does not have the format of its suffix; holds the line (0 if unknown) and the sentence."""


@checked(late=True)
def read(path: str | os.PathLike[str]) -> Parameters:
    """The parameters in a .toml or .json file.

    Raises InputError, which names the file and the line or the parameter, for a file that cannot be read or is damaged,
    an unknown or repeated name, and a value that is not a number or is outside its bounds.
    """
    source = Path(path)
    parse = _FORMATS[check_suffix(source)]
    text = _text(source)
    try:
        document = parse(text)
    except _DamagedError as error:
        line, sentence = error.args
        raise InputError(f"{source}, line {line}: {sentence}" if line else f"{source}: {sentence}") from None
    except RecursionError:
        raise InputError(
            f"{source}: the tables are nested too deeply; give names, or joints with names in them"
        ) from None
    try:
        return Parameters(_values(document))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


@checked(late=True)
def write(parameters: Parameters, path: str | os.PathLike[str], all: bool = False) -> Path:
    """Write the values that differ from nominal, or all of them, so that `read` gives every bit of them back.

    In TOML a comment gives the unit, bounds and source of each value. The file appears whole or not at all; raises
    InputError for a path that cannot be written or for another suffix.
    """
    target = Path(path)
    tables = _tables_of(parameters.values if all else parameters.changed())
    return write_text(target, _to_toml(tables) if check_suffix(target) == ".toml" else _to_json(tables))


@checked(late=True)
def to_toml(parameters: Parameters, head: Sequence[str], comments: Mapping[str, str]) -> str:
    """The values that differ from nominal as TOML, under the comment lines `head`, with comments by name."""
    return _to_toml(_tables_of(parameters.changed()), head, comments)


def check_suffix(path: Path) -> str:
    """The suffix of a parameter file in small letters; raises InputError for another one."""
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        raise InputError(
            f"{path}: parameters cannot be {suffix or 'a file without suffix'}; end its name in {' or '.join(_FORMATS)}"
        )
    return suffix


def check_together(parameters: Parameters, source: str | os.PathLike[str]) -> None:
    """Raises InputError, which names `source`, if values within their bounds give an invalid leg together."""
    for joint in JOINTS:
        try:
            end_angles(parameters, joint)
            check_rotor(parameters, joint)
        except InputError as error:
            raise InputError(f"{source}: {joint}: {error}") from None


def _text(path: Path) -> str:
    """The text of a parameter file; raises InputError for one that cannot be read, is too large, or holds none."""
    check_regular_file(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder; give one file ({', '.join(_FORMATS)})")
    if not path.exists():
        raise InputError(f"{path} does not exist; check the name and the folder you are in")
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check that it is a readable file") from None
    if len(raw) > LARGEST:
        raise InputError(f"{path} has more than {LARGEST} bytes; give a file of parameters, which has a few thousand")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: found bytes that are not UTF-8; save the file as UTF-8 text") from None
    if not text.strip():
        raise InputError(f"{path} is empty; give at least one parameter, or write all with qpal info --write-params")
    return text


def _parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; raises _DamagedError with the line."""
    try:
        return toml_values(text)
    except tomllib.TOMLDecodeError as error:
        message, _, place = str(error).partition(" (at ")
        number = re.match(r"line (\d+)", place)
        line = int(number[1]) if number else len(text.splitlines())
        if message.startswith(("Cannot overwrite", "Cannot declare", "Duplicate")):
            raise _DamagedError(line, "a name is repeated; keep one of the two") from None
        raise _not("TOML", message, line) from None
    except ValueError as error:  # a whole number of thousands of digits
        raise _not("TOML", str(error)) from None


def _parse_json(text: str) -> dict[str, Any]:
    """The tables of a JSON text; raises _DamagedError, with the line where it is known."""

    def pairs(members: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in members]
        repeated_name = next((name for k, name in enumerate(names) if name in names[:k]), None)
        if repeated_name is not None:
            raise _DamagedError(0, f"{repeated_name!r} is repeated in one table; keep one of the two")
        return dict(members)

    def constant(name: str) -> NoReturn:
        raise _DamagedError(0, f"found {name} instead of a number; give a finite number")

    try:
        document = json.loads(text, object_pairs_hook=pairs, parse_constant=constant)
    except json.JSONDecodeError as error:
        raise _not("JSON", error.msg, error.lineno) from None
    except _DamagedError:
        raise
    except ValueError as error:
        raise _not("JSON", str(error)) from None
    if not isinstance(document, dict):
        raise _DamagedError(0, f"found {_brief(document)} instead of a table; give names with numbers")
    return document


def _not(kind: str, message: str, line: int = 0) -> _DamagedError:
    return _DamagedError(line, f"this is not {kind} ({message.partition(';')[0]}); correct it, or write the file again")


def _values(document: Mapping[str, Any]) -> dict[str, float]:
    """The values by full name; raises InputError for one that is unknown, repeated or out of its bounds."""
    values: dict[str, float] = {}
    for name, value in _entries(document):
        if name not in ROWS:
            raise _unknown(name)
        if name in values:
            raise InputError(f"{name} is given twice, as {values[name]!r} and {_brief(value)}; keep one")
        row = ROWS[name]
        span = f"{_span(row)} {_unit(row)}".rstrip()
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{name} is {_brief(value)}, which is not a number; give {span}, without quotes")
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{name} is {value}; give a number from {span}")
        if not row.lower <= value <= row.upper:
            raise InputError(f"{name} is {_brief(value)} {_unit(row)}".rstrip() + f"; give a number from {span}")
        values[name] = float(value)
    return values


def _entries(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Full names with their values."""
    for key, value in table.items():
        name = prefix + key
        if not isinstance(value, dict):
            yield name, value
        elif any(parameter.startswith(f"{name}.") for parameter in ROWS):
            yield from _entries(value, f"{name}.")
        elif name in ROWS:
            raise InputError(f"{name} is a table; give one number of {_unit(ROWS[name]) or 'no unit'}")
        else:
            raise InputError(f"unknown table {name!r}; choose one of {', '.join(_tables())}")


def _tables() -> dict[str, None]:
    return dict.fromkeys(name.rpartition(".")[0] for name in ROWS if "." in name)


def _unknown(name: str) -> InputError:
    members = [parameter for parameter in ROWS if parameter.startswith(f"{name}.")]
    if members:
        return InputError(f"{name} is a table of parameters, not a number; give the ones to change, as {members[0]}")
    alike = [parameter for parameter in ROWS if parameter.rpartition(".")[2] == name]  # the name without its table
    alike = alike or get_close_matches(name, ROWS, n=3, cutoff=0.7)
    suggestion = f"did you mean {' or '.join(alike)}? " if alike else ""
    return InputError(f"unknown parameter {name[:80]!r}; {suggestion}qpal info lists every name")


def _unit(row: Row) -> str:
    return "" if row.unit == "1" else row.unit


def _span(row: Row) -> str:
    return f"{_short(row.lower)} to {_short(row.upper)}"


def _short(value: float) -> str:
    """Seven digits if they are exact, otherwise all digits, so that a copied bound is within the bound."""
    text = f"{value:.7g}"
    return text if float(text) == value else repr(float(value))


def _brief(value: Any) -> str:
    """The value found, short enough for a sentence."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= 40 else text[:37] + "..."


def _tables_of(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    # Names at the top level come first: after a header they would belong to its table.
    tables: dict[str, dict[str, float]] = {"": {}}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        tables.setdefault(table, {})[key] = value
    return tables


_HEAD = ("Parameters of the twin in SI units; parameters not named are nominal.",)


def _to_toml(
    tables: Mapping[str, Mapping[str, float]], head: Sequence[str] = _HEAD, comments: Mapping[str, str] | None = None
) -> str:
    """The tables as TOML, every value with a comment."""
    lines = [f"# {' '.join(line.split())}" for line in head]
    for table, entries in tables.items():
        if table:
            lines += ["", f"[{table}]"]
        for key, value in entries.items():
            name = f"{table}.{key}" if table else key
            comment = (comments or {}).get(name) or _comment(ROWS[name], value)
            lines.append(f"{key} = {value!r}  # {' '.join(comment.split())}")
    return "\n".join(lines) + "\n"


def _comment(row: Row, value: float) -> str:
    degrees = f" ({math.degrees(value):.4g} deg)" if row.unit == "rad" else ""
    nominal = "" if value == row.nominal else f" instead of {_short(row.nominal)}"
    unit = _unit(row) or "no unit"
    return f"{unit}{degrees}{nominal}, {_span(row)}; {' '.join(row.source.split())}"


def _to_json(tables: Mapping[str, Mapping[str, float]]) -> str:
    document: dict[str, Any] = dict(tables[""])
    document |= {name: entries for name, entries in tables.items() if name}
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


_FORMATS: dict[str, Callable[[str], dict[str, Any]]] = {".toml": _parse_toml, ".json": _parse_json}
