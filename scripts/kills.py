"""Every verb that writes is sent INT, TERM and KILL at moments of its run; prints counts as JSON.

    python scripts/kills.py --moments 50              # all verbs, hours
    python scripts/kills.py --moments 5 --only simulate --only auto

A run is measured once without a signal. Then it is signalled at `--moments` moments from the first import of the
program to the end, spread evenly with a random share of a step. After each: outputs are whole or absent, standard error
has no traceback, no process of the run is left two seconds later, and no temporary file (after KILL: once the next run
has worked in that place). A verb that resumes is then run again; its result is that of the run that was not killed.
`--checkout DIR` tries another checkout of the project.
"""

import argparse
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
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
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


@dataclass
class Counts:
    """Counts of one verb."""

    seconds: float
    signalled: Counter[str] = field(default_factory=Counter)
    ended: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def fails(self, fault: str, signal_name: str, example: str) -> None:
        """One failure, with the first few told in full."""
        self.wrong[f"{signal_name}: {fault}"] += 1
        if len(self.examples) < 5:
            self.examples.append(f"{signal_name} {fault}: {example[-600:]}")


def surroundings(checkout: Path, place: Path) -> dict[str, str]:
    """The environment of a run: this checkout, one thread, temporary files of its own."""
    (place / "tmp").mkdir(exist_ok=True)
    threads = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**os.environ, **threads, "PYTHONPATH": str(checkout), "TMPDIR": str(place / "tmp")}


