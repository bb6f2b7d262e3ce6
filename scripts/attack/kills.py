"""Every verb that writes is sent INT, TERM and KILL at moments of its run.

A run is measured once without a signal. Then it is signalled at moments from the first import of the program to the
end, spread evenly with a random share of a step. After each: outputs are whole or absent, standard error has no
traceback, no process of the run is left two seconds later, and no temporary file (after KILL: once the next run has
worked in that place). A verb that resumes is then run again; its result is that of the run that was not killed.
"""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fuzz.tally import Tally

HERE = Path(__file__).resolve().parents[2]
RUNS = 200  # of a full attack
SIGNALS = {"INT": signal.SIGINT, "TERM": signal.SIGTERM, "KILL": signal.SIGKILL}
# Says on a number of its own that the program has been loaded and will now run.
PROGRAM = "import os, sys; from twin.cli import main; os.write(int(sys.argv.pop(1)), b'.'); sys.exit(main())"
ENSEMBLE = """
import os, signal, sys
signal.signal(signal.SIGTERM, signal.default_int_handler)
try:
    import twin
    os.write(int(sys.argv.pop(1)), b'.')
    twin.Ensemble(twin.Experiment("thigh", duration=4.0), range(24), None, "out", part=4).run(threads=1)
except KeyboardInterrupt:
    sys.exit(130)
"""
# What differs from run to run: times, dates, memory, and pages and pictures that show them.
LOOSE = ("seconds", "memory", "check", "version", "versions", "made_with", "started", "written", "date")
SHORT = ["simulate", "--duration", "20"]


@dataclass(frozen=True)
class Verb:
    """A command line; its outputs `out` appear together, `grows` are files that a stopped run keeps."""

    arguments: list[str]
    out: tuple[str, ...] = ("out",)
    grows: tuple[str, ...] = ()
    code: str = PROGRAM
    again: bool = False  # a run after a kill goes on where it was
    once: bool = False  # a run refuses a place that holds a whole output

    def command(self, number: int) -> list[str]:
        """What runs; it writes a dot to file `number` when it begins."""
        return [sys.executable, "-c", self.code, str(number), *self.arguments]


OUT = ["--out", "out"]
FIT = ["identify", "log.csv", "--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
AUTO = [
    "identify",
    "log.csv",
    "--structure",
    "auto",
    "--starts",
    "1",
    "--seconds",
    "3600",
    "--resume",
    "journal",
]  # no budget: the result is one
BENCH = ["bench", "run", "--scenario", "stress/short", "--method", "output_error", "--seeds", "6", "--workers", "2"]
VERBS = {
    "simulate": Verb([*SHORT, *OUT]),
    "simulate_default": Verb(SHORT, ("runs",)),
    "simulate_log": Verb([*SHORT, "--log", "own.csv", *OUT], ("out", "own.csv")),
    "identify": Verb([*FIT, *OUT]),
    "run": Verb(["run", "fit/model.json", "log.csv", *OUT]),
    "models": Verb(["models", "fit/model.json", "log.csv", *OUT]),
    "export": Verb(["export", "fit/model.json", "--c", "--python", *OUT]),
    "info": Verb(["info", "log.csv", "--write-map", "map.toml", *OUT], ("out", "map.toml")),
    "gif": Verb(["view", "leg.csv", "--gif", "film.gif", "--stop", "1"], ("film.gif",)),
    "frames": Verb(["view", "leg.csv", "--frames", "out", "--stop", "0.2"]),
    # Short searches, so that as many moments fall on what is written after them.
    "compare": Verb(["compare", "leg.csv", "--seconds", "10", *OUT]),
    "calibrate": Verb(["calibrate", "leg.csv", "--free", "no_load_speed", *OUT]),
    "design": Verb(["design", "leg.csv", "--for", "ends", *OUT]),
    "bench_export": Verb(["bench", "export", "textbook/textbook", *OUT], once=True),
    "bench_run": Verb([*BENCH, "--out", "t.parquet"], (), ("t.parquet", "t.journal"), again=True),
    "ensemble": Verb([], (), ("out",), ENSEMBLE, again=True),
    "auto": Verb([*AUTO, *OUT], ("out",), ("journal",), again=True),
    "reproduce": Verb(["reproduce", "--duration", "60", *OUT]),
}


@dataclass(frozen=True)
class Shot:
    """One run that is signalled `moment` seconds after it began, and its faults: kind, sample."""

    verb: Verb
    number: str
    moment: float
    faults: list[tuple[str, str]] = field(default_factory=list)

    def fails(self, fault: str, sample: object) -> None:
        """One more fault."""
        self.faults.append((f"{self.number}: {fault}", f"{self.verb.arguments[:2]} at {self.moment:.2f} s: {sample}"))


def surroundings(place: Path) -> dict[str, str]:
    """The environment of a run: this checkout, one thread, temporary files of its own."""
    (place / "tmp").mkdir(exist_ok=True)
    threads = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**os.environ, **threads, "PYTHONPATH": str(HERE), "TMPDIR": str(place / "tmp")}


