"""Methods of the benchmark that answer with anything: each gets a row that says so, and the rows of others stand.

First each odd value is put at each place of an answer alone, then many answers have several at drawn places. Every
answer is a row between two of a good method, in a table that is written and read. Bad are: an exception that ends the
run, a missing row, a row of the good method that is not as without it, a warning, a hang.
"""

import itertools
import json
import os
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from fuzz.tally import Tally, part

from sysid.bench.cell import Cell, run_cells
from sysid.bench.method import FunctionMethod, Outcome
from sysid.bench.table import COLUMNS, Table
from sysid.bench.task import Task, Truth
from sysid.blocks import Saturation, TransferFunction
from sysid.data.record import IOData
from sysid.model.chain import Chain

SLOW = 5  # [s] of work for a row is a hang; a method that waits is stopped by its budget
SEVERAL = 2000  # answers of a full attack with several odd values
RIGHT = ("ok", "crashed", "refused", "stopped", "no data", "not installed")  # how a status may begin
N, TEST = 60, "a"


class Unprintable(Exception):  # noqa: N818 - a name that a stranger chose
    """Its message cannot be had."""

    def __str__(self) -> str:
        raise ValueError("no text")

    __repr__ = __str__


class Ends(BaseException):
    """No Exception: it passes every except Exception."""


class Raises:
    """Whatever one asks of it, it raises."""

    def __getattr__(self, name: str) -> Any:
        raise Unprintable

    def __str__(self) -> str:
        raise Ends

    def __len__(self) -> int:
        raise RecursionError

    def __iter__(self) -> Iterator[Any]:
        raise SystemExit(3)

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise MemoryError

    def __float__(self) -> float:
        raise Ends

    def __bool__(self) -> bool:
        raise Unprintable

    def __eq__(self, other: object) -> bool:
        raise Unprintable

    __hash__ = object.__hash__


class Text(str):
    """A text whose methods lie."""

    __slots__ = ()

    def __str__(self) -> str:
        return 3  # type: ignore[return-value]

    def __getitem__(self, key: Any) -> Any:
        raise Ends


def _loop() -> list[Any]:
    loop: list[Any] = []
    loop.append(loop)
    return loop


def _objects(element: object) -> np.ndarray:
    run = np.empty(N, dtype=object)
    for k in range(N):
        run[k] = element
    return run


def _deep() -> list[Any]:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    return deep


VALUES: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "True": lambda: True,
    "zero": lambda: 0,
    "negative": lambda: -1,
    "huge whole number": lambda: 10**5000,
    "1e30": lambda: 1e30,
    "1e308": lambda: 1e308,
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "complex": lambda: 1j,
    "empty text": lambda: "",
    "text": lambda: "soon",
    "number as text": lambda: "3.0",
    "bytes": lambda: b"\xff\x00",
    "surrogate": lambda: "\ud800 and \0 and \x1b[2J",
    "long text": lambda: "x" * 10**6,
    "text that lies": lambda: Text("ok"),
    "list": lambda: [1, 2, 3],
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "list in itself": _loop,
    "deep list": _deep,
    "empty list": list,
    "set": lambda: {1, 2},
    "dictionary": lambda: {"a": 1},
    "dictionary of odd names": lambda: {None: 1, Unprintable(): 2, (1,): {}},
    "generator": lambda: (1.0 for _ in range(N)),
    "endless generator": lambda: itertools.count(),
    "object": object,
    "type": lambda: int,
    "what raises": Raises,
    "function": lambda: len,
    "module": lambda: json,
    "run too short": lambda: np.zeros(N // 2),
    "run too long": lambda: np.zeros(N + 1),
    "run of two columns": lambda: np.zeros((N, 2)),
    "run as a column": lambda: np.zeros((N, 1)),
    "run of complex": lambda: np.zeros(N, dtype=complex),
    "run of objects": lambda: _objects(Raises()),
    "run of None": lambda: np.array([None] * N),
    "run of text": lambda: np.array(["1.0"] * N),
    "run of dates": lambda: np.zeros(N, dtype="datetime64[s]"),
    "run of times": lambda: np.zeros(N, dtype="timedelta64[s]"),
    "run of truths": lambda: np.zeros(N, dtype=bool),
    "run of records": lambda: np.zeros(N, dtype=[("a", float)]),
    "run of nan": lambda: np.full(N, np.nan),
    "run of 1e300": lambda: np.full(N, 1e300),
    "run of -inf": lambda: np.full(N, -np.inf),
    "masked run": lambda: np.ma.masked_all(N),
    "single number": lambda: np.float64(1.0),
    "no dimension": lambda: np.array(3.0),
    "100,000 poles": lambda: np.full(100_000, 0.5),
    "poles of 1e308": lambda: np.full(2, 1e308),
    "pole at 0": lambda: np.zeros(1),
    "interval of nan": lambda: {"pole": [[np.nan] * 4]},
    "interval of 1e308": lambda: {"pole": [[1e308] * 4]},
    "intervals of text": lambda: {"pole": "wide"},
}
ERRORS: dict[str, Callable[[], BaseException]] = {
    "RuntimeError": lambda: RuntimeError("out of luck"),
    "unprintable": Unprintable,
    "long message": lambda: ValueError("x" * 10**6),
    "lines": lambda: ValueError("one\ntwo\x1b[2J\ud800"),
    "SystemExit": lambda: SystemExit(0),
    "SystemExit with an object": lambda: SystemExit(Raises()),
    "GeneratorExit": GeneratorExit,
    "no Exception": Ends,
    "recursion": RecursionError,
    "memory": MemoryError,
    "group": lambda: BaseExceptionGroup("several", [Ends(), ValueError()]),
    "stop": StopIteration,
    "warning": lambda: UserWarning("odd"),
}
PLACES = (
    *("status", "runs", "run", "details", "poles", "intervals", "loss", "stop", "structure", "seconds", "memory"),
    *("version", "outcome", "model", "simulated", "told", "told poles", "name", "about"),
)
RAISED = ("solve", "fit", "simulate", "attributes", "outcome attributes", "name")


