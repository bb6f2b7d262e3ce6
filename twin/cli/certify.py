"""`qpal bench certify`: digits on which methods agree with certified values."""

from typing import Annotated

import typer

from sysid.base.errors import InputError, unknown
from twin.cli import console, options
from twin.cli.bench_methods import add_file, all_methods
from twin.cli.output import run_folder


def certify(
    method: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME|FILE.py", help="methods, or files of yours; without any, those of this library"),
    ] = None,
    record: Annotated[
        list[str] | None, typer.Option("--record", metavar="PATTERN", help="records instead of all, as 'oe_*'; repeat")
    ] = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Grade methods by digits agreed with certified values; exit with 1 if this library's own break the stated rule."""
    from fnmatch import fnmatchcase

    from sysid.bench.certificate import grade as grading
    from sysid.bench.certificate import static
    from sysid.bench.certificate.record import records
    from sysid.bench.certificate.stated import METHODS
    from sysid.report import certificate as page

    own = {each.name: each for each in METHODS}
    methods = own | all_methods()
    names = [add_file(text, methods) for text in method or own]
    for name in names:
        if name not in methods:
            raise unknown("method", name, methods)
    table = records()
    selected = {k: r for k, r in table.items() if any(fnmatchcase(k, p) for p in record or ["*"])}
    if not selected:
        raise InputError(f"no record is called {' or '.join(record or ())}; there are {', '.join(table)}")
    is_judged = METHODS[0].name in names
    with run_folder(out, "certify") as (folder, scratch):
        with console.progress(len(selected), lines=not as_json) as step:
            rows = grading.grades([methods[name] for name in names], selected.values(), step)
        sets = [static.grade(r, k) for r in static.references().values() for k in (1, 2)] if not method else []
        violations = grading.violations(rows, sets, METHODS[0].name)
        summary = page.write_page(scratch, rows, sets, selected, violations, is_judged)
    grids = [page.dynamic_grid(rows), *([page.static_grid(sets)] if sets else [])]
    reasons = dict.fromkeys(f"{r.method}: {r.status}" for r in rows if r.status != "ok")
    sentences = [*violations, *list(reasons)[:3], page.rules(is_judged)]
    console.finish(folder, summary, as_json, grids, sentences)
    if violations:
        raise typer.Exit(1)