def begin(verb: Verb, place: Path) -> subprocess.Popen:
    """The run in a session of its own, once its program has been loaded."""
    read, write = os.pipe()
    with (place / "tmp.err").open("wb") as errors:
        process = subprocess.Popen(
            verb.command(write),
            cwd=place,
            env=surroundings(place),
            stdout=subprocess.DEVNULL,
            stderr=errors,
            stdin=subprocess.DEVNULL,
            pass_fds=(write,),
            start_new_session=True,
        )
    os.close(write)
    os.read(read, 1)
    os.close(read)
    return process


def whole(verb: Verb, place: Path) -> None:
    """A run that nobody stops."""
    finish(verb, begin(verb, place), place)


def finish(verb: Verb, process: subprocess.Popen, place: Path) -> None:
    """The end of a run that nobody stops."""
    code = process.wait()
    if code not in (0, 1):
        raise RuntimeError(f"{verb.arguments} ended with {code}: {(place / 'tmp.err').read_text()[-800:]}")


def inputs(place: Path) -> None:
    """What the verbs read."""
    rng, x = random.Random(0), 0.0
    lines, u = ["time_s,u_V,y_m"], 0.0
    for k in range(300):
        u = rng.uniform(-1.0, 1.0) if k % 5 == 0 else u
        lines.append(f"{0.1 * k!r},{u!r},{x + 0.001 * rng.gauss(0.0, 1.0)!r}")
        x += 0.2 * (u - x)
    (place / "log.csv").write_text("\n".join(lines) + "\n")
    whole(Verb([*FIT, "--out", "fit"]), place)
    whole(Verb(["simulate", "--duration", "60", "--out", "leg", "--log", "leg.csv"]), place)


def comparable(path: Path) -> object:
    """The content of a file without what differs from run to run."""
    if path.suffix == ".json":
        return strip_times(json.loads(re.sub(r"\b20\d{6}-\d{6}", "STAMP", path.read_text())))
    if path.suffix == ".parquet":
        import polars

        table = polars.read_parquet(path, glob=False)
        names = [name for name in table.columns if not any(word in name for word in LOOSE)]
        return table.select(names).sort(names[:3]).to_dicts()
    if path.name == "journal":  # rows in the order in which workers end
        return sorted(
            json.dumps(strip_times(json.loads(line)), sort_keys=True) for line in path.read_text().splitlines()
        )
    if path.suffix in (".html", ".png", ".gif"):
        return path.read_bytes()[:4]
    return path.read_bytes()


def strip_times(value: object) -> object:
    """A JSON value without times and the like."""
    if isinstance(value, dict):
        return {name: strip_times(each) for name, each in value.items() if not any(word in name for word in LOOSE)}
    return [strip_times(each) for each in value] if isinstance(value, list) else value


def contents(place: Path, names: tuple[str, ...]) -> dict[str, object]:
    """Files by name; a folder runs/<stamp>-<verb> goes by its verb alone."""
    files = {}
    for name in names:
        top = place / name
        for path in sorted(top.rglob("*")) if top.is_dir() else [top]:
            parts = path.relative_to(place).parts
            scratch = any(part.startswith(".") for part in parts)  # `left` judges these
            if path.is_file() and path.suffix != ".journal" and not scratch:
                key = "/".join(part if part[:2] != "20" else part.split("-")[-1] for part in parts)
                files[key] = comparable(path)
    return files


def processes(session: int) -> list[int]:
    """Processes of a session that have not ended."""
    running = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] not in "ZX":
                    running.append(int(entry.name))
    return running


def left(place: Path) -> list[str]:
    """Temporary files in the place of a run and in the folder for temporary files."""
    hidden = [str(path.relative_to(place)) for path in place.rglob(".*") if path.name != ".cache"]
    empty = [path.name for path in (place / "runs").glob("*") if not any(path.iterdir())]
    return hidden + empty + [name for name in os.listdir(place / "tmp") if name.startswith(("qpal-", "tmp", ".qpal"))]


