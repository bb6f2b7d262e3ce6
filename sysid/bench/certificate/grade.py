"""Digits of a method on the dynamic reference records, and the rules that ours must keep."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.bench.border import answer, name_of
from sysid.bench.certificate.digits import digits, fewest
from sysid.bench.certificate.record import STARTS, Record
from sysid.bench.certificate.static import StaticGrade
from sysid.bench.method import Method

# Of parameters on a set or record of lower difficulty, by our search to the last digit. Doubles tell two sums of
# squares apart when they differ by 1e-16 of themselves, which is 1e-8 sqrt(N) of a standard deviation: about 8 digits
# of a value. One is lost to the condition of the Jacobian (below 10 there), and one is left for other processors.
LEAST = 6.0
SECONDS = 5.0  # of a fit, as in the benchmark's table; the records have 60 to 200 samples


@dataclass(frozen=True)
class Grade:
    """Digits of a method on one record from one start: the worst parameter, the worst standard deviation, and rss.

    None where the method does not tell them; rss is that of its free run. `status` is "ok" or says why there is none.
    """

    record: str
    level: str
    start: int
    method: str
    parameters: float | None
    deviations: float | None
    rss: float
    seconds: float
    status: str


def grade(method: Method, record: Record, start: int) -> Grade:
    """A method on one record; whatever it does, it gets a row."""
    outcome = answer(method, record.task(start), {"estimation": (record.data.u[:, 0], np.empty(0))}, SECONDS, 0)
    row = Grade(record.name, record.level, start, name_of(method), 0.0, 0.0, 0.0, outcome.seconds, outcome.status)
    if outcome.status != "ok":
        return row
    values, spread = (outcome.details.get(key) for key in ("values", "deviations"))
    with np.errstate(over="ignore", invalid="ignore"):  # a free run may diverge
        rss = float(np.sum((record.data.y[:, 0] - outcome.runs["estimation"]) ** 2))
    return replace(
        row,
        parameters=None if values is None else _digits(values, record.parameters),
        deviations=None if spread is None else _digits(spread, record.deviations),
        rss=digits(rss, record.rss),
    )


def _digits(values: Mapping[str, float], references: Mapping[str, float]) -> float:
    """Of the worst parameter; one that a method does not tell has none."""
    return fewest((values.get(name, np.nan) for name in references), references.values())


def grades(
    methods: Sequence[Method], table: Iterable[Record], step: Callable[[str], None] = lambda text: None
) -> list[Grade]:
    """Every method on every record from both starts."""
    rows = []
    for record in table:
        for method in methods:
            rows += [grade(method, record, start) for start in STARTS]
        step(record.name)
    return rows


def violations(rows: Sequence[Grade], static: Sequence[StaticGrade], method: str) -> list[str]:
    """Sentences where the method of that name, or the solver on a static set, has fewer than `LEAST` digits.

    Only sets and records of lower difficulty are judged.
    """
    own = [row for row in rows if row.method == method and row.level == "lower"]
    cases = [(row.record, row.start, row.parameters or 0.0, row.status) for row in own]
    cases += [(s.name, s.start, s.parameters, s.stop) for s in static if s.level == "lower"]
    return [
        f"{name}, start {start}: {has:.1f} digits, fewer than {LEAST:g} ({reason})."
        for name, start, has, reason in cases
        if has < LEAST
    ]
