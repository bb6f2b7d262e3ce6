"""Calibration of joints of an MJCF from logs: the posterior of their values, and free runs before and after."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import norm

from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.diagnosis.residuals import ResidualTests
from sysid.diagnosis.worth import left_by_run
from sysid.estimation.noise_model import long_run_covariance_root
from sysid.solver.iterate import Options
from twin.calibrate.problem import noise_of
from twin.calibrate.search import USUAL as USUAL_SEARCH
from twin.calibrate.search import Optimum
from twin.mjcf.held import held_sentences
from twin.mjcf.logs import RobotLog
from twin.mjcf.motion import check
from twin.mjcf.parameters import USUAL, Parameter, parameters
from twin.mjcf.problem import Fit
from twin.mjcf.robot import Robot
from twin.mjcf.samples import sentences, without_spikes
from twin.mjcf.search import find_posterior, start_of
from twin.mjcf.simulation import Rig, free_run

LEVEL = 0.95
LACKING = 2.0  # times the noise of the readings: a larger error is the model's
LEAST_BITS = 1.0  # log2 of the prior's deviation by the posterior's: a value of which less is learned is not determined


@dataclass(frozen=True)
class Value:
    """A parameter: the model's value, the calibrated one with its interval and standard deviation [unit].

    `learned` [bit] is log2 of the prior's deviation by the posterior's; below 1 the value is not determined: it stays
    that of the model, and the interval is what the logs leave of what was plausible before. `continuous` is the value
    in a model of much shorter time steps: the one that a part has where the step of this model makes up for something.
    """

    name: str
    unit: str
    before: float
    value: float
    low: float
    high: float
    std: float
    learned: float
    determined: bool
    continuous: float

    def holds(self, truth: float) -> bool:
        """Whether the interval contains `truth`."""
        return self.low <= truth <= self.high


@dataclass(frozen=True)
class Run:
    """A log of one drive with the model's free runs (N,) before and after; `unit` is rad or m.

    `start` has the first reading, the speed then and the command before, from which both runs begin.
    """

    log: str
    drive: str
    unit: str
    held_out: bool
    Ts: float
    u: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    before: np.ndarray = field(repr=False)
    after: np.ndarray = field(repr=False)
    start: np.ndarray = field(repr=False)

    def rms(self, run: str) -> float:
        """RMS error [unit] of the free run "before" or "after"."""
        return float(np.sqrt(np.nanmean((self.y - getattr(self, run)) ** 2)))

    @property
    def left(self) -> float:
        """RMS error of the calibrated model in multiples of what noise and rounding of the readings make."""
        steps = np.diff(np.unique(self.y[np.isfinite(self.y)]))
        rounding = float(np.median(steps)) / np.sqrt(12.0) if len(steps) else 0.0
        return self.rms("after") / max(noise_of(self.y), rounding)

    def fit(self, run: str) -> float:
        """Fit [%] of the same."""
        return 100.0 * (1.0 - self.rms(run) / max(float(np.nanstd(self.y)), 1e-12))

    @cached_property
    def tests(self) -> ResidualTests | None:
        """Tests of what the calibrated model leaves."""
        return left_by_run(self.u, self.y, self.after)


@dataclass(frozen=True)
class RobotCalibration:
    """Calibrated joints: values, free runs, and how the search ended.

    The parameters of `rig` are those that are determined, with the `covariance` (P, P) [units]; `values` are those of
    all `parameters`. `remarks` say what of the logs was not used.
    """

    robot: Robot
    rig: Rig
    parameters: tuple[Parameter, ...]
    values: tuple[Value, ...]
    covariance: np.ndarray
    runs: tuple[Run, ...]
    optimum: Optimum
    noise: np.ndarray
    simulations: int
    remarks: tuple[str, ...] = ()

    @property
    def numbers(self) -> np.ndarray:
        """The determined values (P,) [units]."""
        return np.array([value.value for value in self.determined])

    @property
    def determined(self) -> tuple[Value, ...]:
        """The values that the logs tell."""
        return tuple(value for value in self.values if value.determined)

    @property
    def worse(self) -> tuple[Run, ...]:
        """Held-out runs that the calibration has made worse."""
        return tuple(run for run in self.runs if run.held_out and not run.rms("after") <= run.rms("before"))

    @property
    def lacking(self) -> Run | None:
        """The used run that shows most clearly that the robot does something else than the model; None without one."""
        used = [run for run in self.runs if not run.held_out]
        run = max(used, key=lambda run: run.left)
        return run if run.left > LACKING else None

    @property
    def usable(self) -> bool:
        """Whether the calibrated model may be used: something is determined, and no held-out run gets worse."""
        return bool(self.determined) and not self.worse

    def __getitem__(self, name: str) -> Value:
        return next(value for value in self.values if value.name == name)

    def as_dict(self) -> dict[str, Any]:
        """Values, scores and the search, ready for JSON."""
        return {
            "model": str(self.robot.path),
            "drives": [{"actuator": d.name, "joint": d.joint, "unit": d.unit} for d in self.robot.drives],
            "notes": [*self.robot.notes, *self.remarks],
            "converged": self.optimum.stop.converged,
            "reason": self.optimum.stop.reason,
            "usable": self.usable,
            "parameters": [asdict(value) for value in self.values],
            "covariance": self.covariance.tolist(),
            "residual": dict(zip([drive.name for drive in self.robot.drives], self.noise.tolist(), strict=True)),
            "scores": [
                {
                    "log": run.log,
                    "actuator": run.drive,
                    "held_out": run.held_out,
                    "unit": run.unit,
                    **{f"rms_{name}": run.rms(name) for name in ("before", "after")},
                    **{f"fit_{name}": run.fit(name) for name in ("before", "after")},
                }
                for run in self.runs
            ],
            "simulations": self.simulations,
        }


def calibrate(
    robot: Robot,
    logs: Sequence[RobotLog],
    held_out: Sequence[RobotLog] = (),
    names: Sequence[str] = USUAL,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
    seconds: float = np.inf,
) -> RobotCalibration:
    """Fit the parameters `names` (kinds, see `twin.mjcf.parameters`) of the robot's drives to `logs`, in free run.

    The estimate is the maximum of the posterior. Its covariance is H^-1 (S + P) H^-1 with H = J'J + P, the precision P
    of the priors, and the long-run covariance S of the scores J'e, so that residuals may be coloured. What the logs do
    not determine stays as the model has it, and the others are searched again beside that. After `seconds` the search
    ends with the best so far. Raises InputError for unknown kinds, for no log, and for a model that cannot be simulated
    from the logs.
    """
    say = progress or (lambda text: None)
    if not logs:
        raise InputError("there is no log to calibrate from; give at least one")
    every = parameters(robot, names)
    rig, rng = Rig(robot, every, threads), np.random.default_rng(seed)
    limits = replace(USUAL_SEARCH, max_seconds=seconds, deadline=Options(max_seconds=seconds).begun().deadline)
    with one_blas_thread():
        remarks = [text for log in (*logs, *held_out) for text in check(rig, log)]
        task, optimum, simulations = find_posterior(rig, logs, rng, limits, say)
        say("intervals")
        P, centre, (cov, finer) = len(every), optimum.p.copy(), _covariance(task, optimum.p)
        bits = np.log2(task.deviations / np.sqrt(np.diag(cov)))[:P]
        known = bits >= LEAST_BITS
        if not known.all():
            rig = replace(rig, parameters=tuple(each for each, told in zip(every, known, strict=True) if told))
            place = np.concatenate([centre[:P][known], centre[P:]])
            task, optimum, count = find_posterior(rig, task.logs, rng, limits, say, place)
            simulations += count
            centre[:P][known] = optimum.p[: len(rig.parameters)]
        values = tuple(map(_value, every, centre, np.sqrt(np.diag(cov)), finer, bits, known))
        say("free runs")
        sigma = task.residual_sizes(optimum.p)
        runs, seen = _runs(rig, optimum.p, task, held_out, sigma)
    slopes = np.array([each.free.slope(value.value) for each, value in zip(every, values, strict=True)])
    cov = (cov[:P, :P] * np.outer(slopes, slopes))[known][:, known]
    drives = [drive.name for drive in robot.drives]
    remarks += [
        text for log in seen for text in (*held_sentences(robot, log.name, log.posture), *sentences(log, drives))
    ]
    return RobotCalibration(robot, rig, every, values, cov, runs, optimum, sigma, simulations, tuple(remarks))


def _covariance(task: Fit, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (n, n) of the maximum of the posterior, in coordinates of the search.

    And its change (n,) where the model's time steps become infinitely short.
    """
    J, prior = task.fine_jacobian(p), np.diag(task.deviations**-2.0)
    residual = task.residual(p)
    assert residual is not None  # the search has simulated this point
    e = residual[: len(J)]
    lengths = [
        int(count) for r in task.records for count in np.isfinite(r.y.reshape(len(task.sigma), -1)).sum(axis=1) if count
    ]
    Q, R = np.linalg.qr(J)
    root = R.T @ long_run_covariance_root(e, Q, lengths, "auto")[0]
    inverse = np.linalg.inv(J.T @ J + prior)
    finer = inverse @ J.T @ task.by_step(p)
    cov = inverse @ (root @ root.T + task.lacking(p, e, J) + prior) @ inverse
    least = np.minimum(task.deviations / np.sqrt(np.diag(cov)), 1.0)  # without the log one knows the prior
    return cov * np.outer(least, least), finer


