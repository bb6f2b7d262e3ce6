"""`qpal view`: the robot or a recorded log in MuJoCo's viewer, in a browser, or as pictures."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import twin
from sysid import formats
from sysid.base.errors import InputError
from sysid.base.files import atomic_file
from twin.cli import console, options
from twin.cli.output import check_writable_file, output_folder
from twin.cli.results import note_result

if TYPE_CHECKING:
    from twin.view.replay import Movement, Replay
    from twin.view.traces import Traces

File = Annotated[str | None, typer.Argument(metavar="[LOG]", help=f"log to replay: {', '.join(formats.TABLE)}")]
Ghost = Annotated[
    str | None, typer.Option(metavar="LOG", help="second log, for example the rig's, shown as a ghost leg")
]
Strip = Annotated[str | None, typer.Option(metavar="FILE.png", help="draw frames of the log into one figure")]
Frames = Annotated[str | None, typer.Option(metavar="DIR", help="write numbered PNG frames, 20 per second")]
Compare = Annotated[
    bool, typer.Option("--compare", help="the twin under the log's input as ghost; strip and frames show the error too")
]
Mcap = Annotated[
    str | None,
    typer.Option(metavar="FILE.mcap", help="write log and twin for Foxglove, rerun or PlotJuggler; implies --compare"),
]
Gif = Annotated[str | None, typer.Option(metavar="FILE.gif", help="write a GIF, 10 frames per second")]
Start = Annotated[float | None, options.number("S", "start time in the log in seconds")]
Stop = Annotated[float | None, options.number("S", "end time in the log in seconds")]


def view(
    log: File = None,
    joint: Annotated[str | None, options.name("moving joint, if the log does not name it", twin.JOINTS)] = None,
    ghost: Ghost = None,
    compare: Compare = False,
    params: options.Params = None,
    map: options.Map = None,
    speed: Annotated[float, options.number("X", "playback speed; 1 is real time")] = 1.0,
    start: Start = None,
    stop: Stop = None,
    web: Annotated[bool, typer.Option("--web", help="show the scene in a browser instead of a window")] = False,
    port: Annotated[int, options.whole_number("N", "port of --web; 0 takes the first free port from 8080")] = 0,
    strip: Strip = None,
    count: Annotated[int, options.whole_number("N", "frames in the strip")] = 6,
    frames: Frames = None,
    gif: Gif = None,
    mcap: Mcap = None,
) -> None:
    """Show the robot, or replay a log.

    It is shown in a window, in a browser (--web), or as pictures (--strip, --frames, --gif).

    Limit: until it is closed.
    """
    ways = {"--web": web, "--strip": strip, "--frames": frames, "--gif": gif, "--mcap": mcap}
    ways_chosen = [way for way, value in ways.items() if value]
    if len(ways_chosen) > 1:
        raise InputError(f"{' and '.join(ways_chosen)} are given; give one of them at a time")
    if not 0.001 <= speed <= 1000:
        raise InputError(f"--speed is {speed:g}; give a number from 0.001 to 1000")
    if port and not web:
        raise InputError(f"--port is {port} without --web; add --web, or leave --port out")
    traces = None
    if compare or mcap:
        log, joint, traces = _traces(log, ghost, joint, params, map, "--mcap" if mcap else "--compare")
        if mcap:
            _write_mcap(mcap, traces)
            return
    elif params is not None:
        raise InputError("--params is given without --compare; add --compare, or leave --params out")
    replay, names = _replay(log, ghost, joint, start, stop, map)
    if replay is not None and traces is not None:
        replay, names = _with_twin(replay, traces, params), [*names, "twin"]
    if not (strip or frames or gif):
        from twin.view.viewer import show

        show(replay, speed=speed, web=web, port=port)
        return
    from twin.view.stills import NoRenderer

    try:
        if strip:
            _write_picture(strip, ".png", lambda path: _write_strip(replay, names, count, path, traces))
        elif replay is None:
            raise InputError(f"{ways_chosen[0]} needs a log and none is given; give a LOG, or use --strip")
        else:
            _write_frames(replay, names, speed, frames, gif, traces)
    except NoRenderer as reason:
        raise InputError(f"{reason}; install Mesa's libEGL or libOSMesa, or use another machine") from None


def _replay(
    log: str | None,
    ghost: str | None,
    joint: str | None,
    start: float | None,
    stop: float | None,
    map: str | None = None,
) -> tuple["Replay | None", list[str]]:
    """The replay and the names of its legs; None without a log."""
    if log is None:
        given_options = (("--joint", joint), ("--ghost", ghost), ("--map", map), ("--start", start), ("--stop", stop))
        for option, value in given_options:
            if value is not None:
                raise InputError(
                    f"{option} is given without a LOG; give the log to replay first: qpal view LOG {option} ..."
                )
        return None, []
    from twin.view.replay import Replay

    first = twin.Log.load(log, map)
    leg = _movement(log, first, joint)
    shadow = None
    if ghost is not None:
        second = options.second_log(ghost, map)
        single_joint = next(iter(leg.angles)) if len(leg.angles) == 1 and not second.joint else None
        shadow = _movement(ghost, second, joint or single_joint)
    parameters = twin.Parameters(first.meta.get("parameters_changed", {}))
    replay = Replay(leg, shadow, parameters, 0.0 if start is None else start, stop)
    return replay, [Path(path).name for path in (log, ghost) if path is not None]


def _movement(path: str, log: twin.Log, joint: str | None) -> "Movement":
    from twin.view.replay import movement

    try:
        return movement(log, joint)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _traces(
    log: str | None, ghost: str | None, joint: str | None, params: str | None, map: str | None, option: str
) -> tuple[str, str, "Traces"]:
    """The log, its joint, and its traces beside the twin's; raises InputError where one joint is not known."""
    if log is None:
        raise InputError(f"{option} is given without a LOG; give the log first: qpal view LOG {option} ...")
    if ghost is not None:
        raise InputError(f"{option} and --ghost are given and there is one ghost; leave one of the two out")
    from twin.compare.comparison import twin_response
    from twin.view.traces import Traces

    first_log = twin.Log.load(log, map)
    joint_name = first_log.joint if first_log.joint in twin.JOINTS else joint
    if joint_name is None or (joint is not None and joint != joint_name):
        raise InputError(f"{option} needs one joint that {log} has; give --joint ({', '.join(twin.JOINTS)})")
    response = twin_response(
        first_log, joint_name, options.parameters(params), str(first_log.meta.get("pot_side", "link"))
    )
    return log, joint_name, Traces(joint_name, response.t, response.u, response.y, response.twin)


