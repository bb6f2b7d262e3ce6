"""Studies: what many drawn cases say of the library. One runner for seeds, processes, journal, result and table.

    python scripts/study.py NAME --seeds 0:20 --workers 2 --out runs/NAME.jsonl [options of the study]
    python scripts/study.py            # the studies
    python scripts/study.py NAME --help

A study is a file in `scripts/studies`: its docstring, and `STUDY`, which names its cases, scores one of them and sums
the scores up. With --out each score is a line of that journal as soon as its case ends, and a run that was stopped goes
on with the cases that are missing. --json writes all scores as one document. Exit status 1 if a study says so, or if a
case ended in an error, which is printed: the others go on.
"""

import argparse
import importlib
import json
import sys
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent / "studies"
Case = tuple[Any, ...]  # of JSON values: what makes a score unique, for example (joint, seed)
Row = dict[str, Any]
MISSING = "–"


@dataclass(frozen=True)
class Study:
    """`cases(options)` are tuples of JSON values, `score(case, options)` is a dictionary of JSON values.

    `summary(rows, options)` is a text, or a dictionary that is printed as JSON; a row has the score, and its case as
    `case`. `line` says one score in a line as soon as its case ends. `options` are arguments of `add_argument` by flag;
    `own` and others that cases need arrive as `options.own`. `seeds` is the default of --seeds.
    `selecting` are names of options that choose cases or shape the summary: a journal serves any value of them.
    """

    cases: Callable[[argparse.Namespace], Iterable[Case]]
    score: Callable[[Case, argparse.Namespace], Row]
    summary: Callable[[list[Row], argparse.Namespace], str | dict[str, Any]]
    seeds: str = "0:10"
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    line: Callable[[Row], str] | None = None
    fails: Callable[[list[Row]], bool] | None = None
    selecting: Sequence[str] = ()


def seed_range(text: str) -> range:
    """The seeds "first:after the last", or "count" from 0."""
    first, colon, end = text.partition(":")
    return range(int(first), int(end)) if colon else range(int(first))


def words(text: str) -> list[str]:
    """The words of a list with commas, a type of options."""
    return text.split(",")


def markdown(headings: Sequence[str], rows: Iterable[Sequence[object]], texts: int = 1) -> str:
    """A table of Markdown whose first `texts` columns are texts, and the others numbers."""
    from sysid.report.page import Grid

    cells = [[str(cell) for cell in row] for row in rows]
    return Grid(headings, cells, text_columns=texts).markdown().removesuffix("\n")


def parser_of(study: Study, name: str, text: str) -> argparse.ArgumentParser:
    """The options of a study; `text` is its docstring."""
    parser = argparse.ArgumentParser(
        f"study.py {name}", description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seed_range, default=seed_range(study.seeds), metavar="FIRST:END")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--scheduler", help="address of a Dask scheduler, instead of --workers")
    parser.add_argument("--out", type=Path, metavar="FILE.jsonl", help="journal of the scores, which a next run reads")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all scores as one document")
    for flag, settings in study.options.items():
        parser.add_argument(flag, **settings)
    return parser


def run(study: Study, options: argparse.Namespace) -> list[Row]:
    """The rows of all cases in their order; those in the journal are not computed again."""
    from sysid.base.files import Lines
    from sysid.base.parallel import results

    runner = {"seeds", "workers", "scheduler", "out", "json", *study.selecting}
    settings = {name: str(value) for name, value in sorted(vars(options).items()) if name not in runner}
    cases = [tuple(case) for case in study.cases(options)]
    journal = None if options.out is None else Lines(options.out)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
    rows = _known_rows([] if journal is None else journal.read(), settings)
    todo = [case for case in cases if case not in rows]
    for k, score in results(partial(_scored, study.score, options), todo, options.workers, options.scheduler):
        if isinstance(score, str):
            print(f"{todo[k]} failed: {score}", file=sys.stderr, flush=True)
            continue
        text = json.dumps({"case": todo[k], **score}, default=_plain)
        row = rows[todo[k]] = json.loads(text)
        if journal is not None:
            journal.append(json.dumps({"settings": settings, **row}))
        if study.line is not None:
            print(study.line(row), file=sys.stderr, flush=True)
    return [rows[case] for case in dict.fromkeys(cases) if case in rows]


def _scored(score: Callable[..., Row], options: argparse.Namespace, case: Case) -> Row | str:
    """The score of a case; if it fails the error, so that one case does not end a study of hundreds."""
    try:
        return score(case, options)
    except Exception:
        return traceback.format_exc(limit=-3)


def _known_rows(lines: Sequence[str], settings: dict[str, str]) -> dict[Case, Row]:
    """The rows of a journal with these settings, by case; a line that is no JSON is none."""
    rows = {}
    for line in lines:
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row.pop("settings") == settings:
            rows[tuple(row["case"])] = row
    return rows


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as JSON values."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def main(arguments: Sequence[str]) -> int:
    """Run a study and print its summary."""
    names = sorted(path.stem for path in FOLDER.glob("*.py"))
    if not arguments or arguments[0] not in names:
        print(__doc__)
        print("Studies:", ", ".join(names))
        return 2 * bool(arguments and arguments[0] not in ("-h", "--help"))
    from sysid.base.files import write_text

    sys.path.insert(0, str(FOLDER))  # where worker processes look for the study too
    module = importlib.import_module(arguments[0])
    study: Study = module.STUDY
    options = parser_of(study, arguments[0], module.__doc__ or "").parse_args(arguments[1:])
    rows = run(study, options)
    failed = len({tuple(case) for case in study.cases(options)}) - len(rows)
    summary = study.summary(rows, options) if rows else "no case has a score"
    print(summary if isinstance(summary, str) else json.dumps(summary, indent=2))
    if failed:
        print(f"{failed} cases failed, see above; the figures are without them")
    if options.json is not None:
        write_text(options.json, json.dumps(rows, indent=1) + "\n")
    return int(failed > 0 or (study.fails is not None and study.fails(rows)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