def attempt(shot: Shot, template: Path, reference: dict[str, Any]) -> str:
    """The run and its signal; how it ended."""
    verb, number = shot.verb, shot.number
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        place = Path(name) / "place"
        shutil.copytree(template, place)
        process = begin(verb, place)
        try:
            process.wait(shot.moment)
        except subprocess.TimeoutExpired:
            group = number == "INT"  # a terminal sends it to the whole group
            (os.killpg if group else os.kill)(process.pid, SIGNALS[number])
        try:
            code = process.wait(30)
        except subprocess.TimeoutExpired:
            shot.fails("did not end within 30 s", "")
            os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
        time.sleep(2.0 if processes(process.pid) else 0.0)
        for process_id in processes(process.pid):
            shot.fails("a process is left", process_id)
            os.kill(process_id, signal.SIGKILL)
        said = (place / "tmp.err").read_text()
        own = verb.code == PROGRAM or code not in (-signal.SIGINT, -signal.SIGTERM)  # a script ends as Python does
        if number != "KILL" and code not in (0, 1, 130) and own:
            shot.fails(f"ends with {code}", said)
        if "Traceback" in said:
            shot.fails("traceback", said)
        check(shot, place, code, said, reference)
    return f"{number} {code}"


def check(shot: Shot, place: Path, code: int, said: str, reference: dict[str, Any]) -> None:
    """What stands after a run that ended with `code`, and after the run that follows it."""
    verb, killed = shot.verb, shot.number == "KILL"
    outputs = contents(place, verb.out)
    if outputs and outputs != {name: reference[name] for name in outputs}:
        shot.fails("another output", [name for name in outputs if outputs[name] != reference.get(name)])
    for top in {name.partition("/")[0] for name in outputs}:
        if {name for name in outputs if name.split("/")[0] == top} != {n for n in reference if n.split("/")[0] == top}:
            shot.fails("half an output", sorted(outputs))
    if outputs and "nothing was written" in said:
        shot.fails("says that nothing was written", sorted(outputs))
    if code == 0 and verb.out and set(outputs) != set(reference) - set(verb.grows):
        shot.fails("code 0 without output", sorted(outputs))
    if not killed and left(place):
        shot.fails("left behind", left(place))
    if (killed and not (verb.once and outputs)) or verb.again:
        try:
            whole(verb, place)
        except RuntimeError as error:
            shot.fails("the next run fails", error)
            return
    if verb.again or killed:
        files = contents(place, (*verb.out, *verb.grows) if verb.again else verb.out)
        if files != reference:
            names = [name for name in {**files, **reference} if files.get(name) != reference.get(name)]
            shot.fails("the next run differs", names)
    if killed and left(place):
        shot.fails("left behind", left(place))


def measured(verb: Verb, template: Path) -> tuple[float, dict[str, Any]]:
    """How long a run takes that nobody stops, and its files."""
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        place = Path(folder) / "place"
        shutil.copytree(template, place)
        process = begin(verb, place)
        began = time.monotonic()
        finish(verb, process, place)
        return time.monotonic() - began, contents(place, (*verb.out, *verb.grows))


def attack(chosen: Any) -> Tally:
    """Signals at moments of the verbs whose name has the part."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for what runs in the background
    draw, runs = random.Random(chosen.seed), chosen.size(RUNS)
    verbs = [name for name in VERBS if chosen.part in name]
    pairs = [(name, number) for name in verbs for number in SIGNALS]
    each = -(-runs // len(pairs))  # moments
    places = [(*pair, (k + draw.random()) / each) for pair in pairs for k in range(each)]
    drawn = set(draw.sample(places, min(runs, len(places))))
    places = [place for place in places if place in drawn]
    tally = Tally()
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        template = Path(folder) / "given"
        template.mkdir()
        inputs(template)
        for name in verbs:
            mine = [(number, share) for verb, number, share in places if verb == name]
            seconds, reference = measured(VERBS[name], template) if mine else (0.0, {})
            for number, share in mine:
                shot = Shot(VERBS[name], number, seconds * share)
                tally.case(attempt(shot, template, reference), shot.faults)
                print(f"{name} {number} at {shot.moment:.2f} of {seconds:.2f} s: {shot.faults}", file=sys.stderr)
    return tally
