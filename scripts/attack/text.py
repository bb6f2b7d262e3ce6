"""Text that acts: control characters in every place that a file has for text, and where they come out again.

Each case puts hostile text into one place (a column's name, a unit, the name of a file, a string or a key of a saved
model, of a map, of a parameter file, of a robot's MJCF, of a benchmark's table or method, of a session), runs a verb in
this process, and searches what it printed and every file that it wrote. Counted are outputs that hold a raw control
character, words that are longer than `LONGEST`, tracebacks, and models that load and cannot be saved.
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
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from exported import structure_fit
from fuzz.sessions import build
from fuzz.tally import Tally, part
from texts import HOSTILE, LONG, acting

from sysid.base.errors import TEXT, InputError
from sysid.bench import table
from sysid.estimation.codec import encode, save
from sysid.estimation.origin import Origin
from sysid.nlarx.result import NlarxFit
from sysid.report.page import packed
from twin.app.desk import Desk
from twin.app.entries import COLUMNS
from twin.app.session import Session
from twin.cli import main as qpal

STRUCTURES = ("output_error", "hammerstein_wiener", "wiener_hammerstein", "state_space", "joint_plain", "nlarx")
EXPORTS = ("--c", "--python", "--matlab", "--fmu", "--onnx", "--modelica", "--control", "--mjcf")
TEXTS = {"acts": HOSTILE, "long": LONG, "spaced": "name " * 2000}
LONGEST = 1000  # letters of a word; a line may have TEXT


def log(path: Path, names: dict[str, str]) -> Path:
    """A log with its columns named anew."""
    rng, n = np.random.default_rng(0), 300
    u = np.repeat(rng.uniform(-1, 1, n // 5), 5)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + 0.2 * u[k - 1]
    columns = {"time_s": 0.1 * np.arange(n), "volts_V": u, "angle_rad": y + 0.001 * rng.normal(size=n), "other": u + y}
    frame = pl.DataFrame({names.get(name, name): values for name, values in columns.items()})
    frame.write_parquet(path) if path.suffix == ".parquet" else frame.write_csv(path)
    return path


def places(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of the strings in a document, and of the tables that take another key."""
    if isinstance(value, dict):
        yield (*path, None)
        for key, entry in value.items():
            yield from places(entry, (*path, key))
    elif isinstance(value, list):
        for k, entry in enumerate(value[:2]):
            yield from places(entry, (*path, k))
    elif isinstance(value, str):
        yield path


def changed(document: Any, path: tuple, text: str) -> Any:
    """The document with this text at the end of the string at `path`, or as the key of the first entry of a table."""
    copy = json.loads(json.dumps(document))
    holder = copy
    for step in path[:-1]:
        holder = holder[step]
    if path[-1] is None:
        key = next(iter(holder), None)
        holder[f"{key}{text}"] = holder.pop(key, 1)
    else:
        holder[path[-1]] = f"{holder[path[-1]]}{text}"
    return copy


