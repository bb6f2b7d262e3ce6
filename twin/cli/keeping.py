"""What outlasts a stop of `qpal rig`: logs of experiments, and room on the disk for a log."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base.errors import InputError
from twin.cli import environment
from twin.cli.cable import say
from twin.cli.console import Interruption
from twin.cli.output import check_writable_file
from twin.cli.results import note_result
from twin.cli.stopping import hold_requests

if TYPE_CHECKING:
    from twin.log import Log
    from twin.rig.auto import Campaign


def check_new_log(log: str) -> None:
    """Raises InputError before the work where the log of a run cannot be written, or is there already.

    Runs in its folder that were killed get their logs first.
    """
    from sysid.formats import check_written

    check_written(Path(log))
    check_writable_file(Path(log))
    recover_logs(Path(log).parent)
    if Path(log).exists():
        raise InputError(f"{log} is there already, and a record cannot be made again; give another --log")


def recover_logs(folder: Path) -> list[Path]:
    """Make the logs of killed runs in `folder`, and say so."""
    from twin.rig.journal import recover

    with hold_requests():
        made = recover(folder)
    for path in made:
        note_result(path)
        environment.say(f"qpal: {path} has the samples of a run that was killed")
    return made


def save_log(log: "Log", path: Path) -> None:
    """Write the log of a run. Raises InputError where that fails, with what still has its samples."""
    try:
        log.save(path)
    except (InputError, OSError) as error:
        raise InputError(
            f"the drive is off; {path} cannot be written ({error}): free some space, then make it by qpal rig recover "
            f"{path.parent}"
        ) from None


class Logs:
    """The logs of the experiments of `qpal rig auto`, in a folder that is made with the first."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def path(self, number: int) -> Path:
        """Where the log of an experiment goes."""
        self.place.mkdir(parents=True, exist_ok=True)
        return self.place / f"experiment-{number}.csv"

    def save(self, number: int, log: "Log") -> None:
        """Write it, at once and whole."""
        with hold_requests():
            if log.N:
                save_log(log, self.path(number))

    def found(self) -> list[Path]:
        """Those that are there; an empty folder goes."""
        paths = sorted(self.place.glob("*"))
        if self.place.exists() and not paths:
            self.place.rmdir()
        return paths


def write_campaign(result: "Campaign", scratch: Path) -> None:
    """The report of `qpal rig auto`. Raises InputError, or KeyboardInterrupt, where nothing was identified."""
    from sysid.report.page import write
    from twin.report import rig as report

    if not result.rounds and result.interrupted:
        raise KeyboardInterrupt
    if not result.rounds:
        raise InputError(f"{result.stopped}; nothing was identified")
    write(scratch, report.page(result), result.as_dict())


@contextmanager
def kept_logs(folder: Path, scratch: Path, as_json: bool = False) -> Iterator[Logs]:
    """Logs of experiments, which stay where they are if the verb is stopped, even killed.

    They are in NAME-logs beside `folder`, and move into `scratch` when all is done. Raises InputError where either
    folder has logs already.
    """
    if any(folder.glob("experiment-*.csv")):
        raise InputError(f"{folder} has the logs of a former run, which cannot be made again; give another --out")
    logs = Logs(folder.with_name(f"{folder.name}-logs"))
    if logs.found():
        recover_logs(logs.place)
        raise InputError(f"{logs.place} has the logs of a run that was stopped; move it, or give another --out")
    try:
        yield logs
    except KeyboardInterrupt:
        paths = logs.found()
        if as_json:
            say({"stopped": True, "logs": [str(path) for path in paths]}, as_json)
        if not paths:
            raise
        raise Interruption(f"the drive is off; the logs are in {logs.place}") from None
    except InputError as error:
        raise error if not logs.found() else InputError(f"{error}; the logs are in {logs.place}") from None
    with hold_requests():
        for path in logs.found():
            path.rename(scratch / path.name)
        logs.found()
