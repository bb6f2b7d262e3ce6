"""A log beside a robot's model as it is: where the two depart, and which kinds of parameters explain it.

Each kind alone is moved at all drives until the model fits the log best, then others beside the best one, while what is
left is more than noise. Shares refer to what noise does not explain.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.base.parallel import one_blas_thread
from sysid.diagnosis.residuals import residual_tests
from twin.compare.verdict import MOST
from twin.mjcf.calibration import LACKING, Run
from twin.mjcf.held import held_sentences
from twin.mjcf.kinds import VISIBLE, Place, Searches, kinds_of, noise_beside
from twin.mjcf.logs import RobotLog
from twin.mjcf.motion import check
from twin.mjcf.parameters import KINDS
from twin.mjcf.robot import Robot
from twin.mjcf.samples import sentences, without_spikes
from twin.mjcf.search import QUIETEST
from twin.mjcf.simulation import Rig

LAGS = 25
BEGINNINGS = 3  # kinds from which a chain begins
SUM = {"damping", "kv"}  # of which the sum alone acts on a joint


@dataclass(frozen=True)
class Change:
    """A value [unit] of the model, and the one with which it fits the log best."""

    name: str
    unit: str
    before: float
    value: float


@dataclass(frozen=True)
class Cause:
    """Kinds that are moved together, the last one beside the others: the share of the departure that vanishes, 0 to 1.

    `left` (drives,) is the RMS [rad or m] of what is left. `alike` are kinds that this log cannot tell from the last
    one, and `changes` all values that were moved.
    """

    kinds: tuple[str, ...]
    share: float
    left: tuple[float, ...]
    changes: tuple[Change, ...]
    alike: tuple[str, ...] = ()


@dataclass(frozen=True)
class Departure:
    """What a drive's log departs from the model as it is, and from the model with the causes [rad or m].

    `rms` of all, `noise` of the readings, `beyond` and `left` beyond noise before and after; `share` of the squared
    departure of all drives, each relative to its noise. `white`: what is left is neither coloured nor more than
    LACKING times the noise.
    """

    drive: str
    unit: str
    rms: float
    noise: float
    beyond: float
    left: float
    share: float
    white: bool

    @property
    def explained(self) -> bool:
        """Whether what is left is noise, or less than anyone sees."""
        return self.white or self.left <= VISIBLE[self.unit]


@dataclass(frozen=True)
class RobotComparison:
    """A log beside its model: `alone` is each kind moved alone, best first; `chain` the best, then others beside it.

    The chain is the cause only where it explains the whole departure (`known`). `runs` have a log with the model as it
    is, and with the chain.
    """

    robot: Robot
    departures: tuple[Departure, ...]
    alone: tuple[Cause, ...]
    chain: tuple[Cause, ...]
    runs: tuple[Run, ...]
    simulations: int
    remarks: tuple[str, ...] = ()

    @property
    def known(self) -> bool:
        """Whether what the chain leaves is noise at every drive."""
        return all(each.explained for each in self.departures)

    @property
    def nothing(self) -> bool:
        """Whether there is no departure that matters."""
        return self.known and not self.chain

    @property
    def named(self) -> tuple[str, ...]:
        """The kinds that explain the departure; none where there is none, or where something else is its cause."""
        return self.chain[-1].kinds if self.chain and self.known else ()

    def as_dict(self) -> dict[str, Any]:
        """Departures, causes and values, ready for JSON."""
        return {
            "kind": "robot",
            "model": str(self.robot.path),
            "log": self.runs[0].log,
            "verdict": "nothing" if self.nothing else "known" if self.known else "lacking",
            "named": list(self.named),
            "departures": [asdict(each) for each in self.departures],
            "alone": [asdict(each) for each in self.alone],
            "chain": [asdict(each) for each in self.chain],
            "notes": [*self.robot.notes, *self.remarks],
            "simulations": self.simulations,
        }


def compare(
    robot: Robot,
    log: RobotLog,
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> RobotComparison:
    """What `log` departs from the robot's model as it is, and which kinds of parameters explain it.

    Raises InputError for a log over which the model cannot be simulated, and as `twin.mjcf.motion.check` does.
    """
    say = progress or (lambda text: None)
    with one_blas_thread():
        remarks = check(Rig(robot, (), threads), log)
        say("the model as it is")
        sigma = np.maximum(log.noise, QUIETEST)
        base = Searches(robot, log, sigma, threads).best(())
        log = without_spikes(log, base.y, sigma)
        searches = Searches(robot, log, noise_beside(log, base.y), threads)
        base = searches.best((), base)
        alone = []
        for kind in kinds_of(robot):
            say(f"{kind} alone")
            alone.append(searches.best((kind,), base))
        alone.sort(key=searches.score)
        noise = np.minimum(noise_beside(log, base.y), noise_beside(log, alone[0].y))
        chain = _first_that_explains(searches, base, alone, noise, say)
        chain = _without_superfluous(searches, base, chain)
    last = chain[-1][0] if chain else base
    least = min(float(np.mean((noise / searches.sigma) ** 2)), last.cost, *(each.cost for each in alone))

    def cause(place: Place, alike: tuple[str, ...] = ()) -> Cause:
        share = np.clip((base.cost - place.cost) / max(base.cost - least, 1e-300), 0.0, 1.0)
        left = np.sqrt(np.nanmean((log.y - place.y) ** 2, axis=0))
        pairs = zip(place.rig.parameters, place.values, strict=True)
        changes = tuple(Change(each.free.name, each.free.unit, each.before, float(v)) for each, v in pairs)
        return Cause(place.kinds, float(share), tuple(left.tolist()), changes, alike)

    drives = [drive.name for drive in robot.drives]
    remarks += [*held_sentences(robot, log.name, log.posture), *sentences(log, drives)]
    runs = tuple(
        Run(log.name, drive.name, drive.unit, False, log.Ts, *(each[:, k] for each in columns))
        for columns in [(log.u, log.y, base.y, last.y, last.start)]
        for k, drive in enumerate(robot.drives)
    )
    return RobotComparison(
        robot,
        _departures(log, runs, noise),
        tuple(map(cause, alone)),
        tuple(cause(*each) for each in chain),
        runs,
        searches.simulations,
        tuple(remarks),
    )


def _first_that_explains(
    searches: Searches, base: Place, alone: list[Place], noise: np.ndarray, say: Callable[[str], None]
) -> list[tuple[Place, tuple[str, ...]]]:
    """The chain from the best kind; where it does not explain the log, one from the next best that does.

    A kind may stand for two others, and bar the way to them: a lower gain for more damping and inertia.
    """
    first = _chain(searches, base, alone, noise, say)
    if not first or all(_explains(searches.log, first[-1][0].y, noise)):
        return first
    starts = [k for k, place in enumerate(alone) if place.kinds[0] not in SUM]
    starts += [k for k, place in enumerate(alone) if place.kinds[0] in SUM][:1]  # the better of the two
    for k in sorted(starts)[1:BEGINNINGS]:
        chain = _chain(searches, base, alone[k:], noise, say, 2)
        if chain and all(_explains(searches.log, chain[-1][0].y, noise)):
            return chain
    return first


def _chain(
    searches: Searches,
    base: Place,
    alone: list[Place],
    noise: np.ndarray,
    say: Callable[[str], None],
    most: int = MOST,
) -> list[tuple[Place, tuple[str, ...]]]:
    """The best cause, then the best ones beside it, each with those that are alike; at most `most`."""
    chain, places = list[tuple[Place, tuple[str, ...]]](), alone
    last = base
    while searches.better(last, places[0], len(places)):
        last = places[0]
        chain.append((last, searches.alike(places)))
        if len(chain) == most or all(_explains(searches.log, last.y, noise)):
            break
        say(f"beside {' and '.join(last.kinds)}")
        others = [kind for kind in kinds_of(searches.robot) if kind not in last.kinds]
        if SUM & set(last.kinds):
            others = [kind for kind in others if kind not in SUM]
        places = sorted((searches.best((*last.kinds, kind), last) for kind in others), key=searches.score)
        if not places:
            break
    return chain


def _without_superfluous(
    searches: Searches, base: Place, chain: list[tuple[Place, tuple[str, ...]]]
) -> list[tuple[Place, tuple[str, ...]]]:
    """The chain without kinds that a later one stands for: without them the others fit as well."""
    if len(chain) < 2:
        return chain
    full, dropped = chain[-1][0], False
    for kind in full.kinds[:-1]:
        rest = searches.best(tuple(each for each in full.kinds if each != kind), full)
        if not searches.better(rest, full, len(KINDS)):
            full, dropped = rest, True
    if not dropped:
        return chain
    parts = [searches.best(full.kinds[: k + 1], base) for k in range(len(full.kinds) - 1)]
    return [*((part, ()) for part in parts), (full, chain[-1][1])]


def _explains(log: RobotLog, y: np.ndarray, noise: np.ndarray) -> list[bool]:
    """For each drive whether what a course y (N, drives) leaves is white, and at most `LACKING` times the noise."""
    out = []
    for e, u, sigma in zip((log.y - y).T, log.u.T, noise, strict=True):
        seen = np.isfinite(e)
        quiet = np.sqrt(np.mean(e[seen] ** 2)) <= LACKING * sigma
        lags = min(LAGS, int(seen.sum()) // 4)
        out.append(bool(quiet and residual_tests(e[seen], u[seen], lags).white))
    return out


def _departures(log: RobotLog, runs: Sequence[Run], noise: np.ndarray) -> tuple[Departure, ...]:
    """The departure of each drive."""
    squares = np.array([np.nansum((run.y - run.before) ** 2) for run in runs]) / noise**2
    white = _explains(log, np.column_stack([run.after for run in runs]), noise)
    out = []
    for run, sigma, share, is_white in zip(runs, noise.tolist(), squares / squares.sum(), white, strict=True):
        beyond, left = (np.sqrt(max(run.rms(name) ** 2 - sigma**2, 0.0)) for name in ("before", "after"))
        sizes = run.rms("before"), sigma, float(beyond), float(left)
        out.append(Departure(run.drive, run.unit, *sizes, float(share), is_white))
    return tuple(out)
