"""The work that jobs do: read, simulate, advise, fit, run, compare, calibrate; each in a process of its own.

The process gets one request as a line on standard input and answers in lines of JSON on standard output. Each task
writes whole files into the folder "out" of its request, tells how far it is, and says {"ready": entry} when the files
can be taken. Raises InputError, which the page shows as it is.
"""

import itertools
import json
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from sysid.base.errors import InputError
from sysid.base.files import json_value, write_text
from sysid.workflow.record import Record, read_record
from twin.app.entries import Data, Finding, Study, Twin
from twin.app.samples import save_record
from twin.app.words import words_of_page

Tell = Callable[..., None]
COMPARED = ("signs", "effects", "alignment", "joint")  # steps of a comparison, about
SEARCHED = 24  # steps of a calibration; it rarely has more


def open_record(log: Path, entry: Data) -> Record:
    """The record in a log, by the columns that the entry names; raises InputError as `read_record` does."""
    return read_record(log, entry.input, entry.output, entry.Ts, entry.time)


def read(request: dict[str, Any], tell: Tell) -> None:
    """Reads a log into record.npz; the columns are told first, for a person to choose from where the guess fails."""
    from sysid.formats import read_table

    entry, log, out = Data.model_validate(request["data"]), Path(request["log"]), Path(request["out"])
    tell(said="reading the columns", share=0.1)
    table = read_table(log)
    columns = [str(name)[:100] for name in table.names][:500]
    tell(columns=columns, joint=str(table.meta.get("joint", "")))
    tell(said="sampling", share=0.5)
    record = open_record(log, entry)
    save_record(record.data, out / "record.npz")
    tell(ready=json_value({"notes": list(record.notes), "input": record.input, "output": record.output}))


def simulate(request: dict[str, Any], tell: Tell) -> None:
    """Runs an experiment on the twin and writes its log."""
    from twin.experiment import Experiment

    s, out = Twin.model_validate(request["twin"]), Path(request["out"])
    tell(said=f"{s.duration:g} s of {s.excitation} on the {s.joint}", share=0.2)
    experiment = Experiment(s.joint, s.excitation, s.duration, s.Ts, s.seed, s.without)
    experiment.run().save(out / "log.csv")
    tell(ready={})


def advise(request: dict[str, Any], tell: Tell) -> None:
    """Advice on a record as it is prepared."""
    from sysid.diagnosis.advice import advise as say

    entry = Data.model_validate(request["data"])
    tell(said="reading", share=0.1)
    data = entry.prepare.preparation().apply(open_record(Path(request["log"]), entry).data)
    tell(said="looking at the record", share=0.4)
    fields = set(Finding.model_fields)
    findings = [Finding.model_validate({k: v for k, v in vars(a).items() if k in fields}) for a in say(data)]
    tell(ready=[finding.model_dump() for finding in findings])


def fit(request: dict[str, Any], tell: Tell) -> None:
    """Fits a model; see `twin.app.fits`."""
    from twin.app.fits import fit as run

    run(request, tell)


def run(request: dict[str, Any], tell: Tell) -> None:
    """Runs a saved model on a record, in free run and, if that is asked for, some samples ahead."""
    from sysid.report import saved_models as report
    from sysid.workflow.model_run import run_file
    from sysid.workflow.saved import Reading
    from twin.app import figures

    start = time.perf_counter()
    entry = Data.model_validate(request["data"])
    tell(said="reading", share=0.1)
    reading = Reading(request["log"], entry.input, entry.output, entry.Ts, entry.time, resampled=True)
    result = run_file(request["start"], reading, request["horizon"], lambda: tell(said="running", share=0.5))
    sentences = report.run_sentences(result)
    _study(request, "run", sentences, start, report.run_page(result), figures.of_run(result), tell)


def compare(request: dict[str, Any], tell: Tell) -> None:
    """Puts a log beside the twin under the same input."""
    from twin.app import figures
    from twin.compare.comparison import compare as run
    from twin.report import compare as report

    start = time.perf_counter()
    log = _twin_log(request["log"], Data.model_validate(request["data"]), request["joint"])
    step = _counter(tell, lambda k: k / (k + len(COMPARED)))
    result = run(log, request["joint"], pot_side=str(log.meta.get("pot_side", "link")), threads=1, tell=step)
    name = shlex.quote(request["data"]["name"])
    page, sentences = report.page(result, name), report.sentences(result, name)
    _study(request, "compare", sentences, start, page, figures.of_comparison(result), tell)


