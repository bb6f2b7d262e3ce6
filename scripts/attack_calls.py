"""Calls the public names of `sysid` and `twin` with odd values, and counts what is not a sentence.

    python scripts/attack_calls.py --every 1 > counts.json     # all values; --every 10 takes each tenth call
    python scripts/attack_calls.py --only sysid.fit --show      # the calls that are flagged, of one name

Each argument in turn gets every odd value of `ODD`; the others are valid. A call runs in a child process with limits of
time and memory. What counts as bad: an exception that is not the project's own ("untyped"), a number that is not finite
where the valid call has finite ones ("nan"), a call that does not return ("hang"), and a process that dies ("died").
"""

import argparse
import dataclasses
import importlib
import inspect
import json
import multiprocessing
import os
import resource
import select
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, date, datetime
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 10.0  # of one call
MEMORY = 3 << 30  # bytes beyond what the process has when it begins
# Rooms and modules whose names users call; of the packages themselves, what their stubs list.
PLACES = (
    "sysid",
    "twin",
    "sysid.blocks",
    "sysid.data",
    "sysid.data.preprocess",
    "sysid.diagnosis.bla",
    "sysid.excitations",
    "sysid.export.c",
    "sysid.export.closed_form",
    "sysid.export.matlab",
    "sysid.export.mjcf",
    "sysid.export.python",
    "sysid.formats",
    "sysid.joint.design",
    "sysid.linear",
    "sysid.plots",
    "sysid.selection.space",
    "sysid.solver.searches",
    "sysid.structures",
    "sysid.systems",
    "sysid.uncertainty.bands",
    "sysid.uncertainty.curves",
    "sysid.uncertainty.intervals",
    "sysid.uncertainty.responses",
    "twin.compare",
    "twin.design",
    "twin.parameter_file",
    "twin.pendulum",
    "twin.plant.leg",
    "twin.robot.crawl",
    "twin.robot.gait",
    "twin.signatures",
)
# What a call returns is no call of a user's; only the methods of these are attacked.
RESULTS = [
    "Advice",
    "Fit",
    "NlarxFit",
    "Signals",
    "Comparison",
    "Run",
    "Format",
    "Excitation",
    "Recipe",
    "InputError",
    "Design",
    "Phase",
]
RESULTS += [
    "Continuous",
    "Gain",
    "Mode",
    "Noise",
    "OperatingPoint",
    "OutputBand",
    "Curve",
    "Interval",
    "Band",
    "Root",
    "FrequencyResponse",
]
RESULTS += [
    "Travel",
    "Standing",
    "Measures",
    "Trial",
    "Crawl",
    "Plan",
    "Axis",
    "Line",
    "Mark",
    "Signature",
    "Size",
    "Bla",
    "Parametric",
    "Fragment",
]


