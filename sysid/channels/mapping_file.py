"""A ChannelMap as a TOML file that a person edits: every entry with a comment that says what it is."""

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from sysid.base.errors import InputError, printable, readable
from sysid.base.files import check_regular_file, toml_values, write_text
from sysid.channels.complaints import Place, complaint
from sysid.channels.mapping import ROLES, Adc, Channel, ChannelMap

LARGEST = 1_000_000  # [bytes] a mapping has about a thousand
EXAMPLES = {
    "period": "1000.0",
    "Ts": "0.01",
    "start": "0.0",
    "stop": "10.0",
    "part": "1",
    "adc": "{counts = [0, 1023], value = [-2.4, 2.4]}",
}
WIDTH = 36  # of an entry before its comment
FORMULA = "# value = sign * (scale * number + offset), in `unit`; then it becomes SI (deg to rad, mV to V)"


def read_map(path: str | os.PathLike[str]) -> ChannelMap:
    """The mapping in a .toml file.

    Raises InputError, which names the file and the line or table, for a file that cannot be read or is damaged, for
    an unknown entry, and for a value that is not allowed.
    """
    source = Path(path)
    text = _text(source)
    try:
        document = toml_values(text)
    except ValueError as error:
        message, _, place = str(error).partition(" (at ")
        line = re.match(r"line (\d+)", place)
        line_text = f", line {line[1]}" if line else ""
        raise InputError(
            f"{source}{line_text}: this is not TOML ({message.partition(';')[0]}); correct it, or write the mapping "
            "again with qpal info FILE --write-map"
        ) from None
    except RecursionError:
        raise InputError(f"{source}: the tables are nested too deeply; write the mapping again") from None
    try:
        return ChannelMap.model_validate(document)
    except ValidationError as error:
        entry, sentence = complaint(error, ChannelMap)
        raise InputError(f"{source}{_place(text, entry)}: {sentence}") from None


def write_map(mapping: ChannelMap, path: str | os.PathLike[str], title: str = "") -> Path:
    """Write the mapping so that `read_map` gives the same again; `title` becomes the first comment.

    The file appears whole or not at all; raises InputError for a path that cannot be written or has another suffix.
    """
    return write_text(check_map_path(path), map_text(mapping, title))


def check_map_path(path: str | os.PathLike[str]) -> Path:
    """`path` if it ends in .toml, else InputError."""
    if Path(path).suffix.lower() != ".toml":
        raise InputError(f"{path}: a mapping is a TOML file; end its name in .toml")
    return Path(path)


def map_text(mapping: ChannelMap, title: str = "", remarks: Mapping[str, str] | None = None) -> str:
    """The file's text; `remarks` by entry ("clock.unit", "output.column") stand before an entry's own comment."""
    lines = [f"# {_plain(line)}" for line in title.splitlines()]
    notes = remarks or {}
    for name in ("clock", *ROLES, "repair", "range"):
        part = getattr(mapping, name)
        for entry in part if isinstance(part, tuple) else (part,):
            lines += ["", f"[[{name}]]" if isinstance(part, tuple) else f"[{name}]"]
            lines += [FORMULA] if isinstance(entry, Channel) else []
            lines += _entries(name, entry, notes)
    return "\n".join(lines).lstrip("\n") + "\n"


def _entries(table: str, entry: BaseModel, remarks: Mapping[str, str]) -> Iterator[str]:
    for name, field in type(entry).model_fields.items():
        value = getattr(entry, name)
        line = f"# {name} = {EXAMPLES[name]}" if value is None else f"{name} = {_toml(value)}"
        comment = ". ".join(filter(None, [_plain(remarks.get(f"{table}.{name}", "")), field.description or ""]))
        yield f"{line:<{WIDTH}}  # {comment}"


def _plain(text: str) -> str:
    """A text that may stand in a comment: a column's name may hold anything."""
    return " ".join(readable(text).split())


def _toml(value: Any) -> str:
    if isinstance(value, Adc):
        known = {name: each for name in type(value).model_fields if (each := getattr(value, name)) is not None}
        return "{" + ", ".join(f"{name} = {_toml(each)}" for name, each in known.items()) + "}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
        return "".join(c if printable(c) == c else f"\\U{ord(c):08x}" for c in text)
    return repr(value)


def _text(path: Path) -> str:
    """The text of a mapping; raises InputError for a file that cannot be read, is too large, or holds none."""
    check_regular_file(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder; give one file (.toml)")
    if not path.exists():
        raise InputError(f"{path} does not exist; check the name, or write a mapping with qpal info FILE --write-map")
    check_map_path(path)
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check that it is a readable file") from None
    if len(raw) > LARGEST:
        raise InputError(f"{path} has more than {LARGEST} bytes; give a mapping, which has about a thousand")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: found bytes that are not UTF-8; save the file as UTF-8 text") from None
    if not text.strip():
        raise InputError(f"{path} is empty; write a mapping with qpal info FILE --write-map")
    return text


def _place(text: str, path: Place) -> str:
    """The line of an entry, or its table where the line is not found."""
    if not path:
        return ""
    table, number = str(path[0]), 0
    names = [part for part in path[1:] if isinstance(part, str)]
    wanted_number = next((part for part in path if isinstance(part, int)), 0)
    position = ("", 0)
    for line, content in enumerate(text.splitlines(), start=1):
        header = re.match(r"\s*(\[\[?)\s*([\w-]+)\s*\]", content)
        if header:
            number = number + 1 if header[2] == table else number
            position = (header[2], number - 1)
            if position == (table, wanted_number) and not names:
                return f", line {line}, table [{table}]"
            continue
        entry = re.match(r"\s*[\"']?([\w-]+)[\"']?\s*=", content)
        if entry and position == (table, wanted_number) and names and entry[1] == names[0]:
            return f", line {line}, table [{table}]"
        if entry and position[0] == "" and entry[1] == table:
            return f", line {line}"
    return f", table [{table}]"
