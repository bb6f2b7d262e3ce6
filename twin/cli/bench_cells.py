"""What a command line of `qpal bench` names: families, methods and cells."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.base.errors import InputError, unknown

if TYPE_CHECKING:
    from sysid.bench.cell import Cell
    from sysid.bench.method import Method as AnyMethod
    from sysid.bench.redraw import Redrawn
    from sysid.bench.task import Family

Tag = Annotated[str | None, typer.Option("--tag", metavar="NAME", help="what to run: quick, standard or full")]
Scenario = Annotated[
    list[str] | None,
    typer.Option("--scenario", metavar="PATTERN", help="scenarios instead of a tag, for example 'drawn/*'; repeat"),
]
Method = Annotated[
    list[str] | None,
    typer.Option("--method", metavar="NAME|FILE.py", help="methods instead of the tag's, or files of yours; repeat"),
]
Records = Annotated[
    Path | None,
    typer.Option(
        "--records", metavar="DIR", help="public records (family real), or sets of .hdf5 files (family files)"
    ),
]


def families(records: Path | None = None) -> "dict[str, Family]":
    """All families of scenarios; `records` is a folder of public records, or of data sets as identibench keeps them."""
    from sysid.bench import scenarios
    from sysid.bench.layouts import Files
    from sysid.bench.scenarios.real import Real
    from twin import bench

    found: dict[str, Family] = {**scenarios.TABLE, **bench.TABLE}
    if records is None:
        return found
    if not records.is_dir():
        raise InputError(f"there is no folder {records}; give the folder that holds the records")
    here = str(records.resolve())  # workers may run elsewhere
    if any(records.rglob("*.hdf5")):
        return found | {"files": Files(here)}
    return found | {"real": Real(folder=here)}


def methods() -> "dict[str, AnyMethod]":
    """All methods by name."""
    from sysid.bench import methods as known

    return dict(known.TABLE)


def add_file(text: str, into: "dict[str, AnyMethod]") -> str:
    """The name of a method; one that a file holds is added to `into`."""
    if not text.endswith(".py") and os.sep not in text:
        return text
    from sysid.bench.scaffold import load
    from sysid.bench.suites import OWN, PEERS

    method = load(text)
    if method.name in into or method.name in (OWN, PEERS):
        raise InputError(f"{text} has the name of a method that is there already; rename the file")
    into[method.name] = method
    return method.name


def scenario(text: str, records: Path | None) -> "tuple[Family, str]":
    """The family and the name of "family/name"."""
    family, _, name = text.partition("/")
    known = families(records)
    if family not in known:
        raise unknown("family of scenarios", family, known)
    if name not in known[family].scenarios():
        raise unknown(f"scenario of {family}", name, known[family].scenarios())
    return known[family], name


def cells(
    tag: str | None,
    patterns: list[str] | None,
    named: list[str] | None,
    seeds: int | None,
    first: int | None,
    budget: float | None,
    records: Path | None,
) -> "list[Cell]":
    """The cells of a tag or of patterns, with other methods, seeds or budget where they are given."""
    from sysid.bench import suites
    from sysid.bench.methods import GENERAL, OURS

    if tag is None and patterns is None:
        raise InputError(f"nothing is chosen; give --tag ({', '.join(suites.SUITES)}) or --scenario (qpal bench list)")
    if tag is not None and tag not in suites.SUITES:
        raise unknown("tag", tag, suites.SUITES)
    for name, value in (("seeds", seeds), ("budget", budget)):
        if value is not None and not value > 0:
            raise InputError(f"--{name} is {value}; give a positive number")
    if first is not None and not 0 <= first < 2**62:
        raise InputError(f"--first is {first}; give a whole number from 0 to 2^62")
    known, suite = methods(), suites.SUITES[tag or "quick"]
    names = tuple(add_file(text, known) for text in named or ())
    patterns = None if patterns is None else [p if "/" in p else f"{p}/*" for p in patterns]
    if patterns is not None:
        parts = [suites.Part(tuple(patterns), names or (suites.BAR, *GENERAL), seeds or 1)]
    else:
        parts = [suites.Part(part.scenarios, names or part.methods, seeds or part.seeds) for part in suite.parts]
    return suites.cells(parts, budget or suite.seconds, families(records), known, first, OURS)


def redraw(records: Path | None) -> "Callable[[str, str, int], Redrawn]":
    """Solves a cell of the table again, by the names in its row."""
    from sysid.bench.redraw import redraw as again
    from sysid.bench.suites import SUITES

    known, every = families(records), methods()

    def one(name: str, method: str, seed: int) -> "Redrawn":
        family, _, rest = name.partition("/")
        if family not in known or method not in every:
            raise InputError(f"{name} or {method} is not part of this installation; give --records or the file")
        return again(known[family], rest, every[method], seed, SUITES["standard"].seconds)

    return one
