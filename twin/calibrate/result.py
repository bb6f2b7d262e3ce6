"""What a calibration found: values with intervals, scores, free runs, and the next step."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sysid.base.errors import unknown
from sysid.diagnosis.residuals import ResidualTests
from sysid.diagnosis.worth import left_by_run
from twin.calibrate import discrepancy
from twin.calibrate.agreement import Agreement
from twin.calibrate.identifiability import Identifiability
from twin.calibrate.search import Optimum
from twin.parameters import Parameters

LEVEL = 0.95


@dataclass(frozen=True)
class Value:
    """A calibrated row: nominal and starting value, the value found and its interval [unit], its standard deviation
    from noise alone and in all, in coordinates of the search, and its scale."""

    name: str
    unit: str
    nominal: float
    start: float
    value: float
    low: float
    high: float
    noise_share: float

    def holds(self, truth: float) -> bool:
        """Whether the interval contains `truth`."""
        return self.low <= truth <= self.high


@dataclass(frozen=True)
class Score:
    """Free run over one log: RMS error [rad] and fit [%] of the uncalibrated and of the calibrated twin.

    `inside`: the share of the samples within the band; None for a log that was used.
    """

    log: str
    held_out: bool
    rms_before: float
    rms_after: float
    fit_before: float
    fit_after: float
    inside: float | None = None


@dataclass(frozen=True)
class Run:
    """A log with both free runs: u, y, before and after (N,); `half` (N,) is the half width of the band of `after`."""

    name: str
    held_out: bool
    Ts: float
    u: np.ndarray
    y: np.ndarray
    before: np.ndarray
    after: np.ndarray
    half: np.ndarray | None = None

    @cached_property
    def tests(self) -> ResidualTests | None:
        """Tests of what the calibrated twin leaves."""
        return left_by_run(self.u, self.y, self.after)


@dataclass(frozen=True)
class Calibration:
    """A joint of the twin, calibrated: `parameters` is the whole twin with `values` in it; `seconds` was the budget.

    `moved` are rows that are not calibrated and differ from what was given: ends, out of the way of the logs.
    `agreements`: whether the logs agree, for each value that they share; `by_run`: the values of those that they do not
    share, log by log, of which `parameters` has the mean over the logs that agree, `typical`.
    """

    joint: str
    parameters: Parameters
    values: tuple[Value, ...]
    correlation: np.ndarray
    told: tuple[Identifiability, ...]
    fixed: Mapping[str, str]
    found: Optimum
    converged: bool
    reason: str
    sizes: discrepancy.Sizes
    scores: tuple[Score, ...]
    runs: tuple[Run, ...] = field(repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    level: float = LEVEL
    seconds: float = np.inf
    moved: tuple[str, ...] = ()
    agreements: tuple[Agreement, ...] = ()
    by_run: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    typical: Mapping[str, list[int]] = field(default_factory=dict)

    def of_log(self, k: int) -> Parameters:
        """The twin in log number k, with what is this log's own but the zero of its sensor."""
        return self.parameters.replace({row: self.by_run[row][k].value for row in self.typical})

    @property
    def differing(self) -> list[Agreement]:
        """The values in which the logs differ, the one that explains it best first."""
        return sorted((row for row in self.agreements if row.differ), key=lambda row: (row.behind, -row.squares))

    def as_dict(self) -> dict[str, Any]:
        """Values, scores and provenance, ready for JSON."""
        return {
            "joint": self.joint,
            "converged": self.converged,
            "reason": self.reason,
            "next_step": self.next_step(),
            "level": self.level,
            "parameters": [asdict(value) for value in self.values],
            "correlation": self.correlation.tolist(),
            "agreement": [asdict(row) for row in self.agreements],
            "by_run": {row: [asdict(value) for value in values] for row, values in self.by_run.items()},
            "not_calibrated": dict(self.fixed),
            "moved": list(self.moved),
            "told": [asdict(row) for row in self.told],
            "scores": [asdict(score) for score in self.scores],
            "search": {
                "iterations": self.found.stop.iterations,
                "descents": self.found.descents,
                "agreed": self.found.agreed,
                "rms": [float(np.sqrt(row["loss"])) for row in self.found.history],
            },
            "departures": {"noise": self.sizes.noise, **dict(zip(discrepancy.GROUPS, self.sizes.groups, strict=True))},
            **self.provenance,
        }

    def next_step(self) -> str:
        """What to do about a search that did not converge; empty if it did."""
        if self.found.late:
            return f"Run it again with --seconds {2.0 * self.seconds:g}, or without --seconds, for all of the search."
        if self.converged:
            return ""
        return (
            "Look at the overlay in the report: if the twin moves another way than the leg, check sign and gear of the "
            "log; otherwise free fewer parameters (--fix), or record both end stops and several levels."
        )

    def __getitem__(self, name: str) -> Value:
        for value in self.values:
            if name in (value.name, value.name.rpartition(".")[2]):
                return value
        raise unknown("calibrated parameter", name, [value.name for value in self.values])
