"""A fit of the app: the call of `qpal identify`, and what the page shows of its result."""

import json
import shlex
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import atomic_file, json_value, write_text
from sysid.model.recipes import Recipe
from sysid.report.answer import Answer
from sysid.workflow.changes import AUTO, changed_setting
from sysid.workflow.identification import identify_file
from sysid.workflow.results import Identification
from sysid.workflow.saved import Exports, export
from sysid.workflow.steps import NextStep
from twin.app.entries import Data, Model, Setting, Step, Verdict
from twin.app.samples import save_runs
from twin.app.words import words_of_page

USUAL = 20  # searches of a fit, of which nobody knows the number: the bar moves ever more slowly
SAID = {"starts": "{} starts", "split": "estimation part {}", "anew": "from new starts"}


def fit(request: dict[str, Any], tell: Callable[..., None]) -> None:
    """Fit a model, or search for one; its files are ready before the report is written."""
    from twin.app import figures

    start_time = time.perf_counter()
    entry, setting = Data.model_validate(request["data"]), Setting.model_validate(request["setting"])
    out = Path(request["out"])
    files = out / "files"
    files.mkdir()
    tell(said="reading", share=0.02)
    result = identified(request, entry, setting, tell)
    e, seconds = result.evaluation, time.perf_counter() - start_time
    tell(said="drawing", share=0.92)
    exports = export(e, files, result.record.signals)
    start = entry.prepare.start or 0.0
    plots, complaints = figures.of_model(e, start)
    write_text(files / "figures.json", json.dumps(json_value(plots), allow_nan=False))
    save_runs(e, start, files / "runs.npz")
    searched = () if result.selection is None else result.selection.notes
    notes = [*result.record.remarks, *searched, *e.notes, *exports.notes, *_mjcf(e.fit, files), *complaints]
    recipe = e.setting.recipe
    model = Model(
        name=str(recipe),
        data=request["key"],
        further=request["further"],
        validation=request["validation"],
        prepare=entry.prepare,
        setting=_of_recipe(setting, recipe),
        asked=setting.structure,
        fit_estimation=_finite(e.estimation_fit),
        fit_validation=_finite(e.validation_fit),
        d=int(e.fit.criteria.d),
        N=int(e.fit.criteria.N),
        seconds=seconds,
        converged=bool(e.fit.stop.converged),
        joint=(files / "joint.xml").exists(),
        whole=not e.unseen,
        verdict=_answer(result, request["names"]),
        steps=steps_of_page(result, setting, request["names"]),
        notes=tuple(words_of_page(note, request["names"]) for note in notes),
    )
    tell(ready=model.model_dump(mode="json"))
    tell(said="writing the report", share=0.96)
    _report(result, exports, request["names"], out / "report.html")
    tell(report=True)


def identified(request: dict[str, Any], entry: Data, setting: Setting, tell: Callable[..., None]) -> Identification:
    """The identification that a request asks for, as the command line would make it of the same files and options."""
    is_search = setting.structure == AUTO
    steps = 0

    def step(text: str) -> None:
        nonlocal steps
        steps += 1
        tell(said=f"search {steps}, {text.replace('_', ' ')}", share=0.05 + 0.85 * steps / (steps + USUAL))

    def candidate(done: int, total: int, name: str) -> None:
        words = f"structure {done} of {total} in this round, {name.replace('_', ' ')}"
        tell(said=words, share=min(0.05 + 0.85 * (time.monotonic() - started) / setting.seconds, 0.9))

    started = time.monotonic()
    half = Setting().split
    return identify_file(
        request["logs"],
        setting.wanted(Path(request["start"]) if request["start"] else None),
        entry.input,
        entry.output,
        entry.Ts,
        entry.time,
        split=None if setting.split == half else setting.split,
        fitting=lambda: tell(said="fitting", share=0.05),
        candidate=candidate if is_search else None,
        progress=None if is_search else step,
        validation=request["judges"],
        preparation=entry.prepare.preparation(),
        trials=None,
    )


