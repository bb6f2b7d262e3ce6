"""A log beside a robot's model as it is: where the two depart, and which kinds of parameters explain it.

Each kind alone is moved at all drives until the model fits the log best, then others beside the best one, while what is
left is more than noise. Shares refer to what noise does not explain.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.diagnosis.residuals import residual_tests
from twin.calibrate.problem import noise_of
from twin.calibrate.search import find_optimum
from twin.compare.verdict import CHANCE, MOST
from twin.follow import VISIBLE as VISIBLE_ANGLE
from twin.mjcf.calibration import LACKING, Run
from twin.mjcf.held import held_sentences
from twin.mjcf.logs import RobotLog
from twin.mjcf.motion import check
from twin.mjcf.parameters import KINDS, Parameter, parameters
from twin.mjcf.problem import Fit
from twin.mjcf.robot import Robot
from twin.mjcf.samples import sentences, without_spikes
from twin.mjcf.search import QUIETEST, check_course
from twin.mjcf.simulation import Rig

VISIBLE = {"rad": VISIBLE_ANGLE, "m": 1e-4}  # RMS: smaller differences of a joint matter to nobody
ODDS = 20.0  # of two causes: below these the log does not tell them apart
LAGS = 25
SUM = {"damping", "kv"}  # of which the sum alone acts on a joint
OFFSETS = np.array([-1.0, -0.5, -0.25, -0.1, 0.1, 0.25, 0.5, 1.0])  # tried first, in deviations of the prior


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


@dataclass(frozen=True)
class _Place:
    """An optimum: kinds, coordinates p (n,) of their values and the start, and the model's course (N, drives) there.

    `cost` is the mean square of the errors, in noises.
    """

    kinds: tuple[str, ...]
    rig: Rig
    p: np.ndarray
    values: np.ndarray
    start: np.ndarray
    y: np.ndarray
    cost: float

    @property
    def coordinates(self) -> dict[str, float]:
        """Of the values, by name."""
        return {each.free.name: float(z) for each, z in zip(self.rig.parameters, self.p, strict=False)}


class _Searches:
    """Searches on one log; costs are relative to `sigma` (drives,) [rad or m]."""

    def __init__(self, robot: Robot, log: RobotLog, sigma: np.ndarray, threads: int | None) -> None:
        self.robot, self.log, self.sigma, self.threads = robot, log, sigma, threads
        self.N, self.simulations = int(np.isfinite(log.y).sum()), 0

    def best(self, kinds: tuple[str, ...], near: _Place | None = None) -> _Place:
        """The optimum of the values of `kinds`, searched from `near`, or the model itself, and from places around it.

        The starts of the log are free throughout.
        """
        rig = Rig(self.robot, tuple(map(_own, parameters(self.robot, kinds))), self.threads)
        task, P = Fit(rig, [self.log], self.sigma), len(rig.parameters)
        p = task.start
        if near is not None:
            known = near.coordinates
            p[:P] = [known.get(each.free.name, z) for each, z in zip(rig.parameters, p[:P], strict=True)]
            p[P:] = near.p[len(known) :]
            fresh = [j for j, each in enumerate(rig.parameters) if each.free.name not in known]
            p = self._around(task, p, fresh)
        else:
            check_course(task, p)
        task = Fit(rig, [self.log], self.sigma, p)
        optimum = find_optimum(task, np.random.default_rng(0), draws=0)
        (y,), (start,) = task.readings(optimum.p), task.starts(optimum.p)
        self.simulations += task.simulations
        cost = float(np.nanmean(((self.log.y - y) / self.sigma) ** 2))
        return _Place(kinds, rig, optimum.p, task.values(optimum.p)[:P], start, y, cost)

    def _around(self, task: Fit, p: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """The best of p (n,), of points where one of the columns is far off, and of all that are better together."""
        points = [p]
        for j in columns:
            for offset in OFFSETS:
                points.append(p.copy())
                points[-1][j] += offset * task.deviations[j]
        trials = task.repair(np.array(points))
        losses = task.losses(trials)
        both = p.copy()
        for k, j in enumerate(columns):
            part = slice(1 + k * len(OFFSETS), 1 + (k + 1) * len(OFFSETS))
            best = int(np.argmin(losses[part]))
            if losses[part][best] < losses[0]:
                both[j] = trials[part][best, j]
        trials, losses = np.vstack([trials, both]), np.append(losses, task.losses(both[None]))
        self.simulations += len(trials)
        return np.asarray(trials[int(np.argmin(losses))])

    def score(self, place: _Place) -> float:
        """Schwarz's criterion."""
        return self.N * float(np.log(place.cost)) + len(place.values) * float(np.log(self.N))

    def better(self, base: _Place, best: _Place, count: int) -> bool:
        """Whether chance does not explain the better fit of the best of `count`, and anyone sees it."""
        limit = float(chi2.isf(CHANCE / count, len(best.values) - len(base.values)))
        before, after = (np.nanmean((self.log.y - each.y) ** 2, axis=0) for each in (base, best))
        visible = np.array([VISIBLE[drive.unit] for drive in self.robot.drives])
        return self.N * np.log(base.cost / best.cost) > limit and bool(np.any(before - after > visible**2))

    def alike(self, places: Sequence[_Place]) -> tuple[str, ...]:
        """The last kinds of places that the log cannot tell from the first one; coloured residuals count as less."""
        e = (self.log.y - places[0].y) / self.sigma
        e = e - np.nanmean(e)
        memory = float(np.clip(np.nanmean(e[1:] * e[:-1]) / max(float(np.nanmean(e**2)), 1e-300), 0.0, 0.99))
        N = self.N * (1.0 - memory) / (1.0 + memory)
        scores = [N * np.log(each.cost) + len(each.values) * np.log(self.N) for each in places]
        near = (score - scores[0] < 2.0 * np.log(ODDS) for score in scores[1:])
        return tuple(place.kinds[-1] for place, is_near in zip(places[1:], near, strict=True) if is_near)


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
        base = _Searches(robot, log, sigma, threads).best(())
        log = without_spikes(log, base.y, sigma)
        searches = _Searches(robot, log, noise_beside(log, base.y), threads)
        base = searches.best((), base)
        alone = []
        for kind in kinds_of(robot):
            say(f"{kind} alone")
            alone.append(searches.best((kind,), base))
        alone.sort(key=searches.score)
        noise = np.minimum(noise_beside(log, base.y), noise_beside(log, alone[0].y))
        chain = _chain(searches, base, alone, noise, say)
        chain = _without_superfluous(searches, base, chain)
    last = chain[-1][0] if chain else base
    least = min(float(np.mean((noise / searches.sigma) ** 2)), last.cost, *(each.cost for each in alone))

    def cause(place: _Place, alike: tuple[str, ...] = ()) -> Cause:
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


