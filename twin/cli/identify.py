"""`qpal identify`: fit a model to a recorded file."""

from pathlib import Path
from typing import Annotated

import typer

from twin.cli import console, options
from twin.cli.output import default_folder, output_folder


def identify(
    file: Annotated[str, typer.Argument(metavar="FILE", help="a table: .csv, .txt, .dat, .mat or .parquet")],
    input: Annotated[str | None, typer.Option(metavar="COL", help="column of the input")] = None,
    output: Annotated[str | None, typer.Option(metavar="COL", help="column of the output")] = None,
    ts: Annotated[float | None, typer.Option(metavar="S", help="sampling time [s]")] = None,
    time: Annotated[str | None, typer.Option(metavar="COL", help="column of time [s], instead of --ts")] = None,
    structure: Annotated[str, typer.Option(metavar="NAME", help="structure of the model")] = "hammerstein_wiener",
    orders: Annotated[str, typer.Option(metavar="NB,NF,NK", help="zeros + 1, poles, delay [samples]")] = "2,3,1",
    input_map: Annotated[str | None, typer.Option(metavar="NAME", help="static map before the linear block")] = None,
    output_map: Annotated[str | None, typer.Option(metavar="NAME", help="static map behind it")] = None,
    search: Annotated[str, typer.Option(metavar="NAME", help="search method")] = "auto",
    split: Annotated[float, typer.Option(metavar="PART", help="part of the record to fit to, the first")] = 0.5,
    detrend: Annotated[str, typer.Option(metavar="NAME", help="mean or none")] = "mean",
    starts: Annotated[int, typer.Option(metavar="N", help="number of starting points")] = 1,
    seed: Annotated[int, typer.Option(metavar="N", help="of the starting points after the first")] = 0,
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