def _of_recipe(setting: Setting, recipe: Recipe) -> Setting:
    """The setting that fits this recipe as another one was fitted."""
    settings = {**recipe.orders, **{name: value for name, value in recipe.as_dict().items() if value is not None}}
    return setting.model_copy(update={"structure": recipe.name, "settings": settings})


def steps_of_page(result: Identification, setting: Setting, names: dict[str, str]) -> tuple[Step, ...]:
    """The next steps that were tried, each as a fit of the app; a step that is none has only its reason."""
    steps = [step for step in (result.next, result.also) if step is not None]
    return tuple(_step(result, step, setting, names) for step in steps)


def _step(result: Identification, step: NextStep, setting: Setting, names: dict[str, str]) -> Step:
    why, change = words_of_page(step.why, names), dict(step.change)
    if result.selection is not None and step.why == result.selection.cut:
        longer = setting.model_copy(update={"structure": AUTO, "seconds": 3.0 * result.selection.budget})
        return Step(why=why, words=f"search for {longer.seconds:.0f} s", setting=longer)
    if not change:
        return Step(why=why)
    words = _brings(step)
    if change.get("structure") == AUTO:
        asked = setting.model_copy(update={"structure": AUTO, "fixed": {}, "bounds": {}, "start": None})
        return Step(why=why, words=f"search for a structure{words}", setting=asked)
    split = change.pop("split", setting.split)
    wanted = changed_setting(result, **change)
    kept: dict[str, Any] = {"fixed": setting.fixed, "bounds": setting.bounds}
    kept = kept if wanted.held else {name: {} for name in kept}
    start = setting.start if wanted.held.start is not None else None
    changed = _of_recipe(setting, wanted.recipe).model_copy(
        update={"starts": wanted.starts, "split": split, "start": start, **kept}
    )
    return Step(why=why, words=f"{_called(result, step, wanted.recipe)}{words}", setting=changed)


def _called(result: Identification, step: NextStep, recipe: Recipe) -> str:
    """A step in a few words: another structure or size, or what else changes."""
    if str(recipe) != str(result.evaluation.setting.recipe):
        return str(recipe).replace("_", " ")
    said = [SAID.get(name, f"{name.replace('_', ' ')} {{}}").format(value) for name, value in step.change.items()]
    return ", ".join(said)


def _brings(step: NextStep) -> str:
    return f", {step.gain.in_words()}" if step.gain is not None else ""


def _answer(result: Identification, names: dict[str, str]) -> Verdict:
    from sysid.report.identify_answer import answer

    return verdict_of(answer(result), names)


def verdict_of(answer: Answer, names: dict[str, str]) -> Verdict:
    """The first lines of a report's first screen."""
    sentence = words_of_page(answer.sentence, names)
    return Verdict(number=answer.number, of=words_of_page(answer.of, names), word=answer.word, sentence=sentence)


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


def _report(result: Identification, exports: Exports, names: dict[str, str], path: Path) -> None:
    """Write the report of a fit, in which each log has the name that it was added by."""
    from sysid.report import identify as report

    def named(step: NextStep | None) -> NextStep | None:
        return None if step is None else replace(step, command=_with_names(step.command, names))

    record = result.record
    files = tuple(Path(names.get(str(file), str(file))) for file in record.files)
    record = replace(record, path=Path(names.get(str(record.path), str(record.path))), files=files)
    result = replace(result, record=record, next=named(result.next), also=named(result.also))
    with atomic_file(path) as temporary:
        temporary.write_text(report.page(result, exports).html(), encoding="utf-8")


def _with_names(command: str, names: dict[str, str]) -> str:
    """A command with the names of the logs in place of their paths."""
    for path, name in names.items():
        command = command.replace(shlex.quote(path), shlex.quote(name))
    return command


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