def kinds_of(robot: Robot) -> list[str]:
    """The kinds of parameters that all drives of the robot have."""
    out = []
    for kind in KINDS:
        try:
            parameters(robot, [kind])
        except InputError:
            continue
        out.append(kind)
    return out


def noise_beside(log: RobotLog, y: np.ndarray) -> np.ndarray:
    """Noise (drives,) of the readings; beside a course y (N, drives) of the model, of which fast motion is no noise."""
    return np.maximum(np.minimum(log.noise, [noise_of(column) for column in (log.y - y).T]), QUIETEST)


def _own(parameter: Parameter) -> Parameter:
    """A parameter whose search and prior begin at the model's own value."""
    free = parameter.free
    return replace(parameter, free=replace(free, start=float(np.clip(parameter.before, free.lower, free.upper))))


def _chain(
    searches: _Searches, base: _Place, alone: list[_Place], noise: np.ndarray, say: Callable[[str], None]
) -> list[tuple[_Place, tuple[str, ...]]]:
    """The best cause, then the best ones beside it, each with those that are alike."""
    chain, places = list[tuple[_Place, tuple[str, ...]]](), alone
    last = base
    while searches.better(last, places[0], len(places)):
        last = places[0]
        chain.append((last, searches.alike(places)))
        if len(chain) == MOST or all(_explains(searches.log, last.y, noise)):
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
    searches: _Searches, base: _Place, chain: list[tuple[_Place, tuple[str, ...]]]
) -> list[tuple[_Place, tuple[str, ...]]]:
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
