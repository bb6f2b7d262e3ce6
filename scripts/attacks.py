"""All attacks on the product, one class after the other, with one shape of result: counts, and samples of what is bad.

    python scripts/attacks.py --out counts.json                       # hours on two cores
    python scripts/attacks.py --seed 7 --scale 0.01 --only logs,kills --out runs/counts.json
    python scripts/attacks.py --only kills --part auto --scale 0.1    # the cases whose place has this in its name
    python scripts/attacks.py --again logs:1234 --seed 7              # one damaged file, here, with its traceback

`--scale 1` is 100,000 damaged files and models, 200 kills, 2,000 random fits, 50 clients on the app for a minute, 2,000
benchmark methods, and every case of the other classes; a smaller scale takes that part of each. Each class runs in a
process of its own. With --out its counts are written as soon as it ends, and a run that was stopped goes on with the
classes that are missing; delete the file to begin again. Exit status 1 if anything is bad.
"""

import argparse
import importlib
import json
import sys
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parent / name) for name in ("../tests", "studies"))

from fuzz.tally import Tally


@dataclass(frozen=True)
class Chosen:
    """What a class is told: the seed, the part of its full size, a text in names of places, a folder for samples."""

    seed: int
    scale: float
    part: str
    keep: Path | None = None

    def size(self, full: int) -> int:
        """How many cases are left of a full run."""
        return max(1, round(full * self.scale))


def damaged(name: str, chosen: Chosen) -> Tally:
    """Files of one kind with damaged bytes or other values."""
    from fuzz.runner import run
    from fuzz.targets import SIZES, TARGETS

    return run(TARGETS[name](), range(chosen.size(SIZES[name])), chosen.seed, chosen.keep and chosen.keep / name)


def fits(chosen: Chosen) -> Tally:
    """The cases of the study of random fits whose seeds begin at the seed."""
    from random_fits import score

    tally = Tally()
    for seed in range(chosen.seed, chosen.seed + chosen.size(2000)):
        found = score((seed,), argparse.Namespace())
        told = [fault for fault in found["wrong"] if "_told" in fault]  # the fit says so itself
        end = "refused" if found["name"].endswith("refused") else told[0].split()[0] if told else "fitted"
        bad = [fault for fault in found["wrong"] if fault not in told]
        tally.case(end, [(fault.split()[0], f"seed {seed} {found['name']}: {fault}") for fault in bad])
    return tally


def of_module(name: str, chosen: Chosen) -> Tally:
    """The class in `scripts/attack/NAME.py`."""
    return importlib.import_module(f"attack.{name}").attack(chosen)


FILES = ("logs", "binaries", "models", "journals", "parameters", "sessions")
OTHERS = ("kills", "clients", "methods", "calls", "text", "numbers", "environments", "soak")
CLASSES: dict[str, Callable[[Chosen], Tally]] = {name: partial(damaged, name) for name in FILES}
CLASSES |= {"fits": fits} | {name: partial(of_module, name) for name in OTHERS}


def counted(name: str, chosen: Chosen) -> dict[str, Any]:
    """The counts of one class."""
    start = time.monotonic()
    tally = CLASSES[name](chosen)
    tally.seconds = time.monotonic() - start
    return tally.as_dict()


def apart(name: str, chosen: Chosen) -> dict[str, Any]:
    """The counts of one class in a process of its own: forks of one with threads wait for ever. Its end is bad too."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        try:
            return pool.submit(counted, name, chosen).result()
        except Exception as error:
            tally = Tally()
            said = "".join(traceback.format_exception(error))
            tally.case("ended", [(f"the class ended: {type(error).__name__}", said[-600:])])
            return tally.as_dict()


def known(out: Path | None, chosen: dict[str, Any]) -> dict[str, Any]:
    """The counts that a former run with the same options has written; raises SystemExit for other options."""
    if out is None or not out.exists():
        return {}
    try:
        former = json.loads(out.read_text(encoding="utf-8"))
        options, classes = {name: former[name] for name in chosen}, former["classes"]
    except (ValueError, KeyError, TypeError):
        raise SystemExit(f"{out} is no file of counts; give another --out") from None
    if options != chosen:
        raise SystemExit(f"{out} has the counts of {options}; give another --out, or delete it")
    return classes


def total(classes: dict[str, Any], chosen: dict[str, Any]) -> dict[str, Any]:
    """The document: options, sums and classes."""
    sums = {name: round(sum(count[name] for count in classes.values())) for name in ("cases", "bad", "seconds")}
    return {**chosen, **sums, "classes": classes}


def again(which: str, seed: int) -> int:
    """One damaged file in this process, with its traceback; its files stay."""
    import tempfile

    import numpy as np
    from fuzz.targets import TARGETS

    name, _, k = which.partition(":")
    folder = Path(tempfile.mkdtemp())
    print(folder, TARGETS[name]().case(np.random.default_rng([seed, int(k), *name.encode()]), folder))
    return 0


def table(classes: dict[str, Any]) -> str:
    """One line for each class."""
    heads = ("cases", "bad", "seconds")
    rows = [("class", *heads), *((name, *(count[head] for head in heads)) for name, count in classes.items())]
    return "\n".join("{:14}{:>9}{:>6}{:>9}".format(*row) for row in rows)


def names(text: str) -> list[str]:
    """The names of classes in a list with commas."""
    found = [name for name in CLASSES if name in text.split(",")]
    if len(found) != len(text.split(",")):
        raise argparse.ArgumentTypeError(f"found {text}; give names of {', '.join(CLASSES)}")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run the classes, print the table and write the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--only", type=names, default=list(CLASSES), metavar="NAME,..", help=", ".join(CLASSES))
    parser.add_argument("--part", default="", help="of a class the cases whose place has this text in its name")
    parser.add_argument("--out", type=Path, metavar="FILE.json")
    parser.add_argument("--keep", type=Path, help="folder for damaged files that are bad")
    parser.add_argument("--again", metavar="NAME:K", help="damaged file K alone, in this process")
    options = parser.parse_args(arguments)
    if not 0.0 < options.scale <= 1.0:
        parser.error(f"--scale is {options.scale}; give a number above 0, up to 1")
    if options.again:
        return again(options.again, options.seed)
    from sysid.base.files import write_text

    settings = {"seed": options.seed, "scale": options.scale, "part": options.part}
    classes = known(options.out, settings)
    for name in [name for name in options.only if name not in classes]:
        print(f"{name} ...", file=sys.stderr, flush=True)
        classes[name] = apart(name, Chosen(**settings, keep=options.keep))
        if options.out is not None:
            write_text(options.out, json.dumps(total(classes, settings), indent=1) + "\n")
    shown = {name: classes[name] for name in options.only}
    print(table(shown))
    for name, count in shown.items():
        for kind, samples in count["samples"].items():
            print(f"{name}: {kind}: {count['kinds'][kind]}", *samples[:2], sep="\n    ")
    return int(any(count["bad"] for count in shown.values()))


if __name__ == "__main__":
    sys.exit(main())