def run_case(words: list[str], folder: Path) -> list[str]:
    """What is bad of a call: a raw character in an output, by the output's kind; a traceback."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)]
    bad, before = [], set(folder.rglob("*"))
    with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
        try:
            qpal(words)
        except BaseException as error:
            bad.append(f"traceback {type(error).__name__}: {traceback.extract_tb(error.__traceback__)[-1].name}")
    for name, stream in zip(("stdout", "stderr"), streams, strict=True):
        bad += [f"{name} {kind}" for kind in kinds(stream.buffer.getvalue())]
    for path in sorted(set(folder.rglob("*")) - before):
        if not path.is_file():
            continue
        contents = {path.suffix: path.read_bytes()}
        if path.suffix == ".fmu":
            with zipfile.ZipFile(path) as archive:
                contents = {f".fmu/{n}": archive.read(n) for n in archive.namelist()}
        for suffix, content in contents.items():
            if not suffix.endswith((".png", ".parquet", ".npz", ".so", ".mcap")):
                bad += [f"{suffix} {kind}" for kind in kinds(content, suffix in (".json", ".csv"))]
    return sorted(set(bad))


def kinds(content: bytes, data: bool = False) -> list[str]:
    """What of an output is bad; data files keep long names, which are theirs."""
    text = content.decode("utf-8", "surrogateescape")
    text = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # plotly
    text = re.sub(r"base64,[^\"]*|\"bdata\":\"[^\"]*", "", text)
    found = ["raw"] if acting(text) else []
    long = not data and (re.search(rf"(?:a{{{LONGEST},}})", text) or "name " * (TEXT // 5) in text)
    return [*found, *(["long"] if long else [])]


def cases(folder: Path) -> Iterator[tuple[str, str, list[list[str]]]]:
    """A kind of place, the place, and the calls."""
    for which, text in TEXTS.items():
        suffix = "parquet"
        for column in ("time_s", "volts_V", "angle_rad", "other"):
            file = log(folder / f"{which}_{column}.{suffix}", {column: f"{column.split('_')[0]}{text}"})
            roles = ["--time", "time_s", "--input", "volts_V", "--output", "angle_rad"]
            roles = [f"{column.split('_')[0]}{text}" if word == column else word for word in roles]
            small = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
            yield f"column {which}", column, [["info", str(file)], ["identify", str(file), *roles, *small]]
        file = log(folder / f"unit_{which}.{suffix}", {"volts_V": f"volts [V{text}]", "angle_rad": f"angle [{text}]"})
        yield f"unit {which}", "header", [["info", str(file)], ["identify", str(file), "--time", "time_s", *small]]
        if which != "acts":
            continue
        name = f"log{text}.csv".replace("\r", "")
        file = log(folder / name, {})
        roles = ["--time", "time_s", "--input", "volts_V", "--output", "angle_rad"]
        yield "file name", "log", [["info", str(file)], ["identify", str(file), *roles, *small]]
    plain = log(folder / "plain.csv", {})
    yield from maps(folder, plain, roles, small)
    yield from models(folder, plain)
    yield from others(folder)


def maps(folder: Path, plain: Path, roles: list[str], small: list[str]) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Entries of a map."""
    entries = {
        "clock.column": 'column = "time_s"', "input.column": 'column = "volts_V"', "input.unit": 'unit = "V"',
        "input.name": 'name = "u"', "output.unit": 'unit = "rad"', "output.name": 'name = "y"',
    }  # fmt: skip
    for place in (*entries, "input.key", "other.column"):
        for which, text in TEXTS.items():
            quoted = json.dumps(f"x{text}").replace("\x7f", "\\u007f")
            lines = {name: (f"{line[:-1]}{quoted[2:]}" if name == place else line) for name, line in entries.items()}
            more = f"{quoted} = 1\n" if place == "input.key" else ""
            other = f'[[other]]\ncolumn = "other{quoted[2:]}\n' if place == "other.column" else ""
            content = (
                f"[clock]\n{lines['clock.column']}\n[[input]]\n{lines['input.column']}\n{lines['input.unit']}\n"
                f'{lines["input.name"]}\n{more}[[output]]\ncolumn = "angle_rad"\n{lines["output.unit"]}\n'
                f"{lines['output.name']}\n{other}"
            )
            file = folder / f"{place}_{which}.toml"
            file.write_text(content)
            yield f"map {which}", place, [["identify", str(plain), "--map", str(file), *small]]


def models(folder: Path, plain: Path) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Strings and keys of saved models of each structure."""
    for structure in STRUCTURES:
        fit, _ = structure_fit(structure)
        fit = replace(fit, origin=Origin("u", "y", "V", "rad", 300, 90.0), warnings=("it is a warning",))
        whole = save_any(fit, folder / f"{structure}.json")
        document = json.loads(whole.read_text())
        for path in places(document):
            for which, text in TEXTS.items():
                if which != "acts" and not {"warnings", "origin", "role", "stop"} & {str(part) for part in path}:
                    continue
                file = folder / f"model_{structure}.json"
                file.write_text(json.dumps(changed(document, path, text)))
                run = ["run", str(file), str(plain), "--time", "time_s", "--input", "volts_V", "--output", "angle_rad"]
                calls = [run] if structure != "wiener_hammerstein" else []
                if loads(file):
                    exports = [e for e in EXPORTS if e != "--mjcf" or structure == "joint_plain"]
                    calls += [["export", str(file), e] for e in exports]
                yield f"model {which}", f"{structure} {path}", calls


def save_any(fit: Any, path: Path) -> Path:
    """A saved fit of either kind."""
    return fit.save(path) if isinstance(fit, NlarxFit) or hasattr(fit, "save") else save(fit, path)


def loads(path: Path) -> bool:
    """Whether a saved model is read."""
    import sysid

    try:
        sysid.load(path)
    except InputError:
        return False
    return True


def others(folder: Path) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Parameter files, a robot's MJCF, a benchmark's table and method, sessions."""
    for which, text in TEXTS.items():
        file = folder / f"parameters_{which}.json"
        for content in ({f"thigh{text}": {"a": 1}}, {"thigh": {f"g{text}": 1}}, {"thigh": {"gear": f"x{text}"}}):
            file.write_text(json.dumps(content))
            call = ["simulate", "--joint", "thigh", "--excitation", "sweep", "--duration", "2", "--params", str(file)]
            yield f"parameters {which}", next(iter(content)), [[*call, "--log", str(folder / "x.csv")]]
        name = text.translate({ord(c): None for c in "\x00\x01\x07\x08\x1b\x0b\x0c\ufffe"})
        robot = folder / f"robot_{which}.xml"
        robot.write_text(
            f'<mujoco model="m{name}"><worldbody><body name="b{name}"><joint name="j{name}" type="hinge" axis="0 1 0"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></worldbody>'
            f'<actuator><motor name="a{name}" joint="j{name}" gear="1"/></actuator></mujoco>', encoding="utf-8",
        )  # fmt: skip
        file = log(folder / "robot.csv", {"angle_rad": f"j{name}", "volts_V": f"a{name}"})
        yield f"mjcf {which}", "names", [
            ["compare", str(file), "--model", str(robot), "--time", "time_s"],
            ["compare", str(file), "--model", str(robot), "--time", "time_s", "--actuator", f"a{name}"],
        ]  # fmt: skip
        rows = []
        for method in (f"mine{text}", "linear"):
            row = {
                key: 1.0 if kind is pl.Float64 else 1 if kind is pl.Int64 else "x"
                for key, kind in table.COLUMNS.items()
            }
            row |= {"scenario": f"family/{text}", "method": method, "status": "ok", "errors": "[1.0]", "stop": text}
            rows += [row, {**row, "scenario": "family/other", "status": f"it failed{text}"}]
        file = folder / f"bench_{which}.parquet"
        frame = pl.DataFrame(rows, schema=table.COLUMNS)
        table.write(frame, file)
        yield f"bench {which}", "table", [["bench", "report", str(file)]]
        method = folder / f"method_{which}.py"
        method.write_text(f"NAME = {text!a}\ndef fit(*a):\n    raise ValueError({text!a})\n")
        call = ["bench", "run", "--method", str(method), "--scenario", "textbook/*", "--seeds", "1", "--out"]
        yield f"bench {which}", "method", [[*call, str(folder / f"t{which}.parquet")], ["bench", "add", f"x{text}"]]


