"""`qpal identify`: fit a model to a recorded file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid import structures
from sysid.base.errors import InputError
from sysid.blocks import STATIC
from sysid.data.preprocess import DETREND
from sysid.nlarx.model import FOCUS
from sysid.solver import searches
from twin.cli import console, options
from twin.cli.output import run_folder

if TYPE_CHECKING:
    from sysid.workflow.evaluation import Setting
    from sysid.workflow.identification import Auto

AUTO, NLARX, JOINT = "auto", "nlarx", "actuated_joint"
ROUNDS = 4  # of a structure search


def identify(
    file: options.RecordFile,
    input: options.Input = None,
    output: options.Output = None,
    ts: options.Ts = None,
    time: options.Time = None,
    structure: Annotated[
        str, options.name("structure of the model, auto to search for one", [*structures.TABLE, AUTO])
    ] = "hammerstein_wiener",
    orders: Annotated[
        str | None,
        typer.Option(metavar="NB,NF,NK", help="zeros + 1, poles, delay in samples; of nlarx na,nb,nk [2,3,1; 2,2,1]"),
    ] = None,
    input_map: Annotated[
        str | None, options.name("static map before the linear block, or an actuated joint's driver", STATIC)
    ] = None,
    output_map: Annotated[
        str | None, options.name("static map behind it, or an actuated joint's sensor", STATIC)
    ] = None,
    focus: Annotated[str | None, options.name("errors that nlarx is fitted by", FOCUS)] = None,
    driver_step: Annotated[
        float | None, options.number("V", "how far apart the levels of an actuated joint's driver are, if known")
    ] = None,
    sensor_linearity: Annotated[
        float | None, options.number("Y", "how far an actuated joint's sensor may be off a straight line, if known")
    ] = None,
    search: Annotated[str, options.name("search method", searches.TABLE)] = "auto",
    split: Annotated[float, options.number("PART", "first part of the record, which is fitted to")] = 0.5,
    detrend: Annotated[str | None, options.name("what to remove [mean; none of an actuated joint]", DETREND)] = None,
    starts: Annotated[int, options.whole("N", "number of starting points")] = 5,
    seed: Annotated[int, options.whole("N", "of the starting points that are drawn at random")] = 0,
    resume: Annotated[
        str | None, typer.Option(metavar="FILE", help="journal of --structure auto, which goes on from it after a kill")
    ] = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Fit a model to a file of your own and report on it.

    The columns are found by themselves in a log of `qpal simulate` and in a file of two columns.
    """
    for option, given in (("--driver-step", driver_step), ("--sensor-linearity", sensor_linearity)):
        if given is not None and structure != JOINT:
            raise InputError(f"{option} is given with --structure {structure}; leave it out or give {JOINT}")
    maps, sheets = (input_map, output_map), {"driver_step": driver_step, "sensor_linearity": sensor_linearity or 0.0}
    setting = _setting(structure, orders, maps, focus, sheets, search, starts, options.seed(seed), resume)
    from sysid.report import identify as report
    from sysid.report.page import write
    from sysid.workflow.exports import export
    from sysid.workflow.identification import identify_file

    with run_folder(out, "identify") as (folder, scratch), console.progress(3) as step:
        step(f"reading {file}")
        rounds = console.Rounds(step, ROUNDS)
        try:
            result = identify_file(
                file, setting, input, output, ts, time, split, detrend, lambda: step("fitting"), candidate=rounds
            )
        except KeyboardInterrupt:
            if resume is None:
                raise
            raise console.Stopped(f"run it again with --resume {resume} to go on from there") from None
        step("drawing")
        exports = export(result.evaluation, scratch)
        write(scratch, report.page(result, exports), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.terminal_tables(result), report.terminal_sentences(result))


def _setting(
    structure: str,
    orders: str | None,
    maps: tuple[str | None, str | None],
    focus: str | None,
    sheets: dict[str, Any],
    search: str,
    starts: int,
    seed: int,
    resume: str | None,
) -> "Setting | Auto":
    from sysid.workflow.evaluation import Setting
    from sysid.workflow.identification import Auto

    if focus is not None and structure != NLARX:
        raise InputError(f"--focus is given with --structure {structure}; leave it out or give --structure {NLARX}")
    if structure == AUTO:
        for option, given in (("--orders", orders), ("--input-map", maps[0]), ("--output-map", maps[1])):
            if given is not None:
                raise InputError(
                    f"{option} is given with --structure {AUTO}, which searches it; leave it out or name a structure"
                )
        return Auto(search, starts, seed, None if resume is None else Path(resume))
    if resume is not None:
        raise InputError(f"--resume is given with --structure {structure}; only --structure {AUTO} keeps a journal")
    if structure == JOINT:
        if orders is not None:
            raise InputError(f"--orders is given with --structure {JOINT}, which has none; leave it out")
        return Setting(structure, 0, 0, 0, *maps, search, starts, seed, **sheets)
    if structure == NLARX:
        n = options.orders(orders or "2,2,1", options.NLARX_ORDERS, "2,2,1")
    else:
        n = options.orders(orders or "2,3,1", options.CHAIN_ORDERS, "2,3,1")
    poles = n["na" if structure == NLARX else "nf"]
    return Setting(structure, n["nb"], poles, n["nk"], *maps, search, starts, seed, focus or "prediction")