def odd() -> dict[str, Any]:
    """Values that nobody means, and some that are fine where a number of another type is."""
    import pandas

    n = 200
    return {
        "None": None,
        "True": True,
        "0": 0,
        "1": 1,
        "-1": -1,
        "3": 3,
        "1e9 whole": 10**9,
        "1e30 whole": 10**30,
        "-1e30 whole": -(10**30),
        "1e400 whole": 10**400,
        "0.5": 0.5,
        "-0.5": -0.5,
        "1e9": 1e9,
        "1e308": 1e308,
        "-1e308": -1e308,
        "1e-308": 1e-308,
        "nan": float("nan"),
        "inf": float("inf"),
        "-inf": float("-inf"),
        "1j": 1j,
        "empty text": "",
        "text": "text",
        "number as text": "1",
        "bytes": b"x",
        "empty list": [],
        "empty tuple": (),
        "list of floats": [1.0, 2.0, 3.0],
        "list of texts": ["a"],
        "list of None": [None],
        "nested lists": [[1, 2], [3]],
        "empty dict": {},
        "dict": {"a": 1},
        "dict of texts": {"a": "b"},
        "set": {1},
        "object": object(),
        "function": lambda *a: None,
        "type": int,
        "slice": slice(None),
        "np.int64(1)": np.int64(1),
        "np.int64(-1)": np.int64(-1),
        "np.uint8(3)": np.uint8(3),
        "np.float32(0.5)": np.float32(0.5),
        "Fraction": Fraction(1, 2),
        "Decimal": Decimal("0.5"),
        "date": date(2020, 1, 1),
        "datetime": datetime(2020, 1, 1, tzinfo=UTC),
        "Path": Path("nowhere.txt"),
        "empty array": np.empty(0),
        "array 0-d": np.array(1.0),
        "array of 3": np.array([1.0, 2.0, 3.0]),
        "array of 200": np.linspace(-1, 1, n),
        "array of 200 x 1": np.linspace(-1, 1, n)[:, None],
        "array 3-d": np.ones((2, 2, 2)),
        "array of nan": np.full(n, np.nan),
        "array with inf": np.where(np.arange(n) == 7, np.inf, np.linspace(-1, 1, n)),
        "array of 1e308": np.linspace(-1e308, 1e308, n),
        "complex array": np.ones(n) * 1j,
        "object array": np.array([None] * n),
        "bool array": np.arange(n) % 3 == 0,
        "text array": np.array(["1.0"] * n),
        "array of dates": np.arange(n).astype("datetime64[s]"),
        "masked array": np.ma.masked_where(np.arange(n) < 5, np.linspace(-1, 1, n)),
        "int8 array": (np.arange(n) % 7).astype(np.int8),
        "series": pandas.Series(np.linspace(-1, 1, n)),
        "list of 200": np.linspace(-1, 1, n).tolist(),
        "generator": (k for k in range(3)),
    }


