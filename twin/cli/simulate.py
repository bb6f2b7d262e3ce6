"""`qpal simulate`: an excitation experiment on the twin."""

from pathlib import Path
from typing import Annotated

import typer

from twin.cli import console, options
from twin.cli.output import check_writable_file, default_folder, output_folder


def simulate(
    joint: Annotated[str, typer.Option(metavar="NAME", help="shoulder, thigh or shank")] = "thigh",
    excitation: Annotated[str, typer.Option(metavar="NAME", help="voltage signal")] = "sweep",
    duration: Annotated[float, typer.Option(metavar="S", help="length of the record [s]")] = 250.0,
    ts: Annotated[float, typer.Option(metavar="S", help="sampling time [s]")] = 0.1,
    seed: Annotated[int, typer.Option(metavar="N", help="of excitation and noise")] = 1,
    without: Annotated[str, typer.Option(metavar="A,B", help="imperfections to leave out")] = "",
    log: Annotated[str | None, typer.Option(metavar="FILE", help="the log: .csv, .parquet, .mat [DIR/log.csv]")] = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Run an excitation experiment on one joint of the twin and write its log."""
    import twin
    from twin.report import simulate as report
    from twin.report.page import write
    from twin.simulation import simulate as run

    experiment = twin.Experiment(joint, excitation, duration, ts, options.seed(seed), options.names(without))
    folder = Path(out) if out is not None else default_folder("simulate")
    target = Path(log) if log is not None else folder / "log.csv"
    inside = target.parent.resolve() == folder.resolve()
    if not inside:
        check_writable_file(target)
    with output_folder(folder) as scratch, console.progress(2) as step:
        step(f"{joint}: {duration:g} s of {excitation}")
        result = run(experiment)
        summary = {"file": str(target), **result.as_dict()}
        step("drawing")
        write(scratch, report.page(result), summary)
        result.log.save(scratch / target.name if inside else target)
    console.finish(folder, summary, as_json, [report.table(result)], [f"Log: {target}"])
