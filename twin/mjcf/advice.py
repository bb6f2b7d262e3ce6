"""The one command to try after a calibration of a robot, or a comparison with it."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from twin.mjcf.calibration import RobotCalibration
from twin.mjcf.comparison import RobotComparison
from twin.mjcf.parameters import USUAL
from twin.mjcf.writing import file_name

OTHER = "OTHER.csv"  # a log of another kind of motion, that is still to be recorded


def calibrate_command(
    used: Sequence[str], rest: Sequence[str], free: Sequence[str], held: Sequence[str] = (), *more: str
) -> str:
    """The command that calibrates the kinds `free` from the logs `used`; `rest` are words of its options."""
    held_words = ["--hold-out", ",".join(held)] if held else []
    free_words = [] if tuple(free) == USUAL else ["--free", ",".join(free)]
    return shlex.join(["qpal", "calibrate", *used, *rest, *free_words, *held_words, *more])


def after_comparison(result: RobotComparison, file: str, rest: Sequence[str]) -> str:
    """What to do after the comparison of the log `file`; `rest` are the words of its command beside it."""
    if result.named:
        return f"Next: {calibrate_command([file], rest, result.named)}"
    if result.nothing or not result.chain:
        return (
            f"Next: record another kind of motion as {OTHER}, and compare that too: "
            f"{shlex.join(['qpal', 'compare', OTHER, *rest])}"
        )
    nearest = result.chain[-1].kinds
    return (
        f"Next: record another kind of motion as {OTHER}, and see whether the model is better there with what this log "
        f"says of {' and '.join(nearest)}: {calibrate_command([file], rest, nearest, [OTHER])}"
    )


def next_step(
    result: RobotCalibration,
    files: Sequence[str],
    held_out: Sequence[str],
    rest: Sequence[str],
    seed: int,
    folder: Path,
) -> str:
    """What to do next, with its command. `files` and `held_out` were read; `rest` are the other words of that command.

    NEW.csv and OTHER.csv stand for logs that are still to be recorded. The results are in `folder`; `seed` is that of
    the starts.
    """

    kinds = list(dict.fromkeys(each.kind.name for each in result.parameters))

    def command(used: Sequence[str], held: Sequence[str], *more: str, free: Sequence[str] = kinds) -> str:
        return calibrate_command(used, rest, free, held, *more)

    unknown = [value.name for value in result.values if not value.determined]
    if result.optimum.late:
        return f"Next: without --seconds the search ends by itself: {command(files, held_out)}"
    if not result.optimum.stop.converged:
        return f"Next: search from other starts: {command(files, held_out, '--seed', str(seed + 1))}"
    if result.worse:
        unseen = tuple(dict.fromkeys(run.log for run in result.worse))
        worse = [file for file in held_out if Path(file).name in unseen]
        held = [file for file in held_out if file not in worse]
        return (
            f"Next: use {', '.join(unseen)} too, which shows what the others do not: {command([*files, *worse], held)}"
        )
    if result.lacking and "backlash" not in kinds:
        return (
            "Next: try whether a play between joint and encoder is what the model lacks: "
            f"{command(files, held_out, free=[*kinds, 'backlash'])}"
        )
    if unknown:
        return (
            f"Next: record {', '.join(unknown)} in faster and larger motions as NEW.csv, and use it too: "
            f"{command([*files, 'NEW.csv'], held_out)}"
        )
    if not held_out:
        return f"Next: record another kind of motion as OTHER.csv, and judge the model on it: {command(files, [OTHER])}"
    viewer = ["python", "-m", "mujoco.viewer", f"--mjcf={folder / file_name(result.robot)}"]
    return f"Next: look at the calibrated robot: {shlex.join(viewer)}"
