"""What a person does on the page: add a log, prepare it, fit, compare, calibrate, take files away; nothing is drawn.

Records and models are in the session, work is in jobs; what a job has made is taken into the session when it is whole.
"""

import re
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError, readable
from sysid.base.files import read_limited
from sysid.data.record import IOData
from sysid.formats import TABLE as FORMATS
from twin.app import stored
from twin.app.entries import MOST, Data, Finding, Model, Prepare, Runs, Setting, Study, Twin, load_record, load_runs
from twin.app.jobs import Job, Jobs
from twin.app.rig import Rig
from twin.app.session import Session
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
        """Read a log again by these columns; raises InputError for columns that it lacks."""
        self.session.log(key)  # raises InputError for a record that was removed meanwhile
        columns = self.session.data[key].columns
        for column in (input, output, time):
            if column is not None and column not in columns:
                raise InputError(f"the log has no column {column!r}; it has {', '.join(columns)}")
        self.session.change_data(key, input=input, output=output, time=time, Ts=Ts, problem="")
        return self.read(key)

    def prepare(self, key: str, **fields: Any) -> None:
        """Set what is done to a record before a fit; raises InputError, and changes nothing, if it cannot be done."""
        self._readable(key)
        previous = self.session.data[key].prepare
        steps = Prepare.from_form({**previous.model_dump(), **fields})
        if steps == previous:
            return
        steps.preparation().apply(self.record(key))
        self.session.change_data(key, prepare=steps, advice=None)

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

    def fit(self, key: str, setting: Setting) -> Job:
        """Fit a structure to a record; raises InputError for settings that give no model."""
        recipe = setting.recipe()
        self._readable(key)
        self.session.change(setting=setting)
        request = {**self._request("fit", key), "setting": setting.model_dump(mode="json"), "name": str(recipe)}
        model_keys: list[str] = []

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "ready" in answer:
                entry = Model.model_validate(answer["ready"])
                model_keys.append(self.session.add(entry, lambda folder: _move_files(job.out / "files", folder)))
            elif "report" in answer and model_keys:
                self.session.add_file("models", model_keys[0], job.out / "report.html")

        return self.jobs.submit(str(recipe), request, hear, key)

    def study(self, key: str, kind: str, joint: str) -> Job:
        """Put a record beside the twin ("compare"), or fit the twin to it ("calibrate")."""
        if joint not in JOINTS:
            raise InputError(f"joint is {joint or 'not named'}; choose one of {', '.join(JOINTS)}")
        self._readable(key)

        def hear(job: Job, answer: dict[str, Any]) -> None:
            if "ready" in answer:
                entry = Study.model_validate(answer["ready"])
                self.session.add(entry, lambda folder: _move_files(job.out, folder))

        words = {"compare": "beside the twin", "calibrate": "calibrating the twin"}
        return self.jobs.submit(f"{joint} {words[kind]}", {**self._request(kind, key), "joint": joint}, hear, key)

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
        """Of the ticked models those of the record `key`, and those of other records."""
        models = [model for model in self.session.models if model in set(ticks)]
        same_record = [model for model in models if self.session.models[model].data == key]
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
            or (name == "script.py" and self.session.models[key].data in self.session.data)
        }

    def content(self, kind: str, key: str, name: str) -> bytes:
        """A file of `files`; raises InputError for any other name."""
        if kind not in ("models", "studies") or name not in self.files(kind, key):
            raise InputError("there is no such file in this session")
        if name == "script.py":
            model = self.session.models[key]
            text = script(model, self.session.data[model.data], self.session.log(model.data))
            return text.encode("utf-8")
        content = read_limited(self.session.file(kind, key, name), MOST)
        return stored.report(content) if name == "report.html" else content

    def remove(self, kind: str, key: str) -> None:
        """Delete a record, a model or a study; a record's jobs end, and its models stay."""
        for job in [job for job in self.jobs.all if job.subject == key]:
            self.jobs.cancel(job)
        self.session.remove(kind, key)
        if self.session.head.shown == key:
            self.session.change(shown=next(reversed(self.session.data), None))

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


def script(model: Model, data: Data, log: Path) -> str:
    """The script of a model that was fitted to the record `data`, whose log is at `log`.

    Names from files and people stand in it as Python literals alone, so that none of them is code. Raises InputError
    for settings that give no model.
    """
    recipe = model.setting.recipe()
    steps = model.prepare.preparation()
    steps = replace(steps, detrend=recipe.detrend(steps.detrend))
    selection = {"input": data.input, "output": data.output, "Ts": data.Ts, "time": data.time}
    columns = "".join(f", {name}={value!r}" for name, value in selection.items() if value is not None)
    settings = ", ".join(f"{name}={value!r}" for name, value in model.setting.settings.items())
    wraps = ["from sysid.workflow.record import without_wraps"] if recipe.zero else []
    search = recipe.auto
    options = f"search={search!r}, starts={model.setting.starts}, seed={model.setting.seed}"
    call = f"sysid.fit(recipe.model_of(estimation), estimation, {options})"
    if recipe.with_parts:
        call = f"sysid.fit_joint(estimation, recipe.model_of(estimation), {options}).fit"
    predicts = model.setting.structure in ("armax", "arx", "bj", "nlarx")  # their criteria are not those of a free run
    initial_samples, start = ("None", "fit.n_init") if predicts else ("estimation.N", "0")
    lines = [
        '"""A model that was fitted in qpal app, fitted again: python THIS_FILE [LOG]"""',
        "",
        "import sys",
        "",
        "import numpy as np",
        "",
        "import sysid",
        "from sysid.base.criteria import fit_percent",
        *wraps,
        "from sysid.workflow.record import read_record",
        "",
        f"log = sys.argv[1] if len(sys.argv) > 1 else {str(log)!r}  # it was added as {data.name!r}",
        f"record = read_record(log{columns})",
        *(["record = without_wraps(record)  # an angle that counts on over a turn"] if recipe.zero else []),
        "data = record.data",
        *steps.code("data"),
        "estimation = data" if model.whole else f"estimation, validation = data.split({model.setting.split!r})",
        f"recipe = sysid.structures.{type(recipe).__name__}({settings})",
        f"fit = {call}",
        "",
        f"run = np.ravel(fit.simulate(estimation, {initial_samples}))",
        f'print("fit on the estimation data:", repr(fit_percent(estimation.y[{start}:, 0], run[{start}:])), "%")',
        *(() if model.whole else ['print("fit on the validation data:", repr(fit.fit_percent(validation)), "%")']),
        'print(*(f"{name}: {value:.6g}" for name, value in fit.criteria.as_dict().items()), sep="\\n")',
        "",
    ]
    return "\n".join(lines)
