"""The Python script that fits a model of a session again."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin.app.entries import Data, Model


def script(model: Model, data: Data, logs: Sequence[Path], validation: Sequence[Path], start: Path | None) -> str:
    """The script of a model that was fitted to the record `data`, in the files `logs`, with `start` as in its setting.

    Names from files and people stand in it as Python literals alone, so that none of them is code. Raises InputError
    for settings that give no model.
    """
    setting, recipe = model.setting, model.setting.recipe()
    selection = {"input": data.input, "output": data.output, "Ts": data.Ts, "time": data.time}
    split = None if model.whole or model.validation else setting.split
    options: dict[str, Any] = {
        **{name: value for name, value in selection.items() if value is not None},
        "split": split,
    }
    if model.validation:
        options |= {"validation": [str(path) for path in validation]}
    settings = ", ".join(f"{name}={value!r}" for name, value in setting.settings.items())
    held = [f"fixed={tuple(setting.fixed.items())!r}"] if setting.fixed else []
    ends = ", ".join(f"({name!r}, ({_end(low, '-')}, {_end(high)}))" for name, (low, high) in setting.bounds.items())
    held += [f"bounds=({ends},)"] if ends else []
    held += [] if start is None else [f"start=read_start({str(start)!r}), path=Path({str(start)!r})"]
    given = f", held=Held({', '.join(held)})" if held else ""
    starts = f"starts={1 if start else setting.starts}, seed={setting.seed}"
    lines = [
        '"""A model that was fitted in qpal app, fitted again: python THIS_FILE [LOG ...]"""',
        "",
        "import sys",
        *(["from pathlib import Path"] if start else []),
        "",
        "import sysid",
        "from sysid.data.preparation import Preparation",
        "from sysid.workflow.identification import identify_file",
        f"from sysid.workflow.setting import {'Held, ' if held else ''}Setting{', read_start' if start else ''}",
        "",
        f"logs = sys.argv[1:] or {[str(log) for log in logs]!r}  # the first was added as {data.name!r}",
        f"recipe = sysid.structures.{type(recipe).__name__}({settings})",
        f"setting = Setting(recipe, {starts}{given})",
        f"preparation = {model.prepare.preparation()!r}",
        f"options = {options!r}",
        "result = identify_file(logs, setting, preparation=preparation, **options)",
        "",
        "e = result.evaluation",
        'print("fit on the estimation data:", repr(e.estimation_fit), "%")',
        *(() if model.whole else ['print("fit on the validation data:", repr(e.validation_fit), "%")']),
        'print(*(f"{name}: {value:.6g}" for name, value in e.fit.criteria.as_dict().items()), sep="\\n")',
        "",
    ]
    return "\n".join(lines)


def _end(value: float | None, sign: str = "") -> str:
    return f'float("{sign}inf")' if value is None else repr(value)