def _with_twin(replay: "Replay", traces: "Traces", params: str | None) -> "Replay":
    """The replay with the twin's movement as ghost."""
    from dataclasses import replace

    from twin.view.replay import Movement

    leg = Movement(traces.t, {traces.joint: traces.log})
    ghost = Movement(traces.t, {traces.joint: traces.twin})
    return replace(replay, leg=leg, ghost=ghost, parameters=options.parameters(params) or replay.parameters)


def _write_mcap(target: str, traces: "Traces") -> None:
    from twin.view.traces import write_mcap

    path = Path(target)
    check_writable_file(path)
    write_mcap(path, traces)
    note_result(path)
    print(f"Log and twin: {target}")


def _write_strip(replay: "Replay | None", names: list[str], count: int, path: Path, traces: "Traces | None") -> None:
    from sysid.base.style import png
    from twin.view import pictures

    figure = pictures.robot_views() if replay is None else pictures.strip(replay, pictures.Names(*names), count, traces)
    path.write_bytes(png(figure))


def _write_frames(
    replay: "Replay", names: list[str], speed: float, frames: str | None, gif: str | None, traces: "Traces | None"
) -> None:
    """Write the frames of the replay as numbered pictures into a folder, or as one GIF."""
    from twin.view import pictures

    times = pictures.frame_times(replay, speed, pictures.RATE if gif is None else pictures.GIF_RATE)
    with console.progress(1) as step:
        step(f"{len(times)} frames")

        def tell(count: int) -> None:
            step.part(count / len(times), f"{count} of {len(times)} frames")

        size = (pictures.WIDTH, pictures.HEIGHT) if gif is None else pictures.GIF
        images = pictures.frames(replay, times, pictures.Names(*names), tell, traces, size)
        if gif is not None:
            _write_picture(gif, ".gif", lambda path: pictures.save_gif(images, path))
        elif frames is not None:
            with output_folder(Path(frames)) as scratch:
                n_written = pictures.save_frames(images, scratch)
            print(f"Frames: {n_written} in {frames}")


def _write_picture(target: str, suffix: str, write: Callable[[Path], None]) -> None:
    """Write the file `target` under a temporary name first, so that no incomplete file appears."""
    path = Path(target)
    if path.suffix.lower() != suffix:
        raise InputError(f"{target} ends in {path.suffix or 'no suffix'!r}; give a name that ends in {suffix}")
    check_writable_file(path)
    with atomic_file(path) as temporary:
        write(temporary)
    note_result(path)
    print(f"Picture: {target}")
