"""Numbers that act: saved models with large entries, under usual and large inputs, and what is said of their runs.

Each case multiplies the entries of a saved model (all values of theta, or one alone) or the input of a record by a
power of ten, and runs `qpal run` with a prediction, `qpal run` on inputs alone, and the exports, in this process. Bad
are: an output with nan or inf of which no sentence names the sample ("silent"), a Python warning, and a traceback.
"""

import contextlib
import io
import json
import os
import re
import shutil
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from exported import FITS, structure_fit
from fuzz.tally import Tally, part

from sysid.estimation.origin import Origin
from twin.cli import main as qpal

SCALES = (1e3, 1e10, 1e100, 1e308)
INPUTS = (1.0, 1e10, 1e300)
EXPORTS = ("--c", "--python", "--matlab", "--fmu", "--onnx", "--modelica", "--control")
SAMPLE = re.compile(r"sample \d+")


def record(path: Path, inputs: int, outputs: int, scale: float = 1.0, alone: bool = False) -> list[str]:
    """A log, and the words that name its columns."""
    rng, n = np.random.default_rng(0), 200
    u = np.repeat(rng.uniform(-1, 1, (n // 5, inputs)), 5, axis=0) * scale
    y = np.zeros((n, outputs))
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + 0.2 * np.clip(u[k - 1, :1], -1e6, 1e6)
    columns = {"t": 0.1 * np.arange(n)} | {f"u{j}": u[:, j] for j in range(inputs)}
    columns |= {} if alone else {f"y{j}": y[:, j] for j in range(outputs)}
    pl.DataFrame(columns).write_csv(path)
    words = ["--time", "t", "--time-unit", "s", "--input", ",".join(f"u{j}" for j in range(inputs))]
    return [str(path), *words, *([] if alone else ["--output", ",".join(f"y{j}" for j in range(outputs))])]


def entries(document: dict[str, Any]) -> list[str | None]:
    """All values of theta, and single ones, spread over it."""
    names = [name for name, value in document["theta"].items() if value]
    return [None, *names[:: max(len(names) // 6, 1)]]


def scaled(document: dict[str, Any], entry: str | None, scale: float) -> dict[str, Any]:
    """The document with this value of theta, or all, multiplied; fixed values go along."""
    copy = json.loads(json.dumps(document))
    for table in (copy["theta"], copy["model"].get("fixed", {})):
        for name in table:
            if entry in (None, name):
                with np.errstate(over="ignore"):
                    table[name] = float(np.clip(table[name] * scale, -1.7e308, 1.7e308))
    return copy


def called(words: list[str]) -> tuple[int, str, list[str]]:
    """Exit code, what was printed, and what is bad of a call: a warning, a traceback."""
    out, bad = io.StringIO(), []
    code = -1
    heard = warnings.catch_warnings(record=True)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out), heard as found:
        warnings.simplefilter("always", RuntimeWarning)
        try:
            code = qpal(words)
        except BaseException as error:
            bad.append(f"traceback {type(error).__name__}: {traceback.extract_tb(error.__traceback__)[-1].name}")
    bad += sorted(
        {f"warning {w.message} at {Path(w.filename).name}:{w.lineno}" for w in found if w.category is RuntimeWarning}
    )
    return code, out.getvalue(), bad


def run_bad(words: list[str], exports: bool = False) -> tuple[str, list[str]]:
    """How a run ends, and what is bad of it."""
    shutil.rmtree("out", ignore_errors=True)
    code, said, bad = called([*words, "--out", "out"])
    if code == 2:
        return "refused", bad
    if code not in (0, 1):
        return "failed", bad
    if exports:
        return ("told" if SAMPLE.search(said) else "written"), bad
    values = Path("out/simulated.csv").read_text()
    finite = not re.search(r"\b(nan|inf)\b", values)
    if not finite and not SAMPLE.search(said):
        bad.append("silent")
    return ("finite" if finite else "told"), bad


def cases(structure: str) -> Iterator[tuple[str, dict[str, Any], list[str], bool]]:
    """Place, document of the model, words of the call, and whether it exports."""
    fit, _ = structure_fit(structure)
    nu, ny = (1, 1) if structure == "nlarx" else fit.model.channels
    fit = replace(fit, origin=Origin("u", "y", "", "", 200, 90.0), u_offset=np.zeros(nu), y_offset=np.zeros(ny))
    document = json.loads(fit.save("model.json").read_text())
    logs = {
        s: (record(Path(f"log{s:g}.csv"), nu, ny, s), record(Path(f"in{s:g}.csv"), nu, ny, s, True)) for s in INPUTS
    }
    for scale in (1.0, *SCALES):
        for entry in entries(document) if scale > 1.0 else [None]:
            changed = scaled(document, entry, scale)
            for size, (log, alone) in logs.items():
                if size > 1.0 and scale > 1.0:
                    continue
                place = f"{structure}: {entry} x {scale:g}, u x {size:g}"
                yield place, changed, ["run", "model.json", *log, "--horizon", "5"], False
                yield f"{place} alone", changed, ["run", "model.json", *alone], False
            if entry is None:
                for way in EXPORTS if scale <= 1e10 else EXPORTS[:2]:
                    yield f"{place} {way}", changed, ["export", "model.json", way], True


def attack(chosen: Any) -> Tally:
    """The structures whose name has the part."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for structure in (name for name in FITS if chosen.part in name):
            for place, document, words, exports in part(cases(structure), chosen.scale, chosen.seed):
                Path("model.json").write_text(json.dumps(document))
                end, bad = run_bad(words, exports)
                tally.case(end, [(sort, place) for sort in bad])
        os.chdir("/")
    return tally
