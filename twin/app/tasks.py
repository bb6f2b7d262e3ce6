"""The work that jobs do: read, simulate, advise, fit, compare, calibrate; each in a process of its own, this module.

The process gets one request as a line on standard input and answers in lines of JSON on standard output. Each task
writes whole files into the folder "out" of its request, tells how far it is, and says {"ready": entry} when the files
can be taken. Raises InputError, which the page shows as it is.
"""

import itertools
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import atomic_file, json_value, write_text
from sysid.data.record import IOData
from sysid.workflow.record import Record, read_record
from twin.app.entries import Data, Finding, Model, Setting, Study, Twin, save_record, save_runs

Tell = Callable[..., None]
USUAL = 20  # searches of a fit, of which nobody knows the number: the bar moves ever more slowly
COMPARED = ("signs", "effects", "alignment", "joint")  # steps of a comparison, about
SEARCHED = 24  # steps of a calibration; it rarely has more


def open_record(log: Path, entry: Data) -> Record:
    """The record in a log, by the columns that the entry names; raises InputError as `read_record` does."""
    return read_record(log, entry.input, entry.output, entry.Ts, entry.time)


def fit_parts(record: Record, entry: Data, setting: Setting) -> tuple[IOData, IOData, tuple[str, ...]]:
    """Estimation and validation data for a fit, and what was done to the record in sentences.

    Both are all of a record whose halves are no two parts, as on the command line; raises InputError for other shares
    that are none.
    """
    from sysid.workflow.evaluation import moves_in_one_part
    from sysid.workflow.record import without_wraps

    kind = setting.recipe()
    if kind.zero:  # absolute angles count on over a turn
        record = without_wraps(record)
    steps = entry.prepare.preparation()
    data, sentences = replace(steps, detrend=kind.detrend(steps.detrend)).steps(record.data)
    estimation, validation = data.split(setting.split)
    if moves_in_one_part(estimation, validation):
        half = Setting().split
        if setting.split != half:
            raise InputError(
                f"with {setting.split:g} as the estimation part the input moves in one of the two parts alone; choose "
                f"{half:g}: where the halves are so too, as in a step test, all is used for the fit"
            )
        estimation = validation = data
    return estimation, validation, (*record.remarks, *sentences)


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
    """Fits a model; its files are ready before the report is drawn."""
    from sysid.workflow.evaluation import check_parts, evaluate
    from sysid.workflow.results import without_validation
    from sysid.workflow.saved import export
    from sysid.workflow.setting import Setting as Settings
    from twin.app import figures

    start_time = time.perf_counter()
    entry, setting = Data.model_validate(request["data"]), Setting.model_validate(request["setting"])
    out = Path(request["out"])
    files = out / "files"
    files.mkdir()
    tell(said="reading", share=0.02)
    record = open_record(Path(request["log"]), entry)
    estimation, validation, sentences = fit_parts(record, entry, setting)
    check_parts(estimation, validation)
    tell(said="fitting", share=0.05)
    step = _counter(tell, lambda k: 0.05 + 0.85 * k / (k + USUAL), "search")
    settings = Settings(setting.recipe(), "auto", setting.starts, setting.seed)
    evaluation = evaluate(settings, estimation, validation, step)
    whole = validation is estimation
    evaluation = without_validation(evaluation) if whole else evaluation
    seconds = time.perf_counter() - start_time
    tell(said="drawing", share=0.92)
    exports = export(evaluation, files)
    notes = [*sentences, *evaluation.notes, *exports.notes]
    notes += _mjcf(evaluation.fit, files)
    start = entry.prepare.start or 0.0
    plots, complaints = figures.of_model(evaluation, start)
    write_text(files / "figures.json", json.dumps(json_value(plots), allow_nan=False))
    save_runs(evaluation, start, files / "runs.npz")
    criteria = evaluation.fit.criteria
    model = Model(
        name=request["name"],
        data=request["key"],
        prepare=entry.prepare,
        setting=setting,
        fit_estimation=_finite(evaluation.estimation_fit),
        fit_validation=_finite(evaluation.validation_fit),
        d=int(criteria.d),
        N=int(criteria.N),
        seconds=seconds,
        converged=bool(evaluation.fit.stop.converged),
        joint=(files / "joint.xml").exists(),
        whole=whole,
        notes=(*notes, *complaints),
    )
    tell(ready=model.model_dump(mode="json"))
    tell(said="writing the report", share=0.96)
    named_record = replace(record, path=Path(entry.name))
    _report(named_record, entry, setting, evaluation, exports, out / "report.html")
    tell(report=True)


