"""Which cells a tag stands for: scenarios by pattern, methods, how many seeds, and the time that each fit may take."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.metadata import version

from sysid.base.errors import InputError, unknown
from sysid.bench.cell import Cell
from sysid.bench.drawing.plants import CHAINS
from sysid.bench.method import Method
from sysid.bench.table import BAR
from sysid.bench.task import Family

OWN = "own"  # the method that is called as the drawn structure is
PEERS = "peers"  # every method that is not of this library
DRAWN = tuple(f"drawn/{structure}" for structure in CHAINS)


@dataclass(frozen=True)
class Part:
    """Patterns of scenarios ("family/name"), names of methods, seeds of each scenario."""

    scenarios: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: int


@dataclass(frozen=True)
class Suite:
    """What a tag runs; every fit may take `seconds`."""

    about: str
    seconds: float
    parts: tuple[Part, ...]


SHORT = ("drawn/output_error-short", "drawn/hammerstein-short", "drawn/wiener-short")
JOINTS = tuple(f"{kind}/{joint}" for kind in ("twin", "legs", "mismatch") for joint in ("shoulder", "thigh", "shank"))
PHYSICAL = (
    Part(("real/emps",), ("emps_motor", "emps_joint", "emps_profile"), 1),
    Part(("real/ced",), ("ced_drives",), 1),
    Part(("real/bam_xl330",), ("servo_joint", "servo_profile"), 1),
)
SUITES: Mapping[str, Suite] = {
    "quick": Suite(
        "what CI compares with its baseline: under 5 minutes on two cores; searches run to their end",
        15.0,
        (
            Part(DRAWN, (BAR, OWN), 16),
            Part(
                tuple(f"drawn/{name}-short" for name in ("output_error", "hammerstein", "wiener")),
                (BAR, "auto_of_two"),
                4,
            ),
            Part(("textbook/*",), (BAR, "hammerstein_wiener"), 2),
            Part(("twin/shoulder", "twin/thigh", "twin/shank"), ("actuated_joint",), 4),
        ),
    ),
    "standard": Suite(
        "the leaderboard: this library and its peers, 5 s a fit (too short for auto); 25 minutes on two cores",
        5.0,
        (
            Part((*DRAWN, "drawn/nlarx"), (BAR, OWN, PEERS), 3),
            Part(("textbook/*", "stress/*"), (BAR, "hammerstein_wiener", PEERS), 1),
            Part(JOINTS, ("actuated_joint", PEERS), 1),
            Part(("real/*",), ("output_error", "hammerstein_wiener", "wiener_hammerstein", PEERS), 1),
            Part(("real/cascaded_tanks", "real/ced", "real/hair_dryer"), ("nlarx",), 1),
            *PHYSICAL,
        ),
    ),
    "full": Suite(
        "for a cluster: many seeds and long records",
        60.0,
        (
            Part(("drawn/*",), (BAR, OWN, "auto", PEERS), 40),
            Part(("textbook/*", "stress/*"), (BAR, "output_error", "hammerstein_wiener", "nlarx", "auto", PEERS), 10),
            Part(("twin/*", "legs/*", "mismatch/*"), ("actuated_joint", "auto", PEERS), 10),
            Part(("real/*",), ("output_error", "hammerstein_wiener", "wiener_hammerstein", "nlarx", "auto", PEERS), 1),
            *PHYSICAL,
        ),
    ),
}


def first_seed(release: str | None = None) -> int:
    """The first seed of this version: nobody can tune to the draws of a version that is yet to come."""
    digest = hashlib.sha256(f"qpal {release or version('qpal')}".encode()).hexdigest()
    return int(digest[:8], 16) % 10**6 * 1000


def names(families: Mapping[str, Family]) -> list[str]:
    """All scenarios as "family/name"."""
    return [f"{family.name}/{scenario}" for family in families.values() for scenario in family.scenarios()]


def cells(
    parts: Sequence[Part],
    seconds: float,
    families: Mapping[str, Family],
    methods: Mapping[str, Method],
    first: int | None = None,
    ours: Sequence[str] = (),
) -> list[Cell]:
    """The cells of some parts, seeds outermost, so that a run that stops early has met every scenario.

    Seeds count from `first`, that of the version if None. Raises InputError for a pattern that matches no scenario, and
    for unknown methods.
    """
    for name in (name for part in parts for name in part.methods):
        if name not in methods and name not in (OWN, PEERS):
            raise unknown("method", name, methods)
    start, chosen_cells = first_seed() if first is None else first, dict[tuple[str, str, int], Cell]()
    all_names = names(families)
    for part in parts:
        for pattern in part.scenarios:
            if not any(fnmatchcase(name, pattern) for name in all_names):
                raise InputError(f"no scenario is called {pattern}; qpal bench list shows them")
    largest = max((part.seeds for part in parts), default=0)
    for k in range(largest):
        for part in parts:
            if k >= part.seeds:
                continue
            names_of_part = [name for name in all_names if any(fnmatchcase(name, p) for p in part.scenarios)]
            for name in names_of_part:
                family, _, scenario = name.partition("/")
                for method in _methods(part, scenario, methods, ours):
                    cell = Cell(families[family], scenario, method, start + k, seconds)
                    chosen_cells.setdefault(cell.key, cell)
    return list(chosen_cells.values())


def _methods(part: Part, scenario: str, methods: Mapping[str, Method], ours: Sequence[str]) -> list[Method]:
    selection = []
    for name in part.methods:
        key_name = scenario.partition("-")[0] if name == OWN else name
        if key_name == PEERS:
            selection += [method for key, method in methods.items() if key not in ours and key != BAR]
        elif key_name in methods:
            selection.append(methods[key_name])
    return selection
