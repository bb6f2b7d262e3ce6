"""The Python script that does what the page did: reads, prepares, fits, and prints the same fit to the last bit."""

from dataclasses import replace
from pathlib import Path

from twin.app.entries import Data, Model


def script(model: Model, data: Data, log: Path) -> str:
    """The script of a model that was fitted to the record `data`, whose log is at `log`.

    Names from files and people stand in it as Python literals alone, so that none of them is code. Raises InputError
    for settings that give no model.
    """
    recipe = model.setting.recipe()
    steps = model.prepare.preparation()
    steps = replace(steps, detrend=recipe.detrend(steps.detrend))
    given = {"input": data.input, "output": data.output, "Ts": data.Ts, "time": data.time}
    columns = "".join(f", {name}={value!r}" for name, value in given.items() if value is not None)
    settings = ", ".join(f"{name}={value!r}" for name, value in model.setting.settings.items())
    wraps = ["from sysid.workflow.angles import without_wraps"] if recipe.zero else []
    search = recipe.auto
    options = f"search={search!r}, starts={model.setting.starts}, seed={model.setting.seed}"
    call = f"sysid.fit(recipe.model_of(estimation), estimation, {options})"
    if recipe.grown:
        call = f"sysid.grow_joint(estimation, recipe.model_of(estimation), {options}).fit"
    seen = "estimation.N" if model.setting.structure != "nlarx" else "None"
    first = "0" if model.setting.structure != "nlarx" else "fit.n_init"
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
        f"estimation, validation = data.split({model.setting.split!r})",
        f"recipe = sysid.structures.{type(recipe).__name__}({settings})",
        f"fit = {call}",
        "",
        f"run = np.ravel(fit.simulate(estimation, {seen}))",
        f'print("fit on the estimation data:", repr(fit_percent(estimation.y[{first}:, 0], run[{first}:])), "%")',
        'print("fit on the validation data:", repr(fit.fit_percent(validation)), "%")',
        'print(*(f"{name}: {value:.6g}" for name, value in fit.criteria.as_dict().items()), sep="\\n")',
        "",
    ]
    return "\n".join(lines)
