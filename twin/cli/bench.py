"""`qpal bench`: methods against plants with a truth, against each other, and on real records."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.base.errors import InputError, unknown
from twin.cli import console, options
from twin.cli.bench_methods import add_file, all_methods
from twin.cli.certify import certify
from twin.cli.options import Verb
from twin.cli.output import output_folder, run_folder
from twin.cli.results import note_result

if TYPE_CHECKING:
    from sysid.bench.cell import Cell, Redrawn
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


def all_families(records: Path | None = None) -> "dict[str, Family]":
    """All families of scenarios; `records` is a folder of public records, or of data sets as identibench keeps them."""
    from sysid.bench import scenarios
    from sysid.bench.layouts import Files
    from sysid.bench.scenarios.real import Real
    from twin import bench

    table: dict[str, Family] = {**scenarios.TABLE, **bench.TABLE}
    if records is None:
        return table
    if not records.is_dir():
        raise InputError(f"there is no folder {records}; give the folder that holds the records")
    folder = str(records.resolve())  # workers may run elsewhere
    if any(records.rglob("*.hdf5")):
        return table | {"files": Files(folder)}
    return table | {"real": Real(folder=folder)}


def find_scenario(text: str, records: Path | None) -> "tuple[Family, str]":
    """The family and the name of "family/name"."""
    family, _, name = text.partition("/")
    table = all_families(records)
    if family not in table:
        raise unknown("family of scenarios", family, table)
    if name not in table[family].scenarios():
        raise unknown(f"scenario of {family}", name, table[family].scenarios())
    return table[family], name


def selected_cells(
    tag: str | None,
    patterns: list[str] | None,
    method_names: list[str] | None,
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
    table, suite = all_methods(), suites.SUITES[tag or "quick"]
    names = tuple(add_file(text, table) for text in method_names or ())
    patterns = None if patterns is None else [p if "/" in p else f"{p}/*" for p in patterns]
    if patterns is not None:
        parts = [suites.Part(tuple(patterns), names or (suites.BAR, *GENERAL), seeds or 1)]
    else:
        parts = [suites.Part(part.scenarios, names or part.methods, seeds or part.seeds) for part in suite.parts]
    return suites.cells(parts, budget or suite.seconds, all_families(records), table, first, OURS)


def cell_redrawer(records: Path | None) -> "Callable[[str, str, int], Redrawn]":
    """Solves a cell of the table again, by the names in its row."""
    from sysid.bench.cell import redraw as again
    from sysid.bench.suites import SUITES

    families, every = all_families(records), all_methods()

    def redraw_cell(name: str, method: str, seed: int) -> "Redrawn":
        family, _, rest = name.partition("/")
        if family not in families or method not in every:
            raise InputError(f"{name} or {method} is not part of this installation; give --records or the file")
        return again(families[family], rest, every[method], seed, SUITES["standard"].seconds)

    return redraw_cell


DEFAULT = Path("runs/bench.parquet")
Table = Annotated[Path, typer.Argument(metavar="TABLE.parquet", help="results of qpal bench run")]


def build() -> typer.Typer:
    """The verbs of `qpal bench`."""
    app = typer.Typer(
        name="bench",
        help="Benchmark identification methods.\n\nThey are compared with the truth, with peers, and on real records.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    for name, verb in VERBS.items():
        app.command(name=name, cls=Verb)(verb)
    return app


def run(
    tag: Tag = None,
    scenario: Scenario = None,
    method: Method = None,
    seeds: Annotated[int | None, options.whole_number("N", "seeds of each scenario, instead of the tag's")] = None,
    first: Annotated[int | None, options.whole_number("N", "the first seed; that of this version if not given")] = None,
    budget: Annotated[float | None, options.number("S", "seconds that each fit may take")] = None,
    records: Records = None,
    workers: Annotated[
        int | None, options.whole_number("N", "local processes; as many as there are cores if not given")
    ] = None,
    scheduler: options.Scheduler = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.parquet", help="results; a run continues those that are there")
    ] = DEFAULT,
    as_json: options.Json = False,
) -> None:
    """Run methods over scenarios into a table, a row each. A run that was stopped continues where it was.

    Limit: its rows. Progress: each row. Budget: --budget, of each row.
    """
    from sysid.bench.cell import run_cells
    from sysid.bench.table import Table as Results

    cells = selected_cells(tag, scenario, method, seeds, first, budget, records)
    table = Results(out)
    with console.progress(max(len(cells), 1), lines=not as_json) as step:
        try:
            count = run_cells(
                cells, table, workers, scheduler, lambda count_done, todo: step(f"{count_done} of {todo}")
            )
        except KeyboardInterrupt:
            there = any(path.exists() for path in (out, out.with_suffix(".journal")))
            sentence = f"the rows so far are in {out}; the same command goes on from there"
            raise console.Interruption(sentence if there else "no row was finished, and nothing was written") from None
    note_result(out)
    for note in table.notes:
        print(f"Note: {note}.", file=sys.stderr)
    rows = table.rows()
    failures = rows.filter(rows["status"] != "ok")
    reasons = failures.unique("status", maintain_order=True).head(3)
    _say(
        {"table": str(out), "rows": len(rows), "new": count, "without result": len(failures)},
        as_json,
        f"{count} rows run, {len(rows)} in {out}, {len(failures)} of them without a result.",
        *(f"{row['method']} on {row['scenario']}: {row['status']}" for row in reasons.to_dicts()),
        f"Next: qpal bench report {out}",
    )


def report(
    table: Table = DEFAULT,
    against: Annotated[
        Path | None, typer.Option("--against", metavar="BASE.parquet", help="an earlier table: say what changed")
    ] = None,
    draw: Annotated[int, options.whole_number("N", "worst cells of our methods to solve again and draw")] = 0,
    records: Records = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Write the leaderboard of a table; against an earlier one, exit with 1 if something got worse beyond noise."""
    from sysid.bench.methods import OURS, PEERS
    from sysid.bench.regression import compare
    from sysid.bench.table import read
    from sysid.report import bench as pages

    rows = read(table)
    judged_methods = set(rows["method"]) - set(PEERS)
    verdict = None if against is None else compare(rows, read(against), judged_methods)
    redraw = cell_redrawer(records) if draw else None
    with run_folder(out, "bench") as (folder, scratch):
        summary, page = pages.write(scratch, rows, OURS, verdict, redraw, draw)
    sentences = [*(verdict.sentences if verdict else ()), *summary["sentences"]]
    console.finish(folder, summary, as_json, [], sentences, page.answer)
    if verdict is not None and verdict.worse:
        raise typer.Exit(1)


