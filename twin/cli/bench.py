"""`qpal bench`: methods against plants with a truth, against each other, and on real records."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError
from twin.cli import console, options

if TYPE_CHECKING:
    from sysid.bench.cell import Cell
    from sysid.bench.method import Method
    from sysid.bench.task import Family

TABLE = "runs/bench.parquet"
Tag = Annotated[str | None, typer.Option("--tag", metavar="NAME", help="what to run: quick, standard or full")]
Workers = Annotated[int | None, options.whole("N", "local processes; as many as there are cores if not given")]


def build() -> typer.Typer:
    """The verbs of `qpal bench`."""
    app = typer.Typer(
        name="bench",
        help="Benchmark of identification methods against truth, peers and real records.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    for verb in (run, list_):
        app.command(name=verb.__name__.rstrip("_"))(verb)
    return app


def run(
    tag: Tag = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option("--scenario", metavar="PATTERN", help="scenarios instead of a tag, for example 'drawn/*'; repeat"),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option("--method", metavar="NAME|FILE.py", help="methods instead of the tag's, or files; repeat"),
    ] = None,
    seeds: Annotated[int | None, options.whole("N", "seeds of each scenario, instead of the tag's")] = None,
    first: Annotated[int | None, options.whole("N", "the first seed; that of this version if not given")] = None,
    budget: Annotated[float | None, options.number("S", "seconds that each fit may take")] = None,
    workers: Workers = None,
    scheduler: options.Scheduler = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.parquet", help="results; a run continues them")] = Path(
        TABLE
    ),
    as_json: options.Json = False,
) -> None:
    """Run methods over scenarios into a table, a row each. A run that was stopped continues where it was."""
    from sysid.bench.runner import run as run_cells
    from sysid.bench.table import Table

    cells = _cells(tag, scenario, method, seeds, first, budget)
    table = Table(out)
    with console.progress(max(len(cells), 1)) as step:
        count = run_cells(cells, table, workers, scheduler, lambda done, todo: step(f"{done} of {todo}"))
    rows = table.rows()
    failed = rows.filter(rows["status"] != "ok")
    found = {"table": str(out), "rows": len(rows), "new": count, "without result": len(failed)}
    if as_json:
        from sysid.report.page import to_json

        sys.stdout.write(to_json(found))
        return
    print(f"{count} rows run, {len(rows)} in {out}, {len(failed)} of them without a result.")
    print(f"Next: qpal bench report {out}")


def list_(as_json: options.Json = False) -> None:
    """Show the scenarios, methods and tags."""
    from sysid.bench.suites import SUITES
    from sysid.report.page import Grid, to_json

    families, methods = _families(), _methods()
    found = {
        "scenarios": {f.name: list(f.scenarios()) for f in families.values()},
        "methods": {name: method.about for name, method in methods.items()},
        "tags": {name: suite.about for name, suite in SUITES.items()},
    }
    if as_json:
        sys.stdout.write(to_json(found))
        return
    rows = [[f.name, f.about, ", ".join(f.scenarios())] for f in families.values()]
    console.show(Grid(["family", "what", "names"], rows, "Scenarios"))
    console.show(Grid(["method", "what"], [[n, m.about] for n, m in methods.items()], "Methods"))
    console.show(Grid(["tag", "what"], [[n, s.about] for n, s in SUITES.items()], "Tags"))


def _families() -> "dict[str, Family]":
    from sysid.bench import scenarios

    return dict(scenarios.TABLE)


def _methods() -> "dict[str, Method]":
    from sysid.bench import methods

    return dict(methods.TABLE)


def _cells(
    tag: str | None,
    scenario: list[str] | None,
    method: list[str] | None,
    seeds: int | None,
    first: int | None,
    budget: float | None,
) -> "list[Cell]":
    from sysid.bench import suites
    from sysid.bench.methods import OURS

    families, methods = _families(), _methods()
    if tag is None and scenario is None:
        raise InputError(f"nothing is chosen; give --tag ({', '.join(suites.SUITES)}) or --scenario (qpal bench list)")
    if tag is not None and tag not in suites.SUITES:
        from sysid.base.errors import unknown

        raise unknown("tag", tag, suites.SUITES)
    names = [_named(text, methods) for text in method or ()]
    suite = suites.SUITES[tag or "quick"]
    if scenario is not None:
        parts: Any = [suites.Part(tuple(scenario), tuple(names) or (suites.BAR, *OURS), seeds or 1)]
    else:
        parts = [suites.Part(part.scenarios, tuple(names) or part.methods, seeds or part.seeds) for part in suite.parts]
    return suites.cells(parts, budget or suite.seconds, families, methods, first, OURS)


def _named(text: str, methods: "dict[str, Method]") -> str:
    """The name of a method, which a file adds to `methods`."""
    return text
