"""`qpal identify`: fit a model to a recorded file."""

from pathlib import Path
from typing import Annotated

import typer

from sysid import searches, structures
from sysid.blocks import STATIC
from sysid.preprocess import DETREND
from twin.cli import console, options
from twin.cli.output import default_folder, output_folder
from twin.logs import TABLE as READERS


def identify(
    file: Annotated[str, typer.Argument(metavar="FILE", help=f"a table: {', '.join(READERS)}")],
    input: Annotated[str | None, typer.Option(metavar="COL", help="column of the input")] = None,
    output: Annotated[str | None, typer.Option(metavar="COL", help="column of the output")] = None,
    ts: Annotated[float | None, options.number("S", "sampling time in seconds")] = None,
    time: Annotated[str | None, typer.Option(metavar="COL", help="column of time in seconds, instead of --ts")] = None,
    structure: Annotated[str, options.name("structure of the model", structures.TABLE)] = "hammerstein_wiener",
    orders: Annotated[str, typer.Option(metavar="NB,NF,NK", help="zeros + 1, poles, delay in samples")] = "2,3,1",
    input_map: Annotated[str | None, options.name("static map before the linear block", STATIC)] = None,
    output_map: Annotated[str | None, options.name("static map behind it", STATIC)] = None,
    search: Annotated[str, options.name("search method", searches.TABLE)] = "auto",
    split: Annotated[float, options.number("PART", "first part of the record, which is fitted to")] = 0.5,
    detrend: Annotated[str, options.name("what to remove", DETREND)] = "mean",
    starts: Annotated[int, options.whole("N", "number of starting points")] = 5,
    seed: Annotated[int, options.whole("N", "of the starting points that are drawn at random")] = 0,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Fit a model to a file of your own and report on it.

    The columns are found by themselves in a log of `qpal simulate` and in a file of two columns.
    """
    from twin.evaluation import Setting
    from twin.identification import identify_file
    from twin.report import identify as report
    from twin.report.page import write

    nb, nf, nk = options.orders(orders)
    setting = Setting(structure, nb, nf, nk, input_map, output_map, search, starts, options.seed(seed))
    folder = Path(out) if out is not None else default_folder("identify")
    with output_folder(folder) as scratch, console.progress(3) as step:
        step(f"reading {file}")
        result = identify_file(file, setting, input, output, ts, time, split, detrend, lambda: step("fitting"))
        step("drawing")
        write(scratch, report.page(result), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.terminal_tables(result), report.terminal_sentences(result))