def _value(parameter: Parameter, z: float, spread: float, finer: float, bits: float, known: bool) -> Value:
    """A value at z, with an interval that is symmetric in the coordinate of the search, and so stays within the bounds.

    One that is not `known` is that of the model.
    """
    f, half = parameter.free, float(norm.ppf(0.5 + LEVEL / 2)) * spread
    low, value, high, continuous = (float(f.outer(each)) for each in (z - half, z, z + half, z + finer))
    std = float(spread * f.slope(value))
    value, continuous = (value, continuous) if known else (parameter.before, parameter.before)
    return Value(f.name, f.unit, parameter.before, value, low, high, std, float(bits), bool(known), continuous)


def _runs(
    rig: Rig, p: np.ndarray, task: Fit, held_out: Sequence[RobotLog], sigma: np.ndarray
) -> tuple[tuple[Run, ...], list[RobotLog]]:
    """Free runs of the model as it was and as it is calibrated, at p (n,), and the logs without what no joint does."""
    values, model = task.values(p)[: len(rig.parameters)], np.array([each.before for each in rig.parameters])
    starts = [*task.starts(p), *(start_of(rig, values, log, sigma) for log in held_out)]
    out, seen = [], []
    for k, (log, start) in enumerate(zip([*task.logs, *held_out], starts, strict=True)):
        before, after = (free_run(rig, point, log.u, log.Ts, start, log.posture) for point in (model, values))
        seen.append(without_spikes(log, after, log.noise) if k >= len(task.logs) else log)
        for j, drive in enumerate(rig.robot.drives):
            columns = (each[:, j] for each in (log.u, seen[k].y, before, after, start))
            out.append(Run(log.name, drive.name, drive.unit, k >= len(task.logs), log.Ts, *columns))
    return tuple(out), seen