def calibrate(request: dict[str, Any], tell: Tell) -> None:
    """Fits the twin's parameters to logs, and writes them as a file for --params."""
    from twin.app import figures
    from twin.calibrate.advice import write
    from twin.calibrate.calibration import calibrate as run
    from twin.report import calibrate as report

    start = time.perf_counter()
    entries = [Data.model_validate(entry) for entry in (request["data"], *request["entries"])]
    logs = [_twin_log(path, entry, request["joint"]) for path, entry in zip(request["logs"], entries, strict=True)]
    step = _counter(tell, lambda k: min(k / SEARCHED, 0.95))
    result = run(logs, request["joint"], labels=[entry.name for entry in entries], threads=1, progress=step)
    write(result, Path(request["out"]) / "parameters.toml")
    sentences = [*report.sentences(result), *report.undetermined_sentences(result)]
    _study(request, "calibrate", sentences, start, report.page(result), figures.of_calibration(result), tell)


TABLE: dict[str, Callable[[dict[str, Any], Tell], None]] = {
    each.__name__: each for each in (read, simulate, advise, fit, run, compare, calibrate)
}


def _counter(tell: Tell, share: Callable[[int], float]) -> Callable[[str], None]:
    """Tells each step with its share of the work, by its number."""
    numbers = itertools.count(1)

    def step(text: str) -> None:
        tell(said=text.replace("_", " "), share=share(next(numbers)))

    return step


def _study(
    request: dict[str, Any],
    kind: Any,
    sentences: list[str],
    start: float,
    page: Any,
    plots: dict[str, Any],
    tell: Tell,
) -> None:
    """Write the report and the figures of a study, and tell that it is ready."""
    from twin.app.fits import verdict_of

    out, names = Path(request["out"]), names_of(request)
    write_text(out / "report.html", page.html())
    write_text(out / "figures.json", json.dumps(json_value(plots), allow_nan=False))
    study = Study(
        kind=kind,
        data=request["key"],
        joint=request.get("joint", ""),
        model=request.get("model", ""),
        verdict=verdict_of(page.answer, names),
        sentences=tuple(words_of_page(sentence, names) for sentence in sentences),
        seconds=time.perf_counter() - start,
    )
    tell(ready=study.model_dump(mode="json"))


def _twin_log(path: str, entry: Data, joint: str) -> Any:
    """The log of a record for the twin; raises InputError for columns that were chosen by hand."""
    from twin.log import Log

    if entry.input or entry.output or entry.time or entry.Ts:
        raise InputError(
            "the twin reads columns by their names and units, and this record's were chosen by hand; write a mapping: "
            "qpal info FILE --write-map MAP.toml, then qpal compare FILE --map MAP.toml"
        )
    return Log.load(Path(path), None, joint)


def names_of(request: dict[str, Any]) -> dict[str, str]:
    """The names on the page of the files of a request, by path."""
    name = str(request.get("data", {}).get("name", "the log"))
    return {str(request.get("log", "\0")): name, **request.get("names", {})}


def main() -> int:
    """Do the task of the request; 0 if it was done or said why not."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tell(**answer: Any) -> None:
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    return _do(request, tell, answers)


def _do(request: dict[str, Any], tell: Any, answers: TextIO) -> int:
    """Do the task of the request; what goes wrong is told as a sentence."""
    try:
        TABLE[request["task"]](request, tell)
    except InputError as error:
        tell(error=words_of_page(str(error), names_of(request)))
    except OSError as error:
        tell(
            error=f"a file of this job cannot be read or written ({error.strerror or error}); free disk space, and try "
            "again"
        )
    except MemoryError:
        tell(error="the memory of this machine is not enough for this; give a shorter range, or resample")
    answers.close()
    return 0


def _end_with_parent() -> None:
    """End this process and all that it started as soon as nobody holds the other end of standard input."""
    while os.read(0, 4096):
        pass
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(os.getpgrp(), signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
