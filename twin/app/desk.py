"""What a person does on the page: add a log, prepare it, fit, compare, calibrate, take files away; nothing is drawn.

Records and models are in the session, work is in jobs; what a job has made is taken into the session when it is whole.
"""

import re
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError, readable
from sysid.base.files import read_limited
from sysid.data.record import IOData
from sysid.formats import TABLE as FORMATS
from twin.app import stored
from twin.app.entries import AUTO, MOST, Data, Finding, Model, Prepare, Setting, Step, Study, Twin
from twin.app.jobs import Job, Jobs
from twin.app.rig import Rig
from twin.app.samples import Runs, load_record, load_runs
from twin.app.script import script
from twin.app.session import Session
from twin.app.undo import History
from twin.parameters import JOINTS
from twin.rig.journal import recover

FILES = {  # what can be taken away of a model: name, and what it is
    "script.py": "Python that does the same",
    "report.html": "report",
    "model.json": "the fit for sysid.load",
    "model.h": "C99, the structs",
    "model.c": "C99, the functions",
    "model.py": "Python without libraries",
    "joint.xml": "MJCF of the joint",
}
STUDY_FILES = {"report.html": "report", "parameters.toml": "parameters for --params"}
UNREAD = "it has not been read yet"


class Desk:
    """A session and its jobs."""

    def __init__(self, session: Session, jobs: Jobs | None = None) -> None:
        self.session = session
        self.jobs = jobs or Jobs()
        self.history = History()
        self._records: dict[str, tuple[float, IOData]] = {}
        self.rig = Rig(session.folder, self.keep_run)
        logs = session.folder / "rig"
        if logs.is_dir() and not logs.is_symlink():
            self._take_in(logs)

    def _take_in(self, logs: Path) -> None:
        """Take in the logs of runs whose line, or app, was killed."""
        try:
            recover(logs)
        except (InputError, OSError) as error:
            self.session.complaints.append(f"a run on the rig is left out: {error}")
        for log in sorted(logs.glob("run-*.csv")):
            if log.is_file() and not log.is_symlink():
                self.keep_run(log, "", f"rig, {log.stem}")

    @property
    def version(self) -> tuple[int, int]:
        """Changes with every change."""
        return self.session.version, self.jobs.version

    def close(self) -> None:
        """End the drive of a rig, and the jobs; the session stays as it is."""
        self.rig.disconnect()
        self.jobs.close()
        self.session.close()

    def add_log(self, name: str, file: Path) -> str:
        """Take a log into the session and read it; `name` comes from a browser and is shown, never used as a path."""
        text = display_name(name)
        entry = Data(name=text, suffix=suffix_of(text))
        key = self.session.add(entry, lambda folder: _move_file(file, folder / entry.file))
        self.session.change(shown=key)
        self.read(key)
        return key

    def keep_run(self, log: Path, joint: str, name: str) -> str:
        """Take the log of a run on the rig into the session and read it."""
        entry = Data.from_form({"name": name[:200], "suffix": log.suffix, "joint": joint if joint in JOINTS else ""})
        key = self.session.add(entry, lambda folder: _move_file(log, folder / entry.file))
        self.session.change(shown=key)
        self.read(key)
        return key

    def make(self, **settings: Any) -> Job:
        """Make a log with the twin; raises InputError for settings that are out of their limits."""
        return self.simulate(Twin.from_form(settings))

    def simulate(self, settings: Twin) -> Job:
        """Make a log with the twin."""
        self.session.change(twin=settings)

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "ready" in answer:
                name = f"twin {settings.joint} {settings.excitation} {settings.duration:g} s, seed {settings.seed}"
                entry = Data(name=name, suffix=".csv", twin=settings, joint=settings.joint)
                key = self.session.add(entry, lambda folder: _move_file(job.out / "log.csv", folder / entry.file))
                self.session.change(shown=key)
                self.read(key)

        title = f"twin: {settings.excitation}, {settings.duration:g} s"
        return self.jobs.submit(title, {"task": "simulate", "twin": settings.model_dump(mode="json")}, hear)

    def read(self, key: str) -> Job:
        """Read the log of a record, then give advice on it."""

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "columns" in answer:
                joint = answer["joint"] if answer["joint"] in JOINTS else self.session.data[key].joint
                self.session.change_data(key, columns=tuple(answer["columns"]), joint=joint)
            elif "ready" in answer:
                self.session.add_file("data", key, job.out / "record.npz")
                self._records.pop(key, None)
                self.session.change_data(key, notes=tuple(answer["ready"]["notes"]), problem="", advice=None)
                self.advise(key)
            elif "failed" in answer:
                self.session.change_data(key, problem=answer["failed"])

        return self.jobs.submit("reading", self._request("read", key), hear, key)

    def choose_columns(
        self, key: str, input: str | None, output: str | None, time: str | None, Ts: float | None
    ) -> Job:
        """Read a log again by these columns, "a,b" for two; raises InputError for columns that it lacks."""
        self.session.log(key)  # raises InputError for a record that was removed meanwhile
        entry = self.session.data[key]
        for column in (*several(input, entry.columns), *several(output, entry.columns), *several(time, entry.columns)):
            if column not in entry.columns:
                raise InputError(f"the log has no column {column!r}; it has {', '.join(entry.columns)}")
        previous = {"input": entry.input, "output": entry.output, "time": entry.time, "Ts": entry.Ts}

        def read(**columns: Any) -> Job:
            self.session.change_data(key, **columns, problem="")
            return self.read(key)

        job = read(input=input, output=output, time=time, Ts=Ts)
        self.history.add(f"the columns of {key}", lambda: read(**previous))
        return job

    def prepare(self, key: str, **fields: Any) -> None:
        """Set what is done to a record before a fit; raises InputError, and changes nothing, if it cannot be done."""
        self._readable(key)
        previous = self.session.data[key].prepare
        steps = Prepare.from_form({**previous.model_dump(), **fields})
        if steps == previous:
            return
        steps.preparation().apply(self.record(key))
        self.session.change_data(key, prepare=steps, advice=None)
        self.history.add(
            f"the preparation of {key}", lambda: self.session.change_data(key, prepare=previous, advice=None)
        )

    def advise(self, key: str) -> Job:
        """Advice on a record as it is prepared."""
        prepare = self.session.data[key].prepare

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "ready" in answer and key in self.session.data and self.session.data[key].prepare == prepare:
                findings = tuple(Finding.model_validate(finding) for finding in answer["ready"])
                self.session.change_data(key, advice=findings)

        return self.jobs.submit("advice", self._request("advise", key), hear, key)

    def setting(self, **fields: Any) -> Setting:
        """A setting from what a form holds; raises InputError for what is out of its limits."""
        return Setting.from_form(fields)

    def fit(self, key: str, setting: Setting, further: Sequence[str] = (), validation: Sequence[str] = ()) -> Job:
        """Fit a structure to a record, or search for one; raises InputError for settings that give no model.

        Records in `further` are experiments of the same fit, those in `validation` judge it.
        """
        title = setting.title()
        for other in (key, *further, *validation):
            self._readable(other)
        self._check_alike(key, (*further, *validation))
        self.session.change(setting=setting)
        request = self._request_of("fit", key, further, validation)
        request |= {"setting": setting.model_dump(mode="json"), "start": self._start(setting.start)}
        model_keys: list[str] = []

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "ready" in answer:
                entry = Model.model_validate(answer["ready"])
                model_keys.append(self.session.add(entry, lambda folder: _move_files(job.out / "files", folder)))
            elif "report" in answer and model_keys:
                self.session.add_file("models", model_keys[0], job.out / "report.html")

        return self.jobs.submit(title, request, hear, key)

    def take_step(self, key: str, step: Step) -> Job:
        """Fit as a step after the model `key` says, to the records and with the preparation of that model."""
        self.session.file("models", key, "")  # raises InputError for a model that was removed meanwhile
        model, setting = self.session.models[key], step.setting
        if setting is None:
            raise InputError(f"{step.why}; no fit does this")
        detrend = model.prepare.detrend
        if detrend == "linear" if setting.structure == AUTO else setting.recipe().zero:
            detrend = None  # it takes absolute signals
        self.prepare(model.data, **{**model.prepare.model_dump(), "detrend": detrend})
        self.session.change(shown=model.data)
        return self.fit(model.data, setting, model.further, model.validation)

    def refine(self, model: str, key: str) -> Job:
        """Fit a model of the session to a record once more, from the values that it has."""
        self._start(model)  # raises InputError for a model that was removed meanwhile
        fields = {"start": model, "fixed": {}, "bounds": {}}
        return self.fit(key, self.session.models[model].setting.model_copy(update=fields))

    def study(self, key: str, kind: str, joint: str, further: Sequence[str] = ()) -> Job:
        """Put a record beside the twin ("compare"), or fit the twin to it and to `further` ones ("calibrate")."""
        if joint not in JOINTS:
            raise InputError(f"joint is {joint or 'not named'}; choose one of {', '.join(JOINTS)}")
        for other in (key, *further):
            self._readable(other)
        words = {"compare": "beside the twin", "calibrate": "calibrating the twin"}
        request = {**self._request_of(kind, key, further), "joint": joint}
        return self.jobs.submit(f"{joint} {words[kind]}", request, self._hear_study, key)

    def run(self, key: str, model: str, horizon: int | None = None) -> Job:
        """Run a model of the session on a record, and predict `horizon` samples ahead if that is given."""
        self._readable(key)
        request = {**self._request("run", key), "start": self._start(model), "model": model, "horizon": horizon}
        return self.jobs.submit(f"{model} on {key}", request, self._hear_study, key)

    def _hear_study(self, job: Job, answer: dict[str, Any]) -> None:
        if "ready" in answer:
            entry = Study.model_validate(answer["ready"])
            self.session.add(entry, lambda folder: _move_files(job.out, folder))

    def _start(self, model: str | None) -> str | None:
        """The file of a saved model; raises InputError for one that is not there."""
        return None if model is None else str(self.session.file("models", model, "model.json"))

    def _check_alike(self, key: str, others: Sequence[str]) -> None:
        """Raises InputError for records that are read by other columns, since one choice counts for all of a fit."""
        first = self.session.data[key]
        for other in others:
            entry = self.session.data[other]
            if any(getattr(entry, name) != getattr(first, name) for name in ("input", "output", "time", "Ts")):
                raise InputError(
                    f"{other} is read by other columns than {key}; choose the same ones for both under Columns"
                )

    def record(self, key: str) -> IOData:
        """The record as it was read; raises InputError where it was not."""
        path = self._readable(key)
        stamp = path.stat().st_mtime
        if key not in self._records or self._records[key][0] != stamp:
            self._records[key] = stamp, load_record(path)
        return self._records[key][1]

    def prepared_record(self, key: str) -> tuple[IOData, tuple[str, ...]]:
        """The record after its preparation, and what was done in sentences."""
        return self.session.data[key].prepare.preparation().steps(self.record(key))

    def runs(self, key: str) -> Runs:
        """The free runs of a model."""
        return load_runs(self.session.file("models", key, "runs.npz"))

    def overlaid(self, ticks: Iterable[str], key: str | None) -> tuple[list[str], list[str]]:
        """Of the ticked models those of the record `key` alone, and those of other records, or of several."""
        models = [model for model in self.session.models if model in set(ticks)]
        same_record = [model for model in models if self.session.models[model].records == (key,)]
        return same_record, [model for model in models if model not in same_record]

    def figures(self, kind: str, key: str) -> dict[str, Any]:
        """The figures of a model or a study, each with its caption; raises InputError for a damaged file."""
        path = self.session.file(kind, key, "figures.json")
        try:
            found = stored.figures(read_limited(path, MOST))
            return {readable(name): {**entry, "caption": readable(entry["caption"])} for name, entry in found.items()}
        except (OSError, ValueError, TypeError, RecursionError):
            raise InputError(f"the figures of {key} are damaged; fit or compare again") from None

    def files(self, kind: str, key: str) -> dict[str, str]:
        """What can be taken away of a model or a study, by name; files that it does not have are left out."""
        self.session.file(kind, key, "")  # raises InputError for an entry that is not there
        file_names = FILES if kind == "models" else STUDY_FILES
        return {
            name: words
            for name, words in file_names.items()
            if self.session.has(kind, key, name)
            or (name == "script.py" and set(self.session.models[key].records) <= set(self.session.data))
        }

    def content(self, kind: str, key: str, name: str) -> bytes:
        """A file of `files`; raises InputError for any other name."""
        if kind not in ("models", "studies") or name not in self.files(kind, key):
            raise InputError("there is no such file in this session")
        if name == "script.py":
            model = self.session.models[key]
            logs, judges = (
                [self.session.log(record) for record in records]
                for records in ((model.data, *model.further), model.validation)
            )
            start = self._start(model.setting.start)
            text = script(model, self.session.data[model.data], logs, judges, Path(start) if start else None)
            return text.encode("utf-8")
        content = read_limited(self.session.file(kind, key, name), MOST)
        return stored.report(content) if name == "report.html" else content

    def remove(self, kind: str, key: str) -> None:
        """Delete a record, a model or a study; a record's jobs end, and its models stay."""
        for job in [job for job in self.jobs.all if job.subject == key]:
            self.jobs.cancel(job)
        shown = self.session.head.shown
        self.session.remove(kind, key)
        if shown == key:
            self.session.change(shown=next(reversed(self.session.data), None))

        def restore() -> None:
            self.session.restore(kind, key)
            if shown == key:
                self.session.change(shown=key)

        self.history.add(f"the deletion of {key}", restore)

    def _readable(self, key: str) -> Path:
        path = self.session.file("data", key, "record.npz")
        if not self.session.has("data", key, "record.npz"):
            entry = self.session.data[key]
            problem = entry.problem or UNREAD
            raise InputError(problem if problem.startswith(f"{entry.name}:") else f"{entry.name}: {problem}")
        return path

    def _request(self, task: str, key: str) -> dict[str, Any]:
        entry = self.session.data[key].model_dump(mode="json")
        return {"task": task, "key": key, "data": entry, "log": str(self.session.log(key))}

    def _request_of(
        self, task: str, key: str, further: Sequence[str] = (), validation: Sequence[str] = ()
    ) -> dict[str, Any]:
        """The request of a task on several records: their logs in order, those that judge, and the name of each."""
        logs = {other: str(self.session.log(other)) for other in (key, *further, *validation)}
        return {
            **self._request(task, key),
            "further": list(further),
            "validation": list(validation),
            "entries": [self.session.data[other].model_dump(mode="json") for other in further],
            "logs": [logs[other] for other in (key, *further)],
            "judges": [logs[other] for other in validation],
            "names": {path: self.session.data[other].name for other, path in logs.items()},
        }


def several(text: str | None, columns: Sequence[str]) -> tuple[str, ...]:
    """The columns that a text names: one, whose name may hold commas, or several with commas between them."""
    return () if text is None else (text,) if text in columns else tuple(part.strip() for part in text.split(","))


def display_name(name: str) -> str:
    """A file's name from a browser as a short text without folders and control characters."""
    last = re.split(r"[\\/]", name)[-1]
    return re.sub(r"[^\w.()+ -]", "_", last).strip()[-120:] or "log"


def suffix_of(name: str) -> str:
    """The suffix of a log that some format reads; raises InputError for another."""
    suffix = Path(name).suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{name} ends in {suffix or 'no suffix'!r}; give a log: {', '.join(FORMATS)}")
    return suffix


def _move_file(file: Path, target: Path) -> None:
    shutil.move(file, target)


def _move_files(source: Path, folder: Path) -> None:
    for file in source.iterdir():
        if file.is_file() and file.name != "stderr.txt":
            shutil.move(file, folder / file.name)
