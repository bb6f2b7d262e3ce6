"""Groups of channels, each with its own times, as the columns of a table; and the libraries that read such files."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._arrays import Arrays


@dataclass
class Group:
    """Channels (n,) by name that have one time (n,) [s], None for the numbers of their samples; `units` by name."""

    name: str
    t: np.ndarray | None
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


def table_of_groups(path: Path, groups: Sequence[Group], place: str, notes: Sequence[str] = ()) -> Table:
    """The table of all groups; groups of one time have one clock, `time`, or `GROUP.time` where there are several.

    A channel whose name stands in several groups is called GROUP.NAME. Raises InputError where no channel has numbers.
    """
    arrays, clocks = Arrays(path), list[tuple[str, np.ndarray]]()
    arrays.notes += notes
    for group in groups:
        if group.t is not None and not any(np.array_equal(group.t, t) for _, t in clocks):
            clocks.append((group.name, group.t))
    prefixes = _distinct([name for name, _ in clocks])
    names = [name for group in groups for name in group.channels]
    clock_names = [f"{prefix}.time" if len(clocks) > 1 else "time" for prefix in prefixes]
    while len(clocks) == 1 and clock_names[0] in names:
        clock_names[0] = f"{clock_names[0]}_"
    for name, (_, t) in zip(clock_names, clocks, strict=True):
        arrays.column(name, np.asarray(t, dtype=float))
        arrays.units[name] = "s"
    for group, prefix in zip(groups, _distinct([group.name for group in groups]), strict=True):
        clock = next((c for c, (_, t) in zip(clock_names, clocks, strict=True) if _same(group.t, t)), "")
        for name, values in group.channels.items():
            column = name if names.count(name) == 1 else f"{prefix}.{name}"
            before = set(arrays.columns)
            arrays.add(column, values)
            for each in set(arrays.columns) - before:
                arrays.clocks |= {each: clock} if clock and len(clocks) > 1 else {}
                arrays.units |= {each: group.units[name]} if group.units.get(name) else {}
    return arrays.table(place, "has no channel with numbers; record one that has signals")


def group_of(groups: list[Group], name: str, t: np.ndarray | None) -> Group:
    """The group of this time among `groups`, to which a new one called `name` is added where there is none."""
    group = next((each for each in groups if _same(each.t, t)), None)
    if group is None:
        group = Group(name, t)
        groups.append(group)
    return group


def _same(t: np.ndarray | None, other: np.ndarray | None) -> bool:
    return t is other if t is None or other is None else np.array_equal(t, other)


def _distinct(names: Sequence[str]) -> list[str]:
    """The names, with their number behind those that come twice."""
    return [name if names.count(name) == 1 else f"{name}({k})" for k, name in enumerate(names, start=1)]


@contextmanager
def damage(path: Path, kind: str, remedy: str) -> Iterator[None]:
    """Within it every error of a library that reads `path` is an InputError: a damaged file fails in many ways there.

    What the machine refuses, memory or the disk, stays what it is, and so does a sentence.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno:
            raise
        raise InputError(f"{path} is not a readable {kind} file ({type(error).__name__}); {remedy}") from None


def libraries_of(path: Path, libraries: Mapping[str, str], extra: str, kind: str) -> tuple[str, ...]:
    """The modules that read a file, by the names of their packages; raises InputError if one is not installed."""
    for module in libraries:
        try:
            installed = find_spec(module) is not None
        except (ImportError, ValueError):
            installed = False
        if not installed:
            raise InputError(
                f"{path}: reading {kind} needs {' and '.join(libraries.values())}; install "
                f"{'them' if len(libraries) > 1 else 'it'} with pip install 'qpal[{extra}]'"
            )
    return tuple(libraries)
