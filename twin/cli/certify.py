"""`qpal bench certify`: digits on which methods agree with certified values."""

import json
from pathlib import Path
from typing import Annotated

import typer

from sysid.base.errors import InputError, unknown
from twin.cli import console, options
from twin.cli.bench_methods import add_file, all_methods
from twin.cli.output import check_writable_file, run_folder
from twin.cli.results import note_result


def certify(
    method: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME|FILE.py", help="methods, or files of yours; without any, those of this library"),
    ] = None,
    record: Annotated[
        list[str] | None, typer.Option("--record", metavar="PATTERN", help="records instead of all, as 'oe_*'; repeat")
    ] = None,
    page_file: Annotated[
        str | None,
        typer.Option("--page", metavar="FILE.md", help="also write the certificate of this version"),
    ] = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Grade methods by digits agreed with certified values; exit with 1 if this library's own break the stated rule."""
    from fnmatch import fnmatchcase

    from sysid.base.files import write_text
    from sysid.bench.certificate import grade as grading
    from sysid.bench.certificate import release, static
    from sysid.bench.certificate.record import records
    from sysid.bench.certificate.stated import METHODS
    from sysid.report import certificate as page
    from sysid.report import release as release_page

    own = {each.name: each for each in METHODS}
    methods = own | all_methods()
    texts = {add_file(text, methods): text for text in method or own}
    names = list(texts)
    for name in names:
        if name not in methods:
            raise unknown("method", name, methods)
    table = records()
    selected = {k: r for k, r in table.items() if any(fnmatchcase(k, p) for p in record or ["*"])}
    if not selected:
        raise InputError(f"no record is called {' or '.join(record or ())}; there are {', '.join(table)}")
    is_judged = METHODS[0].name in names
    target = None if page_file is None else _checked(page_file, bool(method or record))
    with run_folder(out, "certify") as (folder, scratch):
        with console.progress(len(selected), lines=not as_json) as step:
            rows = grading.grades([methods[name] for name in names], selected.values(), step)
        sets = [static.grade(r, k) for r in static.references().values() for k in (1, 2)] if not method else []
        violations = grading.violations(rows, sets, METHODS[0].name)
        summary, first = page.write_page(scratch, rows, sets, selected, violations, is_judged, texts)
        if target is not None:
            numbers = release.certificate(rows, sets, violations)
            write_text(target.with_suffix(".json"), json.dumps(numbers, indent=1) + "\n")
            write_text(target, release_page.page(numbers))
            note_result(target)
    grids = [page.dynamic_grid(rows), *([page.static_grid(sets)] if sets else [])]
    reasons = dict.fromkeys(f"{r.method}: {r.status}" for r in rows if r.status != "ok")
    written = [] if target is None else [f"Certificate: {target}, its numbers: {target.with_suffix('.json')}"]
    sentences = [*violations, *list(reasons)[:3], *written]
    console.finish(folder, summary, as_json, grids, sentences, first)
    if violations:
        raise typer.Exit(1)


def _checked(file: str, selects: bool) -> Path:
    """Where the certificate will stand; raises InputError where it cannot, or where only a part was asked for."""
    if selects:
        raise InputError("--page is the certificate of all records by this library; leave --record and NAME out")
    target = Path(file)
    if target.suffix != ".md":
        raise InputError(f"--page is {file}; give a Markdown file, for example {target.with_suffix('.md')}")
    for each in (target, target.with_suffix(".json")):
        check_writable_file(each)
    return target