def begin(verb: Verb, place: Path, checkout: Path) -> subprocess.Popen:
    """The run in a session of its own, once its program has been loaded."""
    read, write = os.pipe()
    with (place / "tmp.err").open("wb") as errors:
        process = subprocess.Popen(
            verb.command(write),
            cwd=place,
            env=surroundings(checkout, place),
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


def whole(verb: Verb, place: Path, checkout: Path) -> None:
    """A run that nobody stops."""
    finish(verb, begin(verb, place, checkout), place)


def finish(verb: Verb, process: subprocess.Popen, place: Path) -> None:
    """The end of a run that nobody stops."""
    code = process.wait()
    if code not in (0, 1):
        raise RuntimeError(f"{verb.arguments} ended with {code}: {(place / 'tmp.err').read_text()[-800:]}")


def inputs(place: Path, checkout: Path) -> None:
    """What the verbs read."""
    rng, x = random.Random(0), 0.0
    lines, u = ["time_s,u_V,y_m"], 0.0
    for k in range(300):
        u = rng.uniform(-1.0, 1.0) if k % 5 == 0 else u
        lines.append(f"{0.1 * k!r},{u!r},{x + 0.001 * rng.gauss(0.0, 1.0)!r}")
        x += 0.2 * (u - x)
    (place / "log.csv").write_text("\n".join(lines) + "\n")
    whole(Verb([*FIT, "--out", "fit"]), place, checkout)
    whole(Verb(["simulate", "--duration", "60", "--out", "leg", "--log", "leg.csv"]), place, checkout)


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


def attempt(
    verb: Verb, template: Path, checkout: Path, number: str, moment: float, reference: dict, counts: Counts
) -> None:
    """One run that is signalled `moment` seconds after it began."""
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        place = Path(name) / "place"
        shutil.copytree(template, place)
        process = begin(verb, place, checkout)
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            group = number == "INT"  # a terminal sends it to the whole group
            (os.killpg if group else os.kill)(process.pid, SIGNALS[number])
        try:
            code = process.wait(30)
        except subprocess.TimeoutExpired:
            counts.fails("did not end within 30 s", number, f"at {moment:.2f} s")
            os.killpg(process.pid, signal.SIGKILL)
            code = process.wait()
        time.sleep(2.0 if processes(process.pid) else 0.0)
        counts.signalled[number] += 1
        counts.ended[f"{number} {code}"] += 1
        tell = f"at {moment:.2f} s, code {code}: "
        for process_id in processes(process.pid):
            counts.fails("a process is left", number, tell + str(process_id))
            os.kill(process_id, signal.SIGKILL)
        own = verb.code == PROGRAM or code not in (-signal.SIGINT, -signal.SIGTERM)  # a script ends as Python does
        if number != "KILL" and code not in (0, 1, 130) and own:
            counts.fails(f"ends with {code}", number, tell + (place / "tmp.err").read_text())
        errors_text = (place / "tmp.err").read_text()
        if "Traceback" in errors_text:
            counts.fails("traceback", number, tell + errors_text)
        check(verb, place, checkout, number, code, (tell, errors_text), reference, counts)


def check(
    verb: Verb,
    place: Path,
    checkout: Path,
    number: str,
    code: int,
    messages: tuple[str, str],
    reference: dict,
    counts: Counts,
) -> None:
    """What stands after a run that ended with `code`, and after the run that follows it."""
    tell, words = messages
    outputs = contents(place, verb.out)
    if outputs and outputs != {name: reference[name] for name in outputs}:
        counts.fails("another output", number, tell + str([n for n in outputs if outputs[n] != reference.get(n)]))
    tops = {name.partition("/")[0] for name in outputs}
    for top in tops:
        if {name for name in outputs if name.split("/")[0] == top} != {n for n in reference if n.split("/")[0] == top}:
            counts.fails("half an output", number, tell + str(sorted(outputs)))
    if outputs and "nothing was written" in words:
        counts.fails("says that nothing was written", number, tell + str(sorted(outputs)))
    if code == 0 and verb.out and set(outputs) != set(reference) - set(verb.grows):
        counts.fails("code 0 without output", number, tell)
    if number != "KILL" and left(place):
        counts.fails("left behind", number, tell + str(left(place)))
    if (number == "KILL" and not (verb.once and outputs)) or verb.again:
        try:
            whole(verb, place, checkout)
        except RuntimeError as error:
            counts.fails("the next run fails", number, tell + str(error))
            return
    if verb.again:
        if contents(place, (*verb.out, *verb.grows)) != reference:
            files = contents(place, (*verb.out, *verb.grows))
            names = [name for name in {**files, **reference} if files.get(name) != reference.get(name)]
            counts.fails("resumed run differs", number, tell + str(names))
    elif number == "KILL" and contents(place, verb.out) != reference:
        counts.fails("next run differs", number, tell)
    if number == "KILL" and left(place):
        counts.fails("left behind", number, tell + str(left(place)))


def moments(count: int, seconds: float, draw: random.Random) -> Iterator[float]:
    """Moments of a run, one in each of `count` equal parts."""
    return (seconds * (k + draw.random()) / count for k in range(count))


def tried(name: str, template: Path, checkout: Path, count: int, numbers: list[str], progress: Callable) -> Counts:
    """All signals at all moments of one verb."""
    verb = VERBS[name]
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        place = Path(folder) / "place"
        shutil.copytree(template, place)
        process = begin(verb, place, checkout)
        began = time.monotonic()
        finish(verb, process, place)
        seconds = time.monotonic() - began
        reference = contents(place, (*verb.out, *verb.grows))
    counts = Counts(seconds)
    for number in numbers:
        for moment in moments(count, seconds, random.Random(f"{name} {number}")):
            attempt(verb, template, checkout, number, moment, reference, counts)
            progress(f"{name} {number} at {moment:.2f} of {seconds:.2f} s: {dict(counts.wrong)}")
    return counts


def main() -> None:
    """Prints the counts of each verb."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=50)
    parser.add_argument("--only", action="append", choices=VERBS)
    parser.add_argument("--signals", nargs="*", choices=SIGNALS, default=list(SIGNALS))
    parser.add_argument("--checkout", type=Path, default=HERE)
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell ignores it for what runs in the background
    summary = {}
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        template = Path(folder) / "given"
        template.mkdir()
        inputs(template, options.checkout)
        for name in options.only or VERBS:
            began = time.monotonic()
            counts = tried(
                name,
                template,
                options.checkout,
                options.moments,
                options.signals,
                lambda text: print(text, file=sys.stderr),
            )
            summary[name] = {
                "run [s]": round(counts.seconds, 2),
                "signalled": dict(counts.signalled),
                "exit codes": dict(counts.ended),
                "wrong": dict(counts.wrong),
                "examples": counts.examples,
                "took [s]": round(time.monotonic() - began),
            }
            print(json.dumps({name: summary[name]}), file=sys.stderr, flush=True)
    total = sum(sum(verb_counts["signalled"].values()) for verb_counts in summary.values())
    wrong = sum(sum(verb_counts["wrong"].values()) for verb_counts in summary.values())
    print(json.dumps({"signalled": total, "wrong": wrong, "verbs": summary}, indent=1))


if __name__ == "__main__":
    main()
