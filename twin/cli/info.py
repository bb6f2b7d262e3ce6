"""`qpal info`: the twin's parameters and the truth of each joint; with a file, what the file holds."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import twin
from sysid import formats
from sysid.base.errors import InputError, unknown
from sysid.base.files import write_text
from twin.cli import console, options
from twin.cli.output import check_writable_file, run_folder
from twin.cli.results import note_result

if TYPE_CHECKING:
    from sysid.channels.guess import Given
    from sysid.workflow.inspection import Inspection

TS = 0.1  # [s] of the truth, if none is given
File = Annotated[str | None, typer.Argument(metavar="[FILE]", help=f"a recorded table: {', '.join(formats.TABLE)}")]


def info(
    file: File = None,
    joint: Annotated[str | None, options.name("one joint; all joints if not given", twin.JOINTS)] = None,
    ts: Annotated[float | None, options.number("S", "sampling time in seconds; of the truth, or of FILE")] = None,
    params: options.Params = None,
    write_params: Annotated[
        str | None, typer.Option(metavar="FILE", help="write all parameters to a .toml or .json file for editing")
    ] = None,
    signatures: Annotated[
        bool,
        typer.Option(
            "--signatures", help="show the effect and measured size of each imperfection; takes ten seconds more"
        ),
    ] = False,
    map: options.Map = None,
    write_map: Annotated[
        str | None, typer.Option(metavar="FILE.toml", help="write the mapping of FILE for editing")
    ] = None,
    input: options.Input = None,
    output: options.Output = None,
    time: options.Time = None,
    time_unit: options.TimeUnit = None,
    range: options.Range = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Show what a recorded file holds and how it is read.

    That is columns, units, sampling, repairs, and the mapping to edit.

    Without FILE, show the twin's parameters with their sources, and the true values that an identification should find.

    Limit: passes over the record. Progress: each part.
    """
    if file is not None:
        _refuse_options(f"with {file}", params=params, write_params=write_params, signatures=signatures or None)
        _refuse_response(file, is_record=None not in (input, output, ts))
        _show_file(file, joint, _reading(map, input, output, time, time_unit, ts), map, write_map, range, out, as_json)
        return
    _refuse_options(
        "without a FILE",
        map=map,
        write_map=write_map,
        input=input,
        output=output,
        time=time,
        time_unit=time_unit,
        range=range,
    )
    from sysid.report.page import write
    from twin import parameter_file
    from twin.report import info as report
    from twin.report import signatures as drawn
    from twin.signatures import TABLE as SIGNATURES
    from twin.signatures import signatures as measured
    from twin.studies.information import inform

    parameters = options.parameters(params) or twin.Parameters()
    target = None if write_params is None else Path(write_params)
    if target is not None:
        parameter_file.check_suffix(target)
    with (
        run_folder(out, "info") as (folder, scratch),
        console.progress(2 + len(SIGNATURES) * signatures, lines=not as_json) as step,
    ):
        inside = target is not None and target.parent.resolve() == folder.resolve()
        if target is not None and not inside:
            check_writable_file(target)
        step("linearising the joints")
        result = inform(joint, TS if ts is None else ts, parameters, params)
        effects = measured(parameters, lambda name: step(f"signature of {name}")) if signatures else ()
        step("drawing")
        summary = result.as_dict() | ({"signatures": [effect.as_dict() for effect in effects]} if effects else {})
        page = report.page(result, [drawn.section(effects)] if effects else [])
        write(scratch, page, summary)
        if target is not None:
            parameter_file.write(parameters, scratch / target.name if inside else target, all=True)
            if not inside:
                note_result(target)
    sentences = report.sentences(result) + ([] if target is None else [f"Parameters: {target}"])
    *tables, versions_table = report.tables(result)
    tables += [drawn.sizes(effects)] if effects else []
    console.finish(folder, summary, as_json, [*tables, versions_table], sentences, page.answer)


def _show_file(
    file: str,
    joint: str | None,
    reading: "Given",
    map: str | None,
    write_map: str | None,
    range: str | None,
    out: str | None,
    as_json: bool,
) -> None:
    """Report what `file` holds; exit code 1 where it is not yet known how to read it."""
    from sysid.channels.mapping_file import check_map_path
    from sysid.report import inspection as report
    from sysid.report.page import write
    from sysid.workflow.inspection import inspect_file

    if joint is not None and joint not in twin.JOINTS:
        raise unknown("joint", joint, twin.JOINTS)
    if write_map is not None:
        check_writable_file(check_map_path(write_map))
    with run_folder(out, "info") as (folder, scratch), console.progress(2) as step:
        step(f"reading {file}")
        result = inspect_file(file, map, reading, options.time_range(range), write_map)
        step("drawing")
        hints = _compare(result, joint)
        summary = result.as_dict()
        page = report.page(result, hints)
        write(scratch, page, summary)
        inside = write_map is not None and Path(write_map).parent.resolve() == folder.resolve()
        if write_map is not None:
            write_text(scratch / Path(write_map).name if inside else write_map, result.text)
            if not inside:
                note_result(write_map)
    mapping = f"Mapping: {write_map}"
    if write_map is None:
        to_edit = shlex.join(["qpal", "info", file, "--write-map", f"{Path(file).stem}.toml"])
        mapping = f"To read it otherwise: {to_edit}, edit that and give it with --map"
    sentences = [*report.sentences(result), *hints, mapping]
    console.finish(folder, summary, as_json, report.terminal_tables(result), sentences, page.answer)
    if result.signals is None:
        raise typer.Exit(1)


def _reading(
    map: str | None, input: str | None, output: str | None, time: str | None, time_unit: str | None, ts: float | None
) -> "Given":
    from sysid.channels.guess import Given
    from sysid.workflow.record import check_given

    reading = Given(input, output, time, time_unit, ts)
    check_given(reading, map)
    return reading


def _compare(result: "Inspection", joint: str | None) -> list[str]:
    """The command that lays the twin beside a leg's log."""
    name = joint or str(result.meta.get("joint", ""))
    s = result.signals
    if name not in twin.JOINTS or s is None or [x.unit for x in s.output] != ["rad"]:
        return []
    words = ["qpal", "compare", str(result.path), "--joint", name]
    return [f"Or, beside the twin: {shlex.join([*words, *result.options])}"]


def _refuse_response(file: str, is_record: bool) -> None:
    """Raises InputError for a frequency response, which has neither clock nor channels to show."""
    from sysid.workflow.frequency import read_frequency

    if (data := read_frequency(file, is_record=is_record)) is not None:
        raise InputError(
            f"{file} holds a frequency response of {len(data.w)} frequencies, {data.w[0]:.4g} to {data.w[-1]:.4g} "
            f"rad/s, and no record; fit it with qpal identify {shlex.quote(file)} --structure process"
        )


def _refuse_options(place: str, **values: Any) -> None:
    for name, value in values.items():
        if value is not None:
            raise InputError(f"--{name.replace('_', '-')} is given {place}; leave it out")
