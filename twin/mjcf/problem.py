"""Least squares over logs of a robot, under the priors of its parameters, each log relative to its noise."""

import copy
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.calibrate.discrepancy import by_size, estimate
from twin.calibrate.problem import Free, Record, Simulations
from twin.mjcf.logs import RobotLog
from twin.mjcf.simulation import Rig

FINE = 0.1  # of the steps of the search: errors of differences fall with its square
SHORT = 500  # samples of a joint; the functions of what a model lacks are up to 170
WIDE = 10.0  # of the scale: how far the start of a log may be, while starts of a search are drawn within the scale
STARTS = (("first reading", ""), ("first speed", "/s"), ("command before the log", ""))  # rows of a start, with units


class Fit(Simulations):
    """The penalised least squares: residuals in standard deviations `sigma` (drives,), then one row a prior.

    Free are the rig's parameters, unless their values (P,) are `known`, and the start of each log.

    Trees of bodies that nothing connects do not move each other, so one simulation steps a parameter in each of them at
    once (Curtis, Powell and Reid 1974, J. Inst. Maths Applics 13).
    """

    def __init__(
        self,
        rig: Rig,
        logs: Sequence[RobotLog],
        sigma: np.ndarray,
        start: np.ndarray | None = None,
        known: np.ndarray | None = None,
    ) -> None:
        self.rig, self.logs, self.sigma = rig, logs, sigma
        self.parameters = rig.parameters if known is None else ()
        records = [_record(rig, log, sigma, known) for log in logs]
        super().__init__([parameter.free for parameter in self.parameters], records, noise=1.0)
        own = len(self.free) - len(self.shared)
        self.deviations = np.array([*(p.deviation for p in self.parameters), *[WIDE] * own])
        self.centre, self._first = super().start, start
        self._trees = self._columns_by_tree()

    @property
    def start(self) -> np.ndarray:
        """Coordinates of the start (n,)."""
        return self.centre.copy() if self._first is None else self._first.copy()

    @property
    def size(self) -> float:
        """y'y with the rows of the priors; never 0."""
        return super().size + float(np.sum((self.centre / self.deviations) ** 2))

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """y - yhat of the scored samples (N,), then what is missing to the centre of each prior (n,)."""
        e = super().residual(p)
        return None if e is None else np.append(e, (self.centre - p) / self.deviations)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residual (N + n,), and dyhat/dp with the rows of the priors (N + n, n)."""
        e, J = super().linearise(p)
        return e, np.vstack([J, np.diag(1.0 / self.deviations)])

    def losses(self, points: np.ndarray) -> np.ndarray:
        """Sum of squares (m,), the priors among them."""
        return super().losses(points) + np.sum(((points - self.centre) / self.deviations) ** 2, axis=1)

    def fine_jacobian(self, p: np.ndarray) -> np.ndarray:
        """dyhat/dp (N, n) at p (n,) of second order, from steps a tenth of the search's; no rows of priors.

        Two parameters that act alike have equal columns then. Columns of first order, as at a bound, may differ by
        more than the noise, and would seem to tell them apart.
        """
        base, columns, steps = self.responses_at(p), range(len(p)), FINE * self.steps
        inside = (p - self.low >= steps) & (self.high - p >= steps)
        steps = np.where(~inside & (p - self.low > self.high - p), -steps, steps)
        first = self._changes(p, base, columns, steps)
        second = self._changes(p, base, columns, np.where(inside, -steps, 2.0 * steps))
        return np.asarray((np.where(inside, 1.0, 4.0) * first - second) / (2.0 * steps))

    def starts(self, p: np.ndarray) -> np.ndarray:
        """The starts (logs, 3, drives) at p (n,)."""
        return self.values(p)[len(self.shared) :].reshape(len(self.logs), len(STARTS), -1)

    def readings(self, p: np.ndarray) -> list[np.ndarray]:
        """Simulated readings (N, drives) [rad or m] of each log at p (n,)."""
        return [self.sigma * y.reshape(len(self.sigma), -1).T for y in self.responses_at(p)]

    def residual_sizes(self, p: np.ndarray, logs: Sequence[RobotLog] | None = None) -> np.ndarray:
        """RMS residual (drives,) [rad or m] at p (n,), over all logs, or over `logs` with fewer readings."""
        pairs = zip(self.logs if logs is None else logs, self.readings(p), strict=True)
        return np.asarray(np.sqrt(np.nanmean(np.concatenate([(log.y - y) ** 2 for log, y in pairs]), axis=0)))

    def by_step(self, p: np.ndarray) -> np.ndarray:
        """What the model's time step makes of the scored responses (N,) at p (n,): an error of first order in it."""
        model = copy.copy(self.rig.robot.model)
        model.opt.timestep /= 2.0
        finer = replace(self.rig, robot=replace(self.rig.robot, model=model))
        pairs = zip(self.responses_at(p), Fit(finer, self.logs, self.sigma).responses_at(p), self.records, strict=True)
        changes = [2.0 * (own - half)[record.scored] for own, half, record in pairs]
        return np.nan_to_num(np.concatenate(changes))

    def lacking(self, p: np.ndarray, e: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Covariance (n, n) of J'e by what the model lacks: random functions of each joint's place and speed.

        Their sizes come from the residual e (N,) of each joint, see `twin.calibrate.discrepancy`. A joint of few
        samples, or one that rests, cannot tell them.
        """
        readings, total = self.readings(p), np.zeros((J.shape[1],) * 2)
        drive = np.concatenate([np.repeat(np.arange(len(self.sigma)), len(log.y)) for log in self.logs])
        scored = np.concatenate([record.scored for record in self.records])
        for k, sigma in enumerate(self.sigma):
            rows = drive[scored] == k
            responses = [y[:, k] / sigma for y in readings]
            if rows.sum() < SHORT or max(map(np.ptp, responses)) < 1.0:  # [standard deviations]
                continue
            groups, size = estimate(e[rows], J[rows], responses, [log.Ts for log in self.logs], scored[drive == k])
            Phi = J[rows].T @ by_size(groups, size)
            total += Phi @ Phi.T
        return total

    def _columns_by_tree(self) -> np.ndarray:
        """The tree (n,) that each parameter moves; -1 for all of them."""
        drives = self.rig.robot.drives
        if self.rig.robot.coupled:
            return np.full(len(self.free), -1)
        places = [parameter.drive for parameter in self.parameters]
        places += [*range(len(drives))] * len(STARTS) * len(self.logs)
        return np.array([-1 if place is None else drives[place].tree for place in places])

    def _changes(self, p: np.ndarray, base: list[np.ndarray], columns: Sequence[int], steps: np.ndarray) -> np.ndarray:
        """Changes (N, columns) of the scored responses, with one simulation for columns of different trees."""
        trees = np.array([drive.tree for drive in self.rig.robot.drives])
        out = []
        for k, record in enumerate(self.records):
            acts = [i for i, j in enumerate(columns) if j < len(self.shared) or j in self.own[k]]
            change = np.zeros((len(record.y), len(columns)))
            seen: dict[int, int] = {}
            runs = np.zeros(len(columns), dtype=int)  # the simulation of each column
            for i in acts:
                tree = int(self._trees[columns[i]])
                runs[i] = seen.get(tree, 0)
                seen[tree] = int(runs[i]) + 1
            alone = seen.pop(-1, 0)
            points = np.repeat(p[None], alone + max(seen.values(), default=0), axis=0)
            for i in acts:
                runs[i] += alone if self._trees[columns[i]] >= 0 else 0
                points[runs[i], columns[i]] += steps[i]
            difference = self._respond(k, points) - base[k] if acts else np.zeros((0, len(record.y)))
            for i in acts:
                tree = self._trees[columns[i]]
                moved = np.repeat((trees == tree) | (tree < 0), len(record.y) // len(trees))
                change[moved, i] = difference[runs[i], moved]
            out.append(change[record.scored])
        return np.concatenate(out)


def _record(rig: Rig, log: RobotLog, sigma: np.ndarray, known: np.ndarray | None) -> Record:
    """The log as one series, drive after drive, in standard deviations; its own parameters are its start."""
    P = 0 if known is not None else len(rig.parameters)
    own = tuple(
        Free(f"{name} of {drive.name}", float(value), -np.inf, np.inf, drive.unit + per, float(doubt) / WIDE)
        for (name, per), values, doubts in zip(STARTS, log.start, log.doubt, strict=True)
        for drive, value, doubt in zip(rig.robot.drives, values, doubts, strict=True)
    )

    def respond(values: np.ndarray) -> np.ndarray:
        parameters = values[:, :P] if known is None else np.tile(known, (len(values), 1))
        start = values[:, P:].reshape(len(values), len(STARTS), -1)
        y = rig.run(parameters, log.u, log.Ts, start, log.posture) / sigma
        return y.transpose(0, 2, 1).reshape(len(values), -1)

    return Record(log.name, (log.y / sigma).T.ravel(), log.Ts, respond, own)