class Supply:
    """Valid arguments by the name and the type of a parameter, and instances for methods."""

    def __init__(self) -> None:
        import sysid
        import twin

        rng = np.random.default_rng(0)
        chain = sysid.structures.output_error(1, 1, 1)
        u = np.repeat(rng.uniform(-1, 1, 40), 5)
        y = np.zeros(200)
        for k in range(1, 200):
            y[k] = 0.8 * y[k - 1] + 0.4 * u[k - 1]
        data = sysid.IOData(u, y + 0.01 * rng.standard_normal(200), Ts=0.1)
        few = sysid.Options(max_iterations=5)
        fit = sysid.fit(chain, data, starts=1, options=few)
        network = sysid.structures.nlarx(1, 1, 1, units=1)
        joint = sysid.load(ROOT / "tests" / "saved" / "v1" / "joint_jams.json")
        info = sysid.information(fit, data)
        experiment = twin.Experiment(duration=4.0, Ts=0.1, excitation="steps")
        log = experiment.run()
        follower = twin.Follower(log, "thigh", threads=1)
        csv = Path("log.csv").resolve()
        csv.write_text("t,u,y\n" + "".join(f"{k / 10},{a},{b}\n" for k, (a, b) in enumerate(zip(u, y, strict=True))))
        saved = fit.save(Path("fit.json").resolve())
        parameters = twin.Parameters()
        self.by_name: dict[str, Any] = {
            "data": data, "record": data, "fit": fit, "model": chain, "chain": chain, "theta": fit.theta, "u": u,
            "y": y, "e": data.y[:, 0] - y, "Ts": 0.1, "options": few, "info": info, "run": y, "fits": (50.0,),
            "joint": "thigh", "experiment": experiment, "parameters": parameters, "log": log, "label": "one",
            "base": parameters, "number": 2, "seeds": (1,), "draws": twin.Draws(), "folder": "ensemble",
            "path": str(csv), "name": "textbook", "role": "linear", "x": u, "block": chain.blocks[0], "band": None,
            "kind": "saturation", "seed": 1, "threads": 1, "samples": 20, "N": 200, "rng": np.random.default_rng(1),
            "table": str(csv), "columns": {"a": u}, "changes": {"thigh.coulomb": 20.0}, "without": ("friction",),
            "period": 50, "nb": 1, "nf": 1, "course": follower.courses([parameters])[0],
            "coarse": chain, "points": 11, "input": "u", "output": "y", "step": _lag, "mass": 0.05, "length": 0.1,
            "starts": 1, "file": str(csv), "estimation": data, "validation": data, "f": _tanh, "what": "noise",
            "spread": {"thigh.coulomb": 0.1}, "second": log, "duration": 4.0, "standing": 0.5, "steps": 2,
            "excitation": "steps", "draws_": 20, "seconds": 1.0, "column": "u", "curve": None, "duty": 0.5,
            "start": 0, "stop": 100, "signal": u, "text": "a step", "response": None, "values": {},
        }  # fmt: skip
        self.by_owner: dict[tuple[str, str], Any] = {
            ("load", "path"): str(saved), ("Log.load", "path"): str(csv), ("plots.parts", "estimation"): data,
            ("Log.save", "path"): "new.csv", ("save", "path"): "new.json", ("write", "path"): "new.c",
            ("Fit.save", "path"): "new.json", ("joint_values", "fit"): joint, ("excitation", "name"): "steps",
            ("design", "fit"): joint, ("fit_nlarx", "model"): network, ("monte_carlo", "draws"): 20,
            ("mjcf.fragment", "fit"): joint, ("curves.curve", "role"): "linear", ("Chain", "blocks"): chain.blocks,
            ("dynamic", "parameters"): {"gain": 1.0}, ("dynamic", "step"): _lag, ("cross_validate", "folds"): 2,
            ("parameter_file.read", "path"): str(_params()), ("parameter_file.write", "path"): "p.toml",
            ("write_table", "path"): "new.csv", ("grow_joint", "starts"): 1, ("Follower.readings", "parameters"):
            [parameters], ("Follower.courses", "parameters"): [parameters], ("select", "seconds"): 3.0,
            ("compare", "log"): log, ("crawl.run", "draws"): 0, ("searches.search", "name"): "lm",
            ("compare.compare_model", "fit"): sysid.fit(chain, log.io(), starts=1, options=few),
            ("pendulum.respond", "pendulums"): [twin.pendulum.Pendulum(0.05, 0.1)],
            ("pendulum.respond", "starts"): [0.0], ("pendulum.respond", "u"): np.zeros((20, 1)),
            ("Experiment.record", "run"): experiment.prepare(), ("Ensemble.case", "number"): 0,
            ("blocks.static", "role"): "map", ("Custom", "names"): ("gain",), ("Custom", "initial"): (1.0,),
            ("Dynamic", "text"): LAG, ("Dynamic", "names"): ("gain",), ("Dynamic", "first"): (1.0,),
            ("Dynamic", "lower"): (-9.0,), ("Dynamic", "upper"): (9.0,), ("stand", "gait"): twin.robot.gait.Gait(),
        }  # fmt: skip
        self.instances: dict[str, Any] = {
            "Fit": fit, "Chain": chain, "IOData": data, "Experiment": experiment, "Log": log,
            "NlarxFit": sysid.fit_nlarx(network, data, starts=1, options=few), "Parameters": parameters,
            "Draws": twin.Draws(spread={"thigh.coulomb": 0.1}), "Follower": follower, "Options": few,
            "Ensemble": twin.Ensemble(experiment, (1,), None, "ensemble"),
        }  # fmt: skip
        for kind in sysid.excitations.TABLE.values():
            self.instances[kind.__name__] = kind()
        # Slow calls, with what makes them quick.
        self.quick: dict[str, dict[str, Any]] = {
            "sysid.fit": {"starts": 1, "options": few},
            "sysid.fit_nlarx": {"starts": 1, "options": few},
            "sysid.fit_from": {"options": few},
            "sysid.cross_validate": {"folds": 2, "starts": 1, "options": few},
            "sysid.select": {"seconds": 2.0, "jobs": 1},
            "sysid.grow_joint": {"starts": 1, "parts": ()},
            "twin.Experiment": {"duration": 4.0, "excitation": "steps"},
            "sysid.uncertainty.bands.monte_carlo": {"draws": 20},
            "twin.compare.compare": {"seconds": 1.0, "values": False, "threads": 1},
        }

    def argument(self, owner: str, parameter: inspect.Parameter) -> Any:
        """A valid value; raises KeyError where none is known."""
        for k in range(owner.count(".") + 1):
            key = (owner.split(".", k)[-1], parameter.name)
            if key in self.by_owner:
                return self.by_owner[key]
        return self.by_name[parameter.name]