def compare(request: dict[str, Any], tell: Tell) -> None:
    """Puts a log beside the twin under the same input."""
    from twin.app import figures
    from twin.compare.comparison import compare as run
    from twin.report import compare as report

    start = time.perf_counter()
    log, name, joint = _twin_log(request)
    step = _counter(tell, lambda k: k / (k + len(COMPARED)))
    result = run(log, joint, pot_side=str(log.meta.get("pot_side", "link")), threads=1, tell=step)
    page, sentences = report.page(result, name), report.sentences(result, name)
    _study(request, "compare", sentences, start, page, figures.of_comparison(result), tell)


def calibrate(request: dict[str, Any], tell: Tell) -> None:
    """Fits the twin's parameters to a log, and writes them as a file for --params."""
    from twin.app import figures
    from twin.calibrate.advice import write
    from twin.calibrate.calibration import calibrate as run
    from twin.report import calibrate as report

    start = time.perf_counter()
    log, name, joint = _twin_log(request)
    result = run([log], joint, labels=[name], threads=1, progress=_counter(tell, lambda k: min(k / SEARCHED, 0.95)))
    write(result, Path(request["out"]) / "parameters.toml")
    sentences = [*report.sentences(result), *report.undetermined_sentences(result)]
    _study(request, "calibrate", sentences, start, report.page(result), figures.of_calibration(result), tell)


TABLE: dict[str, Callable[[dict[str, Any], Tell], None]] = {
    each.__name__: each for each in (read, simulate, advise, fit, compare, calibrate)
}


def _counter(tell: Tell, share: Callable[[int], float], name: str = "") -> Callable[[str], None]:
    """Tells each step with its share of the work, by its number; with a `name` the sentence has the number too."""
    numbers = itertools.count(1)

    def step(text: str) -> None:
        k = next(numbers)
        tell(said=f"{name} {k}, {text.replace('_', ' ')}" if name else text, share=share(k))

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
    out = Path(request["out"])
    write_text(out / "report.html", page.html())
    write_text(out / "figures.json", json.dumps(json_value(plots), allow_nan=False))
    study = Study(
        kind=kind,
        data=request["key"],
        joint=request["joint"],
        sentences=tuple(sentences),
        seconds=time.perf_counter() - start,
    )
    tell(ready=study.model_dump(mode="json"))


def _twin_log(request: dict[str, Any]) -> tuple[Any, str, str]:
    """The log of a record for the twin, with its name and joint."""
    from twin.log import Log

    entry = Data.model_validate(request["data"])
    if entry.input or entry.output or entry.time or entry.Ts:
        raise InputError(
            "the twin reads columns by their names and units, and this record's were chosen by hand; write a mapping: "
            "qpal info FILE --write-map MAP.toml, then qpal compare FILE --map MAP.toml"
        )
    return Log.load(Path(request["log"]), None, request["joint"]), entry.name, request["joint"]


def _mjcf(model_fit: Any, folder: Path) -> list[str]:
    """joint.xml where MJCF has elements for all of an actuated joint; else why not, for a joint."""
    from sysid.estimation.joint_parts import is_joint
    from sysid.estimation.result import Fit
    from sysid.export import mjcf

    if not isinstance(model_fit, Fit) or not is_joint(model_fit.model):
        return []
    try:
        write_text(folder / "joint.xml", mjcf.fragment(model_fit, "joint").model())
    except InputError as error:
        return [f"no MJCF: {error}"]
    return []


def _report(record: Record, entry: Data, setting: Setting, evaluation: Any, exports: Any, path: Path) -> None:
    """Write the report of a fit."""
    from sysid.report import identify as report
    from sysid.workflow.next_step import next_step
    from sysid.workflow.plan import Plan
    from sysid.workflow.results import Identification

    steps = entry.prepare.preparation()
    detrend = setting.recipe().detrend(steps.detrend)
    plan = Plan(split=setting.split, detrend=detrend, preparation=steps, whole=not evaluation.unseen)
    result = Identification(record, plan, evaluation, ())
    with atomic_file(path) as temporary:
        temporary.write_text(report.page(replace(result, next=next_step(result)), exports).html(), encoding="utf-8")


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


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
        name = str(request.get("data", {}).get("name", "the log"))
        tell(error=str(error).replace(str(request.get("log", "\0")), name))
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
