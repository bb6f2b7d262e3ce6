"""Basics of all rooms: errors, checks of arguments, atomic files, locks, workers, compiled loops, criteria, style."""

import sys
from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any


def modules_of(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of the package whose `__init__` calls this with its `__name__`.

    The modules of a room are loaded when they are asked for: `import sysid` reaches all of them and loads none.
    """
    room = sys.modules[package]
    names = sorted(m.name for m in iter_modules(room.__path__) if not m.name.startswith("_"))

    def load(name: str) -> Any:
        if name in names:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"{package} has no {name!r}; it has {', '.join(public())}")

    def public() -> list[str]:
        return sorted({*names, *vars(room).get("__all__", ())})

    return load, public


__getattr__, __dir__ = modules_of(__name__)