LAG = "def step(s, x, p):\n    s.level += 0.1 * (p.gain * x - s.level)\n    return s.level\n"


def _lag(s: Any, x: Any, p: Any) -> Any:
    s.level += 0.1 * (p.gain * x - s.level)
    return s.level


def _tanh(x: np.ndarray, theta: np.ndarray) -> np.ndarray:
    return theta[0] * np.tanh(x)


def _params() -> Path:
    path = Path("parameters.toml").resolve()
    path.write_text('["thigh"]\ncoulomb = 20.0\n')
    return path


def targets() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Name, function and class (of a method, else '') of what is called."""
    seen: set[int] = set()
    for place in PLACES:
        module = importlib.import_module(place)
        listed = getattr(module, "__all__", None) or [n for n in vars(module) if not n.startswith("_")]
        for name in listed:
            value = getattr(module, name)
            own = str(getattr(value, "__module__", "")).split(".")[0] in ("sysid", "twin")
            if not own or inspect.ismodule(value) or not callable(value) or id(value) in seen:
                continue
            if not hasattr(module, "__all__") and value.__module__ != place:
                continue
            seen.add(id(value))
            if not (inspect.isclass(value) and name in RESULTS):
                yield f"{place}.{name}", value, ""
            if inspect.isclass(value):
                for method, found in vars(value).items():
                    if not method.startswith("_") and inspect.isfunction(found):
                        yield f"{place}.{name}.{method}", found, name


def calls(supply: Supply) -> Iterator[tuple[str, Callable[[], Any], list[tuple[str, str, Callable[[], Any]]]]]:
    """Each target with its valid call and its odd ones: parameter, name of the value, call."""
    for name, function, owner in targets():
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            continue
        first = ()
        if owner:
            if owner not in supply.instances:
                continue
            first, parameters = (supply.instances[owner],), parameters[1:]
        plain = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
        quick = supply.quick.get(name, {})
        try:
            valid = {p.name: supply.argument(name, p) for p in plain if p.default is p.empty} | quick
        except KeyError:
            yield name, _unknown, []
            continue
        more = [p.name for p in plain]
        if any(p.kind is p.VAR_KEYWORD for p in parameters):
            more += [n for n in quick if n not in more]
        tried = [(p, value, partial(_call, function, first, valid, p, value)) for p in more for value in odd()]
        yield name, partial(function, *first, **valid), tried


def _call(function: Callable[..., Any], first: tuple, valid: dict[str, Any], name: str, value: str) -> Any:
    return function(*first, **{**valid, name: odd()[value]})


def _unknown() -> None:
    raise LookupError("no valid arguments known")


def finite(value: Any, depth: int = 0) -> bool:
    """Whether every number in a result is finite, as far down as results go."""
    if isinstance(value, (float, complex, np.number)):
        return bool(np.isfinite(value))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
        return bool(np.all(np.isfinite(value)))
    if depth > 3:
        return True
    if isinstance(value, (list, tuple)):
        return all(finite(v, depth + 1) for v in value)
    if isinstance(value, dict):
        return all(finite(v, depth + 1) for v in value.values())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return all(finite(getattr(value, f.name), depth + 1) for f in dataclasses.fields(value))
    return True


def outcome(call: Callable[[], Any], was_finite: bool) -> tuple[str, str]:
    """'fine', 'sentence', 'untyped' or 'nan', and what was said."""
    try:
        found = call()
        if inspect.isgenerator(found):
            found = list(found)
    except (KeyboardInterrupt, SystemExit) as e:
        return "untyped", repr(e)
    except pydantic.ValidationError as e:  # the typed error of a `Channel` and its like
        return "sentence", str(e)
    except BaseException as e:
        if any(kind.__module__.split(".")[0] in ("sysid", "twin") for kind in type(e).__mro__):
            return "sentence", str(e)
        return "untyped", f"{type(e).__name__}: {e}"[:300]
    return ("nan" if was_finite and not finite(found) else "fine"), ""


def worker(jobs: list[Callable[[], Any]], first: int, pipe: int) -> None:
    """In the child: the valid call, then every other from `first` on; a line for each."""
    warnings.simplefilter("ignore")
    quiet = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(quiet, stream)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with os.fdopen(pipe, "w") as out:
        try:
            reference = jobs[0]()
            was_finite, said = finite(reference), ["valid", ""]
        except BaseException as e:
            was_finite, said = False, ["invalid", f"{type(e).__name__}: {e}"[:300]]
        print(json.dumps([0, *said]), file=out, flush=True)
        if said[0] == "valid":
            for k in range(max(first, 1), len(jobs)):
                print(json.dumps([k, *outcome(jobs[k], was_finite)]), file=out, flush=True)
    os._exit(0)


def attacked(jobs: list[Callable[[], Any]]) -> list[tuple[str, str]]:
    """The outcome of each; a child that hangs or dies is followed by another."""
    found: list[tuple[str, str]] = []
    while len(found) < len(jobs):
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            worker(jobs, len(found), write)
        os.close(write)
        buffer, ended, begun = b"", "", time.monotonic()
        while not ended:
            ready, _, _ = select.select([read], [], [], max(0.0, begun + SECONDS - time.monotonic()))
            piece = os.read(read, 1 << 16) if ready else b""
            if not piece:
                ended = "died" if ready else "hang"
            *lines, buffer = (buffer + piece).split(b"\n")
            for line in lines:
                k, how, said = json.loads(line)
                begun = time.monotonic()
                if k == len(found):
                    found.append((how, said))
        os.close(read)
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if found and found[0][0] == "invalid":
            return found
        if len(found) < len(jobs):
            found.append((ended, f"status {status}"))
    return found


def share(part: int, parts: int, every: int, only: str) -> list[tuple[str, str, str, str, str]]:
    """Of one process: name, parameter, value, outcome and what was said, for its part of the targets."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        warnings.simplefilter("ignore")
        supply = Supply()
        for k, (name, valid, tried) in enumerate(calls(supply)):
            if k % parts != part or only not in name:
                continue
            tried = tried[hash_of(name) % every :: every]
            done = attacked([valid, *(call for _, _, call in tried)])
            rows.append((name, "", "", *done[0]))
            if done[0][0] == "valid":
                rows += [(name, p, v, *d) for (p, v, _), d in zip(tried, done[1:], strict=True)]
        os.chdir("/")
    return rows


