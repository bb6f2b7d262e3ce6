"""Methods of the benchmark by name, and those of files."""

import os
from typing import TYPE_CHECKING

from sysid.base.errors import InputError

if TYPE_CHECKING:
    from sysid.bench.method import Method


def all_methods() -> "dict[str, Method]":
    """All methods by name."""
    from sysid.bench import methods as known

    return dict(known.TABLE)


def add_file(text: str, table: "dict[str, Method]") -> str:
    """The name of a method; one that a file holds is added to `table`."""
    if not text.endswith(".py") and os.sep not in text:
        return text
    from sysid.bench.method_file import load
    from sysid.bench.suites import OWN, PEERS

    method = load(text)
    if method.name in table or method.name in (OWN, PEERS):
        raise InputError(f"{text} has the name of a method that is there already; rename the file")
    table[method.name] = method
    return method.name
