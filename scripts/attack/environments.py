"""Does every verb give the same numbers and the same figures, whatever the machine around it is set to?

Each environment runs the same verbs in a folder of its own, as a fresh process each. What they write is compared with
what they write in a plain environment: numbers and figures to the last bit. Where an environment leaves no room, a
sentence at once is right, and a result is wrong only if it differs.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fuzz.tally import Tally, part

QPAL = "import sys; from twin.cli import main; sys.exit(main(sys.argv[1:]))"
ROOT = Path(__file__).resolve().parents[2]
VERBS: Mapping[str, Sequence[str]] = {
    "help": ("--help",),
    "simulate": ("simulate", "--duration", "20", "--out", "sim"),
    "info": ("info", "sim/log.csv", "--out", "info"),
    "identify": ("identify", "sim/log.csv", "--structure", "output_error", "--starts", "1", "--out", "fit"),
    "export": ("export", "fit/model.json", "--c", "--out", "code"),
}
LIMIT = 300.0  # [s] a verb, on a busy machine
VARY = ("seconds", "file", "model", "report", "path", "out")  # entries that say when and where
USETEX = "text.usetex: True\nfont.family: NoSuchFont\nbackend: nowhere\nlines.linewidth: 9\nno colon\naxes.grid: 7\n"


@dataclass(frozen=True)
class Environment:
    """Variables to set (None: to unset), what runs before the verb's process begins, files that lie in its folder.

    `before` are words put before the command line, skipped where the machine lacks the first of them. `shut` closes
    standard output. `refused`: a sentence and exit code 2 is a right answer.
    """

    variables: Mapping[str, str | None] = field(default_factory=dict)
    limits: Callable[[], object] | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)
    before: Sequence[str] = ()
    shut: bool = False
    refused: bool = False


def _address_space(mebibytes: int) -> Callable[[], object]:
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (mebibytes << 20, mebibytes << 20))

    return limit


THREADS: Mapping[str, str | None] = {  # of libraries that end in an error or abort where they cannot read these
    "NUMBA_NUM_THREADS": "0",
    "NUMBA_CPU_FEATURES": "odd",
    "NUMBA_OPT": "99",
    "POLARS_MAX_THREADS": "0",
    "LOKY_MAX_CPU_COUNT": "odd",
    "JOBLIB_MULTIPROCESSING": "odd",
    "JOBLIB_START_METHOD": "odd",
}
AT_ONCE: Mapping[str, str | None] = {
    "MUJOCO_GL": "odd",
    "MPLBACKEND": "module://nowhere",
    "LC_ALL": "C",
    "LANG": None,
    "HOME": None,
    "COLUMNS": "40",
    "TERM": "dumb",
    "NO_COLOR": "1",
    "TZ": "Nowhere/Odd",
    "PYTHONHASHSEED": "7",
    "PYTHONWARNINGS": "error",
    "PYTHONUTF8": "0",
    "SOURCE_DATE_EPOCH": "odd",
    "TMPDIR": "/nowhere",
    **THREADS,
}
TABLE: Mapping[str, Environment] = {
    "plain": Environment(),
    "at once": Environment(AT_ONCE, lambda: os.umask(0o077), {"matplotlibrc": USETEX.encode()}),
    "MUJOCO_GL odd": Environment({"MUJOCO_GL": "odd"}),
    "MUJOCO_GL egl": Environment({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "odd"}),
    "MPLBACKEND odd": Environment({"MPLBACKEND": "odd"}),
    "MPLBACKEND tkagg": Environment({"MPLBACKEND": "tkagg", "DISPLAY": None}),
    "usetex": Environment(files={"matplotlibrc": USETEX.encode()}),
    "matplotlibrc not text": Environment(files={"matplotlibrc": b"\xff\xfe\x00odd"}),
    "matplotlibrc a device": Environment({"MATPLOTLIBRC": "/dev/zero"}),
    "no place for matplotlib": Environment({"MPLCONFIGDIR": "/dev/null/x"}),
    "no display": Environment({"DISPLAY": None, "WAYLAND_DISPLAY": None}),
    "no HOME": Environment({"HOME": None}),
    "HOME not writable": Environment({"HOME": "/proc"}),
    "no TMPDIR": Environment({"TMPDIR": "/nowhere"}),
    "TMPDIR not writable": Environment({"TMPDIR": "/proc", "TEMP": "/proc", "TMP": "/proc"}),
    "no place for kernels": Environment({"NUMBA_CACHE_DIR": "/dev/null/x"}),
    "40 columns": Environment({"COLUMNS": "40"}),
    "dumb terminal": Environment({"TERM": "dumb", "NO_COLOR": "1"}),
    "LC_ALL=C": Environment({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
    "LC_ALL=POSIX": Environment({"LC_ALL": "POSIX"}),
    "LC_ALL=tr_TR": Environment({"LC_ALL": "tr_TR.UTF-8"}),
    "LC_ALL=de_DE": Environment({"LC_ALL": "de_DE.UTF-8"}),
    "LC_ALL odd": Environment({"LC_ALL": "xx_YY.odd", "LANG": "odd"}),
    "PYTHONIOENCODING=ascii": Environment({"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}),
    "PYTHONOPTIMIZE": Environment({"PYTHONOPTIMIZE": "1"}),
    "PYTHONHASHSEED": Environment({"PYTHONHASHSEED": "4711"}),
    "PYTHONWARNINGS=error": Environment({"PYTHONWARNINGS": "error"}),
    "TZ odd": Environment({"TZ": "Nowhere/Odd"}),
    "SOURCE_DATE_EPOCH": Environment({"SOURCE_DATE_EPOCH": "0"}),
    "umask 077": Environment(limits=lambda: os.umask(0o077)),
    "odd threads": Environment(THREADS),
    "one core": Environment(before=("taskset", "-c", "0")),
    "eight threads": Environment(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "8")),
    "no stdout": Environment(shut=True),
    "1 GiB": Environment(limits=_address_space(1024), refused=True),
    "2 GiB": Environment(limits=_address_space(2048)),
}


def run(name: str, folder: Path, verbs: Sequence[str] = tuple(VERBS)) -> dict[str, Any]:
    """Runs the verbs in the environment; exit codes, seconds, and what went wrong in words."""
    environment = TABLE[name]
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    for variable, value in environment.variables.items():
        variables.pop(variable, None)
        if value is not None:
            variables[variable] = value
    if environment.before and shutil.which(environment.before[0]) is None:
        return {"skipped": f"this machine has no {environment.before[0]}"}
    folder.mkdir(parents=True)
    for file, content in environment.files.items():
        (folder / file).write_bytes(content)
    result: dict[str, Any] = {"codes": {}, "seconds": {}, "wrong": []}
    for verb in verbs:
        start = time.monotonic()
        code, output = _call([*environment.before, sys.executable, "-c", QPAL, *VERBS[verb]], folder, variables, name)
        result["codes"][verb], result["seconds"][verb] = code, round(time.monotonic() - start, 1)
        lines = [line for line in output.splitlines() if line.startswith("qpal: ")]
        if code != 0 and not (environment.refused and code == 2 and len(lines) == 1):
            result["wrong"].append(f"{verb} ended with {code}: {' / '.join(output.splitlines()[-2:])[:400]}")
        if "Traceback" in output:
            result["wrong"].append(f"{verb} shows a traceback")
        if code != 0:
            break
    return result


def _call(command: Sequence[str], folder: Path, variables: Mapping[str, str], name: str) -> tuple[int, str]:
    """Exit code and standard error; a process that takes too long is ended with all that it started."""
    environment = TABLE[name]

    def first() -> None:
        if environment.limits is not None:
            environment.limits()
        if environment.shut:
            os.close(1)

    with (folder / "stderr").open("w+", encoding="utf-8", errors="replace") as file:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=file,
            preexec_fn=first,
            start_new_session=True,
        )
        try:
            code = process.wait(LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
        file.seek(0)
        return code, file.read()


def differences(folder: Path, plain: Path) -> list[str]:
    """What differs between the files of two folders, in words; a page and its time of day are left out."""
    wrong = []
    for path in sorted(plain.rglob("*")):
        name = path.relative_to(plain)
        if not path.is_file() or path.suffix in (".html", "") or path.name == "matplotlibrc":
            continue
        copy = folder / name
        if not copy.is_file():
            wrong.append(f"{name} is missing")
        elif path.suffix == ".json":
            if _numbers(json.loads(path.read_bytes())) != _numbers(json.loads(copy.read_bytes())):
                wrong.append(f"{name} has other values")
        elif path.read_bytes() != copy.read_bytes():
            wrong.append(f"{name} has other bytes")
    return wrong


def _numbers(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _numbers(entry) for name, entry in value.items() if name not in VARY}
    return [_numbers(entry) for entry in value] if isinstance(value, list) else value


def attack(chosen: Any) -> Tally:
    """The environments whose name has the part, each beside the plain one."""
    tally = Tally()
    others = [name for name in TABLE if name != "plain" and chosen.part in name]
    with tempfile.TemporaryDirectory() as place:
        base = Path(place) / "plain"
        for name in ["plain", *part(others, chosen.scale, chosen.seed)]:
            folder = base if name == "plain" else Path(place) / "other"
            result = run(name, folder)
            codes = list(result.get("codes", {}).values())
            wrong = result.get("wrong", [])
            if name != "plain" and codes and not any(codes):
                wrong += differences(folder, base)
            tally.case(
                "skipped" if "skipped" in result else f"ended with {max(codes)}", [(name, text) for text in wrong]
            )
            print(f"{name}: {wrong or result.get('skipped') or result['codes']}", file=sys.stderr, flush=True)
            if name != "plain":
                shutil.rmtree(folder, ignore_errors=True)
    return tally