def show(records: Records = None, as_json: options.Json = False) -> None:
    """List the scenarios, methods and tags."""
    from sysid.bench.suites import SUITES
    from sysid.report.page import Grid

    families, methods = all_families(records), all_methods()
    if as_json:
        summary = {
            "scenarios": {f.name: list(f.scenarios()) for f in families.values()},
            "methods": {name: method.about for name, method in methods.items()},
            "tags": {name: suite.about for name, suite in SUITES.items()},
        }
        _say(summary, as_json)
        return
    rows = [[f.name, f.about, ", ".join(f.scenarios())] for f in families.values()]
    console.show(Grid(["family", "what", "names"], rows, "Scenarios", 3))
    console.show(Grid(["method", "what"], [[n, m.about] for n, m in methods.items()], "Methods", 2))
    console.show(Grid(["tag", "what"], [[n, s.about] for n, s in SUITES.items()], "Tags", 2))


def add(name: Annotated[str, typer.Argument(metavar="NAME", help="of your method, for example my_arx")]) -> None:
    """Write a method file to begin with, NAME.py in this folder. It runs as it is."""
    from sysid.bench.method_file import add as write

    path = write(name, methods=all_methods())
    note_result(path)
    print(f"{path} is a method that runs as it is. Edit its fit, then:")
    print(f"Next: qpal bench run --method {path} --scenario 'textbook/*' --out runs/{name}.parquet")


def install(
    name: Annotated[list[str], typer.Argument(metavar="NAME|FILE.py...", help="methods of others, or files; or peers")],
) -> None:
    """Make the environments of methods of other people; `peers` stands for all of them."""
    from sysid.bench.isolation import FileMethod
    from sysid.bench.suites import PEERS

    methods = all_methods()
    names = [add_file(text, methods) for text in name]
    for key in names:
        if key != PEERS and key not in methods:
            raise unknown("method", key, methods)
    keys = [key for key in methods if isinstance(methods[key], FileMethod)] if PEERS in names else names
    n_failures = 0
    for key in keys:
        method = methods[key]
        if not isinstance(method, FileMethod):
            print(f"{key} needs no environment: it is part of qpal.")
            continue
        try:
            print(f"{key}: {method.environment.install()}")
        except InputError as error:
            n_failures += 1
            print(error)
    if n_failures:
        raise typer.Exit(1)


def export(
    scenario: Annotated[str, typer.Argument(metavar="FAMILY/NAME", help="see qpal bench list")],
    seed: Annotated[int, options.whole_number("N", "which draw")] = 0,
    records: Records = None,
    out: Annotated[str, typer.Option("--out", metavar="DIR", help="a new folder")] = "runs/scenario",
) -> None:
    """Write a scenario's data as CSV, and what is known of its plant as JSON."""
    from sysid.bench.task import check_empty
    from sysid.bench.task import export as write

    family, name = find_scenario(scenario, records)
    if seed < 0:
        raise InputError(f"--seed is {seed}; give a whole number of at least 0")
    check_empty(out)
    with output_folder(Path(out)) as scratch:
        write(family.make(name, seed), scratch)
        check_empty(out)
    print(f"Written: {out}")


def speed(as_json: options.Json = False) -> None:
    """Seconds and ratios of the default fit: kernel, single start, five starts, long records."""
    from sysid.bench.speed import speed as measured

    results = {name: float(f"{value:.4g}") for name, value in measured().items()}
    _say(results, as_json, *(f"{name}: {value}" for name, value in results.items()))


VERBS: dict[str, Callable[..., None]] = {
    "run": run, "report": report, "certify": certify, "list": show, "add": add, "install": install, "export": export,
    "speed": speed,
}  # fmt: skip


def _say(summary: dict, as_json: bool, *sentences: str) -> None:
    if as_json:
        console.show_json(summary)
    else:
        print("\n".join(sentences))
