"""How the cases of an attack ended: the one shape in which every class of attacks counts."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, TypeVar

T = TypeVar("T")
KEPT = 5  # samples of each kind of fault


@dataclass
class Tally:
    """Cases by how they ended, and the bad among them by kind, with the first few samples of each kind."""

    cases: int = 0
    ended: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    samples: dict[str, list[str]] = field(default_factory=dict)
    bad: int = 0
    seconds: float = 0.0

    def case(self, end: str, bad: Iterable[tuple[str, str]] = ()) -> None:
        """One case that ended so; `bad` are kinds of fault, each with its sample."""
        faults = list(bad)
        self.cases += 1
        self.ended[end] += 1
        self.bad += bool(faults)
        for kind, sample in faults:
            self.kinds[kind] += 1
            kept = self.samples.setdefault(kind, [])
            if len(kept) < KEPT:
                kept.append(sample[:600])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        ended, kinds = (dict(sorted(counts.items())) for counts in (self.ended, self.kinds))
        counts = {"cases": self.cases, "bad": self.bad, "seconds": round(self.seconds, 1)}
        return {**counts, "ended": ended, "kinds": kinds, "samples": self.samples}


def part(cases: Iterable[T], scale: float, seed: int) -> Iterator[T]:
    """Of a list of cases each Nth, so that `scale` of them are left; the seed says which, so that seeds cover all."""
    every = max(1, round(1.0 / scale))
    return islice(cases, seed % every, None, every)
