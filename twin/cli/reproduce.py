"""`qpal reproduce`: the paper's protocol on the three joints of the twin."""

from typing import Annotated

import typer

from twin.cli import console, options
from twin.cli.output import run_folder


def reproduce(
    seed: Annotated[int, options.whole_number("N", "of the twin's noise")] = 0,
    duration: Annotated[float, options.number("S", "length of each record in seconds")] = 250.0,
    ablation: Annotated[
        bool,
        typer.Option("--ablation", help="also leave out parts of the model and the twin one by one; takes minutes"),
    ] = False,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Repeat the paper's protocol on the three joints.

    The results are compared with the paper and with the true values.

    Limit: three joints; records of 10^9 steps of the plant. Progress: time left.
    """
    from sysid.report.page import write
    from twin.report import reproduce as report
    from twin.report.reproduce import Stills
    from twin.studies import protocol
    from twin.view.stills import NoRenderer, leg_stills

    progress = console.progress(protocol.steps(ablation) + 2, lines=not as_json, known=True)
    with run_folder(out, "reproduce") as (folder, scratch), progress as step:
        result = protocol.run(options.seed(seed), duration, step, ablation)
        step("3-D stills of the leg")
        stills: Stills
        try:
            stills = leg_stills()
        except NoRenderer as reason:
            stills = str(reason)
        step("drawing the report")
        write(scratch, report.page(result, stills), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
    if not result.holds:
        raise typer.Exit(1)