def hash_of(name: str) -> int:
    """The same in every process."""
    return sum(map(ord, name))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, help="only each so many-th call")
    parser.add_argument("--only", default="", help="only names that contain this")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--show", action="store_true", help="list the flagged calls on standard error")
    given = parser.parse_args()
    begun = time.monotonic()
    with multiprocessing.get_context("fork").Pool(given.jobs) as pool:
        parts = [(k, given.jobs, given.every, given.only) for k in range(given.jobs)]
        rows = [row for found in pool.starmap(share, parts) for row in found]
    made = [r for r in rows if r[1]]
    bad = [r for r in made if r[3] not in ("fine", "sentence")]
    if given.show:
        for row in bad + [r for r in rows if r[3] == "invalid"]:
            print(*row, sep=" | ", file=sys.stderr)
    counts = {
        "names": len({r[0] for r in made}),
        "calls": len(made),
        "flagged": len(bad),
        **dict(sorted(Counter(r[3] for r in made).items())),
        "no valid call known": sorted(r[0] for r in rows if r[3] in ("invalid", "hang", "died") and not r[1]),
        "worst": dict(Counter(r[0] for r in bad).most_common(15)),
        "seconds": round(time.monotonic() - begun, 1),
    }
    print(json.dumps(counts, indent=1))


if __name__ == "__main__":
    main()