@dataclass(frozen=True)
class Chosen:
    """A family of one short record of a known plant."""

    name: str = "chosen"
    about: str = ""

    def scenarios(self) -> list[str]:
        return ["lag"]

    def make(self, scenario: str, seed: int) -> Task:
        chain, theta = Chain((Saturation(role="input"), TransferFunction(1, 1, 0))), np.array([-0.5, 0.8, 0.2, -0.8, 0])
        u = np.random.default_rng(seed).standard_normal((2, N))
        train, test = (IOData(row, chain.simulate(theta, row) + 0.01 * (-1.0) ** np.arange(N), 0.5) for row in u)
        truth = Truth({TEST: chain.simulate(theta, u[1])}, 0.01, np.array([0.8 + 0j]), chain, theta)
        return Task(train, {TEST: test}, 5, "V", (1, 1, 0), truth)


class Model:
    """What a good method returns, but for what it is told to do."""

    def __init__(self, odd: dict[str, Any], raised: dict[str, BaseException]) -> None:
        self._odd, self._raised = odd, raised

    def simulate(self, u: np.ndarray, y_init: np.ndarray) -> Any:
        """Noise-free output of the plant, or what is odd."""
        if "simulate" in self._raised:
            raise self._raised["simulate"]
        print("what a method prints")
        u[:], y_init[:], run = 0.0, 0.0, np.cumsum(u)  # it may write into what it gets
        return self._odd.get("simulated", run)

    @property
    def poles(self) -> Any:
        """Its poles, or what is odd."""
        if "attributes" in self._raised:
            raise self._raised["attributes"]
        return self._odd.get("told poles", [0.8])

    @property
    def details(self) -> Any:
        """What it tells of itself."""
        return self._odd.get("told", _details(self._odd))


class Odd:
    """A method whose answer is right but for the odd values at some places, and errors at others."""

    def __init__(self, odd: dict[str, Any], raised: dict[str, BaseException]) -> None:
        self.odd, self.raised = odd, raised

    @property
    def name(self) -> Any:
        """Its name."""
        if "name" in self.raised:
            raise self.raised["name"]
        return self.odd.get("name", "odd")

    @property
    def about(self) -> Any:
        """What it is."""
        return self.odd.get("about", "")

    def solve(self, task: Task, tests: Any, seconds: float, seed: int) -> Any:
        """An outcome."""
        if "solve" in self.raised:
            raise self.raised["solve"]
        if "outcome attributes" in self.raised:
            return _Lazy(self.raised["outcome attributes"])
        if "outcome" in self.odd:
            return self.odd["outcome"]
        if {*self.odd} & {"model", "simulated", "told", "told poles"} or {*self.raised} & {*RAISED}:
            return FunctionMethod("inner", "", self._fit).solve(task, tests, seconds, seed)
        runs = {name: self.odd.get("run", np.zeros(len(u))) for name, (u, _) in tests.items()}
        given = {name: self.odd[name] for name in ("seconds", "memory", "version") if name in self.odd}
        details = self.odd.get("details", _details(self.odd))
        return Outcome(self.odd.get("status", "ok"), self.odd.get("runs", runs), details, **given)

    def _fit(self, data: Any) -> Any:
        if "fit" in self.raised:
            raise self.raised["fit"]
        return self.odd.get("model", Model(self.odd, self.raised))


