"""Pages that are made from the code itself at each build: the interface in Python and the command line."""

import ast
import importlib
import inspect
import pkgutil
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from docstrings import restructured

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MACHINERY = (
    "base",
    "bench",
    "block",
    "estimation",
    "model",
    "report",
    "solver",
    "workflow",
)  # of which users call little
LIMIT = re.compile(r"Limit: (.+?)\.(?: Progress: (.+?)\.)?(?: Budget: (.+?)\.)?$")  # ends a help


def public(package: str) -> tuple[list[str], list[str]]:
    """Rooms and names that the stub of a package lists."""
    stub = Path(importlib.import_module(package).__file__).with_suffix(".pyi")
    rooms, names = [], []
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            (names if node.module else rooms).extend(alias.name for alias in node.names)
    return rooms, names


def heading(text: str, mark: str = "=") -> str:
    return f"{text}\n{mark * len(text)}\n"


def summary(names: list[str]) -> str:
    """A table of names with their first sentences; names of the module that the page is about, without it."""
    return ".. autosummary::\n   :nosignatures:\n\n" + "\n".join(f"   {name}" for name in names) + "\n"


def described(full: str, value: object) -> str:
    """The directive for one public object."""
    if inspect.isclass(value):
        return f".. autoclass:: {full}\n   :members:\n"
    if callable(value):
        return f".. autofunction:: {full}\n"
    return f".. autodata:: {full}\n   :no-value:\n"


def members(module: object) -> Iterator[tuple[str, object]]:
    """Public names of a module: those of `__all__`, else the functions and classes that are written in it."""
    if hasattr(module, "__all__") and isinstance(inspect.getattr_static(module, "__all__"), list):
        chosen = [(name, getattr(module, name)) for name in module.__all__]
        yield from ((n, v) for n, v in chosen if inspect.isclass(v) or inspect.isroutine(v))
        return
    for name, value in vars(module).items():
        own = getattr(value, "__module__", None) == module.__name__
        if not name.startswith("_") and own and (inspect.isclass(value) or inspect.isroutine(value)):
            yield name, value


def module_page(package: str, room: str) -> str:
    """One room: its sentence, its names and, where it lists none itself, those of its modules.

    What the package itself exports is described on the package's page alone.
    """
    full = f"{package}.{room}"
    module, above = importlib.import_module(full), importlib.import_module(package)
    lines = [heading(full), f".. automodule:: {full}\n   :no-members:\n"]
    shown = [getattr(above, name) for name in public(package)[1]]
    own = [(n, v) for n, v in members(module) if not any(v is other for other in shown)]
    if own:
        lines += [summary([n for n, _ in own]), *(described(f"{full}.{n}", v) for n, v in own)]
    elif hasattr(module, "__path__"):
        lines += list(_modules(full, module, shown, short=room in MACHINERY))
    return "\n".join(lines)


def _modules(full: str, module: object, known: list, short: bool) -> Iterator[str]:
    for found in pkgutil.iter_modules(module.__path__):
        name = f"{full}.{found.name}"
        if found.name.startswith("_"):
            continue
        inner = importlib.import_module(name)
        if short:
            said = restructured((inner.__doc__ or "").strip().split("\n\n")[0])
            yield f"``{found.name}``\n   " + " ".join(said.split()) + "\n"
            continue
        shown = [(n, v) for n, v in members(inner) if not any(v is other for other in known)]
        if shown:
            yield heading(found.name, "-")
            yield f".. automodule:: {name}\n   :no-members:\n"
            yield from (described(f"{name}.{n}", v) for n, v in shown)


def package_page(package: str) -> str:
    """The names of a package, and a list of its rooms."""
    rooms, names = public(package)
    module = importlib.import_module(package)
    full = [f"{package}.{name}" for name in names]
    lines = [heading(package), f".. automodule:: {package}\n   :no-members:\n", summary(names)]
    lines += [described(f, getattr(module, n)) for f, n in zip(full, names, strict=True)]
    lines += [heading("Rooms", "-"), ".. toctree::\n", *(f"   {package}.{room}" for room in rooms), ""]
    return "\n".join(lines)


def command_page() -> str:
    """Every verb with its options, as `qpal VERB --help` says them."""
    from twin.cli.app import build

    group = typer.main.get_command(build())
    lines = [heading("Command line"), restructured(group.help) + "\n"]
    lines.append("Each verb says the same with ``--help``. Exit status: 0 done, 1 a check did not hold, 2 bad input.\n")
    lines += [".. list-table:: How long a verb may take\n   :header-rows: 1\n"]
    for row in (("verb", "limit", "progress", "budget"), *((f"`{verb}`", *said) for verb, said in limits(group))):
        lines += [f"   {' ' if k else '*'} - {restructured(cell)}" for k, cell in enumerate(row)]
    lines += ["", *_commands(group, "qpal")]
    return "\n".join(lines)


def limits(group: typer.core.TyperGroup, above: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
    """The verbs that say how long they may take, each with its limit, progress and budget, empty where it has none."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from limits(command, f"{name} ")
        elif found := LIMIT.search(" ".join((command.help or "").split())):
            yield above + name, tuple(said or "" for said in found.groups())


def _commands(group: typer.core.TyperGroup, called: str) -> Iterator[str]:
    for name, command in group.commands.items():
        whole = f"{called} {name}"
        if hasattr(command, "commands"):
            yield from _commands(command, whole)
            continue
        yield heading(whole, "-")
        context = typer.Context(command, info_name=whole)
        yield f"``{' '.join(command.get_usage(context).removeprefix('Usage: ').split())}``\n"
        yield restructured(inspect.cleandoc(command.help or "")) + "\n"
        for parameter in command.get_params(context):
            record = parameter.get_help_record(context)
            if record and parameter.name != "help":
                said = " ".join(restructured(" ".join(record[1].split())).split())
                yield f"``{' '.join(record[0].split())}``\n   {said or '.'}\n"


def write(app: "Sphinx") -> None:
    """All generated pages, before Sphinx looks for sources; files that did not change keep their time."""
    folder = Path(app.srcdir) / "generated" / "reference"
    pages = {"commands.rst": command_page()}
    for package in ("sysid", "twin"):
        pages[f"{package}.rst"] = package_page(package)
        pages |= {f"{package}.{room}.rst": module_page(package, room) for room in public(package)[0]}
    if folder.exists() and {p.name for p in folder.iterdir()} - pages.keys():
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: "Sphinx") -> None:
    app.connect("builder-inited", write, priority=100)