def sessions(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Strings of a session, and what of them the page gets raw."""
    place = folder / "session"
    build(place)
    for file in sorted(path for path in place.rglob("*.json")):
        document = json.loads(file.read_text())
        for path in places(document):
            copy = folder / "copy"
            shutil.copytree(place, copy)
            (copy / file.relative_to(place)).write_text(json.dumps(changed(document, path, HOSTILE)))
            session = Session.open(copy)
            desk = Desk(session)
            texts = [str(value) for e in (*session.data.values(), *session.models.values(), *session.studies.values())
                     for value in strings(e.model_dump(exclude=set(COLUMNS)))]  # fmt: skip
            bad = ["session raw"] if any(map(acting, [*session.complaints, *texts])) else []
            for kind, keys in (("models", session.models), ("studies", session.studies)):
                for key in keys:
                    with contextlib.suppress(InputError):
                        figures = [
                            *strings(
                                {n: {**f, "figure": packed(f["figure"])} for n, f in desk.figures(kind, key).items()}
                            )
                        ]
                        bad += ["session figure raw"] if any(map(acting, figures)) else []
            desk.close()
            shutil.rmtree(copy)
            yield f"{file.relative_to(place)} {path}", bad


def strings(value: Any) -> Iterator[str]:
    """All strings of a document."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield str(key)
            yield from strings(entry)
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from strings(entry)
    elif isinstance(value, str):
        yield value


def surrogates(folder: Path) -> Iterator[tuple[str, Path]]:
    """Models with a lone surrogate in one string or key."""
    for structure in STRUCTURES:
        document = json.loads(save_any(structure_fit(structure)[0], folder / "whole.json").read_text())
        document |= {"origin": encode(Origin("u", "y", "V", "rad", 300, 90.0), ""), "warnings": ["it is a warning"]}
        for path in places(document):
            file = folder / "surrogate.json"
            file.write_text(json.dumps(changed(document, path, "\ud800")))
            yield f"{structure} {path}", file


def kept(file: Path) -> tuple[str, list[str]]:
    """How a saved model ends that is loaded and saved again, and what is bad of it."""
    import sysid

    try:
        save_any(sysid.load(file), file.with_name("again.json"))
    except InputError:
        return "refused", []
    except Exception as error:
        return "failed", [f"load or save: {type(error).__name__}"]
    return "saved", []


def attack(chosen: Any) -> Tally:
    """The kinds of place that have the part."""
    warnings.simplefilter("ignore")
    tally = Tally()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chdir(folder)
        wanted = (case for case in cases(folder) if chosen.part in case[0])
        for kind, place, calls in part(wanted, chosen.scale, chosen.seed):
            for call in calls:
                bad = [(f"{kind}: {sort}", f"{place}: {call[0]} {call[2:3]}") for sort in run_case(call, folder)]
                tally.case(kind, bad)
                shutil.rmtree("runs", ignore_errors=True)
        if chosen.part in "session":
            for place, sorts in part(sessions(folder), chosen.scale, chosen.seed):
                tally.case("session", [(sort, place) for sort in sorts])
        if chosen.part in "surrogate":
            for place, file in part(surrogates(folder), chosen.scale, chosen.seed):
                end, sorts = kept(file)
                tally.case(f"surrogate {end}", [(f"surrogate: {sort}", place) for sort in sorts])
        os.chdir("/")
    return tally