class _Lazy(Outcome):
    """An outcome that raises when one looks at it."""

    def __init__(self, error: BaseException) -> None:
        object.__setattr__(self, "error", error)

    def __getattribute__(self, name: str) -> Any:
        if name in ("status", "runs", "details"):
            raise object.__getattribute__(self, "error")
        return object.__getattribute__(self, name)


def _details(odd: dict[str, Any]) -> dict[str, Any]:
    names = ("poles", "intervals", "loss", "stop", "structure")
    return {"loss": 1.0, "poles": [[0.8, 0.0]]} | {name: odd[name] for name in names if name in odd}


def good() -> SimpleNamespace:
    """A method that answers as it should."""

    def solve(task: Task, tests: Any, seconds: float, seed: int) -> Outcome:
        return Outcome("ok", {name: np.zeros(len(u)) for name, (u, _) in tests.items()}, {"loss": 1.0}, 1.0, 1.0, "1")

    return SimpleNamespace(name="good", about="", solve=solve)


def alone() -> Iterator[tuple[str, Odd]]:
    """Each value at each place, and each error wherever one can be raised."""
    for place in PLACES:
        for name, make in VALUES.items():
            yield f"{place}: {name}", Odd({place: make()}, {})
    for place in RAISED:
        for name, raised in ERRORS.items():
            yield f"{place} raises: {name}", Odd({}, {place: raised()})


def drawn(rng: np.random.Generator) -> tuple[str, Odd]:
    """Two to five places with odd values, and now and then an error."""
    places = rng.choice(PLACES, rng.integers(2, 6), replace=False)
    chosen = {str(place): str(rng.choice(list(VALUES))) for place in places}
    errors = {str(rng.choice(RAISED)): str(rng.choice(list(ERRORS)))} if rng.random() < 0.2 else {}
    odd = Odd({place: VALUES[name]() for place, name in chosen.items()}, {p: ERRORS[e]() for p, e in errors.items()})
    return f"{chosen} {errors}", odd


def fault(method: Odd, folder: Path, expected: list[dict[str, Any]]) -> tuple[str, str]:
    """How the row's status begins, and what went wrong; empty if nothing."""
    table = Table(folder / "t.parquet")
    cells = [Cell(Chosen(), "lag", each, seed, 5.0) for seed, each in ((0, good()), (1, method), (2, good()))]
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        signal.setitimer(signal.ITIMER_VIRTUAL, SLOW)
        try:
            run_cells(cells, table, 1)
            rows = table.rows().sort("seed").to_dicts()
        except (Exception, SystemExit, GeneratorExit, Ends, BaseExceptionGroup) as error:
            return "", f"{'hang' if isinstance(error, TimeoutError) else 'ends the run'}: {type(error).__name__}"
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    if heard:
        return "", f"warning: {heard[0].category.__name__}"
    others = [{name: row[name] for name in expected[0]} for row in rows if row["method"] == "good" and row["seed"] != 1]
    if others != expected:
        return "", "rows of others"
    mine = [row for row in rows if row["seed"] == 1]
    if len(mine) != 1:
        return "", "no row"
    row = mine[0]
    begin = next((word for word in RIGHT if row["status"].startswith(word)), "")
    if not begin or "\x1b" in row["status"] or (begin == "ok") != (row["fit"] is not None):
        return "", f"a row that says nothing: {row['status'][:60]!r}, fit {row['fit']}"
    return begin, ""


def attack(chosen: Any) -> Tally:
    """Answers whose description has the part."""

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGVTALRM, late)
    rng, tally = np.random.default_rng(chosen.seed), Tally()
    cases = itertools.chain(part(alone(), chosen.scale, chosen.seed), (drawn(rng) for _ in range(chosen.size(SEVERAL))))
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        table = Table(Path(folder) / "alone.parquet")
        run_cells([Cell(Chosen(), "lag", good(), seed, 5.0) for seed in (0, 2)], table, 1)
        kept = [name for name in COLUMNS if name not in ("machine", "qpal")]
        expected = [{name: row[name] for name in kept} for row in table.rows().sort("seed").to_dicts()]
        for k, (name, method) in enumerate(case for case in cases if chosen.part in case[0]):
            place = Path(folder) / str(k)
            place.mkdir()
            begin, wrong = fault(method, place, expected)
            tally.case(begin or "bad", [(wrong.partition(":")[0], f"{name[:200]} -> {wrong}")] if wrong else [])
    return tally
