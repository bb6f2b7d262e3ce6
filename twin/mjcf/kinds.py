"""Optima of a model on one log with some kinds of parameters free, and which of them fits best beyond chance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError
from twin.calibrate.problem import noise_of
from twin.calibrate.search import find_optimum
from twin.compare.evidence import beyond_chance, independent_samples, schwarz
from twin.follow import VISIBLE as VISIBLE_ANGLE
from twin.mjcf.logs import RobotLog
from twin.mjcf.parameters import KINDS, Parameter, parameters
from twin.mjcf.problem import Fit
from twin.mjcf.robot import Robot
from twin.mjcf.search import QUIETEST, check_course
from twin.mjcf.simulation import Rig

VISIBLE = {"rad": VISIBLE_ANGLE, "m": 1e-4}  # RMS: smaller differences of a joint matter to nobody
ODDS = 20.0  # of two causes: below these the log does not tell them apart
OFFSETS = np.array([-1.0, -0.5, -0.25, -0.1, 0.1, 0.25, 0.5, 1.0])  # tried first, in deviations of the prior


@dataclass(frozen=True)
class Place:
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


class Searches:
    """Searches on one log; costs are relative to `sigma` (drives,) [rad or m]."""

    def __init__(self, robot: Robot, log: RobotLog, sigma: np.ndarray, threads: int | None) -> None:
        self.robot, self.log, self.sigma, self.threads = robot, log, sigma, threads
        self.N, self.simulations = int(np.isfinite(log.y).sum()), 0

    def best(self, kinds: tuple[str, ...], near: Place | None = None) -> Place:
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
        return Place(kinds, rig, optimum.p, task.values(optimum.p)[:P], start, y, cost)

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

    def score(self, place: Place) -> float:
        """Schwarz's criterion."""
        return schwarz(place.cost, len(place.values), self.N)

    def better(self, base: Place, best: Place, count: int) -> bool:
        """Whether chance does not explain the better fit of the best of `count`, and anyone sees it."""
        more = len(best.values) - len(base.values)
        before, after = (np.nanmean((self.log.y - each.y) ** 2, axis=0) for each in (base, best))
        visible = np.array([VISIBLE[drive.unit] for drive in self.robot.drives])
        seen = bool(np.any(before - after > visible**2))
        return seen and beyond_chance(base.cost, best.cost, more, count, self.N)

    def alike(self, places: Sequence[Place]) -> tuple[str, ...]:
        """The last kinds of places that the log cannot tell from the first one; coloured residuals count as less."""
        N = independent_samples((self.log.y - places[0].y) / self.sigma, self.N)
        scores = [N * np.log(each.cost) + len(each.values) * np.log(self.N) for each in places]
        near = (score - scores[0] < 2.0 * np.log(ODDS) for score in scores[1:])
        return tuple(place.kinds[-1] for place, is_near in zip(places[1:], near, strict=True) if is_near)


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
