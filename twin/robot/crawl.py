"""The whole robot stands and crawls, also with friction and masses that differ from those of the plan."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy import stats

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import versions
from twin.parameters import JOINTS, TABLE, Parameters
from twin.plant.leg import LEGS, robot
from twin.robot.gait import Gait, Plan, plan
from twin.robot.statics import stability_margin
from twin.robot.walk import Walk, drive, feedforward_references

CYCLE = 17.7  # [s] of the usual gait
SPREAD = 0.2  # largest relative difference of a drawn robot's friction and masses from nominal
DRAWN = ("coulomb", "viscous", "load_friction", "stribeck", "mass")  # suffixes of the names of drawn parameters
FALLEN = np.deg2rad(15.0)  # [rad] of tilt
LEAST_WAY = 0.8  # share of the planned distance that counts as success


@dataclass(frozen=True)
class Standing:
    """A robot that only stands for `seconds`: sink [m] and tilt [rad] of its torso, with active servos and without
    voltage; `power` [W] that the servos take."""

    seconds: float
    sink: float
    tilt: float
    power: float
    sink_unpowered: float
    tilt_unpowered: float


@dataclass(frozen=True)
class Measures:
    """A crawl in numbers.

    distance forward and sideways [m], turn [rad], seconds, the smallest margin of stability [m] over the feet that
    stand in the plan, the largest tilt [rad], lowest and highest torso [m], RMS of angle minus planned angle (12,)
    [rad], the largest slip [m] of a standing foot before it is lifted, the lowest peak [m] of a swinging foot over the
    floor, mean and peak electrical power [W], largest motor voltage [V], and cost of transport, power / (weight
    speed).
    """

    forward: float
    sideways: float
    turn: float
    seconds: float
    margin: float
    tilt: float
    height: tuple[float, float]
    tracking: tuple[float, ...]
    slip: float
    clearance: float
    power: float
    peak_power: float
    peak_voltage: float
    transport: float

    @property
    def speed(self) -> float:
        """Mean speed [m/s]."""
        return self.forward / self.seconds


@dataclass(frozen=True)
class Trial:
    """One drawn robot: its parameters that differ, its crawl, and the failure ("" if none)."""

    changes: Mapping[str, float]
    measures: Measures
    fault: str


@dataclass(frozen=True)
class Crawl:
    """The results of `qpal crawl`: plan, the nominal robot's walk, its measures and standing, and the drawn robots."""

    plan: Plan
    walk: Walk
    measures: Measures
    fault: str
    standing: Standing
    trials: tuple[Trial, ...]
    seed: int

    @property
    def holds(self) -> bool:
        """Whether the nominal robot walked; drawn robots may fail."""
        return not self.fault

    @property
    def successes(self) -> int:
        """Number of drawn robots that walked."""
        return sum(not trial.fault for trial in self.trials)

    @property
    def rate(self) -> tuple[float, float]:
        """95 % interval of the share of such robots that walk (Clopper and Pearson 1934, Biometrika 26, 404-413)."""
        n, k = len(self.trials), self.successes
        low = 0.0 if k == 0 else float(stats.beta.ppf(0.025, k, n - k + 1))
        return low, 1.0 if k == n else float(stats.beta.ppf(0.975, k + 1, n - k))

    def as_dict(self) -> dict[str, Any]:
        """The summary, ready for JSON; angles in radians, everything in SI."""
        names = [f"{joint}_{leg}" for leg in LEGS for joint in JOINTS]
        measures = vars(self.measures) | {"tracking": dict(zip(names, self.measures.tracking, strict=True))}
        return {
            "holds": self.holds,
            "fault": self.fault,
            "gait": vars(self.plan.gait),
            "planned": {"forward": self.plan.advance, "margin": float(self.plan.margin.min())},
            "crawl": measures | {"speed": self.measures.speed},
            "standing": vars(self.standing),
            "robots": {
                "number": len(self.trials),
                "successes": self.successes,
                "rate_interval": list(self.rate) if self.trials else None,
                "spread": SPREAD,
                "trials": [
                    {
                        "forward": t.measures.forward,
                        "margin": t.measures.margin,
                        "tilt": t.measures.tilt,
                        "fault": t.fault,
                    }
                    | {"changes": dict(t.changes)}
                    for t in self.trials
                ],
            },
            "parameters_changed": self.walk.parameters.changed(),
            "seed": self.seed,
            "versions": versions(),
        }


class _Silent:
    def __call__(self, name: str) -> None: ...
    def part(self, share: float, name: str) -> None: ...


@checked(deferred=("draws", "standing"))
def run(
    gait: Gait | None = None,
    parameters: Parameters | None = None,
    standing: float = 30.0,
    draws: int = 12,
    seed: int = 1,
    threads: int = 1,
    steps: Callable[..., Any] | None = None,
) -> Crawl:
    """Crawl with `gait`, stand for `standing` [s] with and without power, and let `draws` other robots crawl.

    All robots follow references that were planned for `parameters`. `seed` draws the other robots and the noise of
    every potentiometer. `steps` receives the progress. Raises InputError for a crawl that cannot be planned.
    """
    gait, parameters, steps = gait or Gait(), parameters or Parameters(), steps or _Silent()
    if not 1.0 <= standing <= 3600.0:
        raise InputError(f"standing takes {standing} s; give 1 to 3600 s")
    if not 0 <= draws <= 1000:
        raise InputError(f"the number of other robots is {draws}; give 0 to 1000")
    if gait.cycles < 1:
        raise InputError("the crawl has no cycle; give at least one")
    steps("crawl of the robot itself")
    target = plan(gait, parameters)
    references = feedforward_references(target, parameters)
    (walk,) = drive([parameters], references, target.Ts, target.torso[0], [seed], progress=_part(steps, "crawl"))
    measures = measure(target, walk)
    steps("standing, with power and without")
    stand_result = stand(gait, parameters, standing, seed, progress=_part(steps, "standing"))
    steps("robots of other friction and mass")
    changes = [draw(parameters, rng) for rng in np.random.default_rng(seed).spawn(draws)]
    trials: list[Trial] = []
    if draws:
        robots = [parameters.replace(change) for change in changes]
        seeds = [seed + 1 + k for k in range(draws)]
        progress = _part(steps, f"{draws} robots")
        walks = drive(robots, references, target.Ts, target.torso[0], seeds, threads=threads, progress=progress)
        for change, motion in zip(changes, walks, strict=True):
            trial_measures = measure(target, motion)
            trials.append(Trial(change, trial_measures, fault(target, trial_measures)))
    return Crawl(target, walk, measures, fault(target, measures), stand_result, tuple(trials), seed)


def shares(cycles: int, standing: float, draws: int) -> tuple[float, ...]:
    """Of the steps of `run`: about as many seconds as each simulates of one robot in the usual gait."""
    return CYCLE * cycles, 2.0 * standing, CYCLE * cycles * draws


@checked(late=True)
def cycles(steps: int) -> int:
    """Cycles of a crawl of `steps`. Raises InputError for a number that is not a multiple of the legs."""
    if steps < len(LEGS) or steps % len(LEGS):
        raise InputError(
            f"{steps} steps are not a whole number of cycles; give a multiple of {len(LEGS)}, one step a leg"
        )
    return steps // len(LEGS)


def _part(steps: Any, name: str) -> Callable[[float], None]:
    return lambda share: steps.part(share, name)


@checked
def draw(parameters: Parameters, rng: np.random.Generator) -> dict[str, float]:
    """Friction and masses drawn uniformly within SPREAD of those of `parameters`."""
    rows = [row for row in TABLE if row.name.endswith(DRAWN)]
    factors = rng.uniform(1 - SPREAD, 1 + SPREAD, len(rows))
    return {
        row.name: float(np.clip(factor * parameters[row.name], row.lower, row.upper))
        for row, factor in zip(rows, factors, strict=True)
    }


@checked(late=True)
def stand(
    gait: Gait,
    parameters: Parameters,
    seconds: float,
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Standing:
    """The stance in which a crawl starts, held for `seconds` [s] by the servos, and then without any voltage.

    `progress` receives the completed share, 0 to 1.
    """
    stance = plan(Gait(**(vars(gait) | {"cycles": 0})), parameters)
    references = np.repeat(stance.angles[:1], round(seconds / gait.Ts), axis=0)
    halves = (lambda share: progress(share / 2.0), lambda share: progress((1.0 + share) / 2.0))
    powered_walk, unpowered_walk = (
        drive([parameters], references, gait.Ts, stance.torso[0], [seed], power=power, progress=half)[0]
        for power, half in zip((True, False), halves, strict=True)
    )
    return Standing(
        seconds,
        _sink(powered_walk),
        float(powered_walk.tilt.max()),
        float(powered_walk.electrical_power.sum(1).mean()),
        _sink(unpowered_walk),
        float(unpowered_walk.tilt.max()),
    )


def _sink(walk: Walk) -> float:
    """Largest sink [m] of the torso below its first height."""
    return float(walk.torso[0, 2] - walk.torso[:, 2].min())


def measure(target: Plan, walk: Walk) -> Measures:
    """The measures of a walk that followed `target`."""
    feet, turns, centre = walk.places
    way, seconds = walk.torso[-1] - walk.torso[0], len(walk.qpos) * walk.Ts
    power = walk.electrical_power.sum(axis=1)
    weight = float(mujoco.mj_getTotalmass(robot(walk.parameters))) * walk.parameters["gravity"]
    mean = float(power.mean())
    return Measures(
        forward=float(way[0]),
        sideways=float(way[1]),
        turn=float(walk.heading[-1] - walk.heading[0]),
        seconds=seconds,
        margin=float(margins(target, feet, centre).min()),
        tilt=float(walk.tilt.max()),
        height=(float(walk.torso[:, 2].min()), float(walk.torso[:, 2].max())),
        tracking=tuple(np.sqrt(np.mean((walk.angles - target.angles) ** 2, axis=0)).tolist()),
        slip=_slip(target, feet, turns),
        clearance=_clearance(target, feet),
        power=mean,
        peak_power=float(power.max()),
        peak_voltage=float(np.abs(walk.volts).max()),
        transport=mean / (weight * max(abs(float(way[0])) / seconds, 1e-9)),
    )


def margins(target: Plan, feet: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Margin of stability (N,) [m] over the feet (N, 4, 3) that stand in the plan."""
    rows = zip(centre, feet, target.stance, strict=True)
    return np.array([stability_margin(c[:2], f[stance, :2]) for c, f, stance in rows])


def _phases(state: np.ndarray) -> list[tuple[int, int]]:
    """Intervals in which a foot's state (N,) is true: first sample and sample after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], state, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _slip(target: Plan, feet: np.ndarray, turns: np.ndarray) -> float:
    """Largest slip [m] of a foot's contact while it stands in the plan. The foot is a ball: its centre may move without
    slip as it rolls, v = w x r."""
    radius = float(target.feet[0, 0, 2])
    spin = turns[1:] @ np.swapaxes(turns[:-1], -1, -2)  # (N-1, 4, 3, 3), turns so small that their sine is the angle
    roll = radius * np.stack([spin[..., 0, 2] - spin[..., 2, 0], spin[..., 1, 2] - spin[..., 2, 1]], axis=-1) / 2
    slip_path = np.concatenate([np.zeros((1, 4, 2)), np.diff(feet[..., :2], axis=0) - roll]).cumsum(axis=0)
    ways = [
        np.linalg.norm(slip_path[start:stop, k] - slip_path[start, k], axis=-1).max()
        for k in range(4)
        for start, stop in _phases(target.stance[:, k])
    ]
    return float(max(ways))


def _clearance(target: Plan, feet: np.ndarray) -> float:
    """Lowest peak [m] over the floor of a foot in swing."""
    radius = float(target.feet[0, 0, 2])
    peaks = [feet[a:b, k, 2].max() for k in range(4) for a, b in _phases(~target.stance[:, k])]
    return float(min(peaks) - radius)


def fault(target: Plan, measures: Measures) -> str:
    """Why a walk failed, in words; "" if it did not."""
    faults: Sequence[tuple[bool, str]] = (
        (measures.tilt > FALLEN, f"it fell: the torso tilted by {np.degrees(measures.tilt):.0f} deg"),
        (measures.height[0] < 0.5 * target.gait.height, f"the torso went down to {measures.height[0]:.2f} m"),
        (measures.margin <= 0, f"the centre of mass left its support by {-1000 * measures.margin:.0f} mm"),
        (measures.clearance <= 0, "a foot did not leave the floor"),
        (
            measures.forward < LEAST_WAY * target.advance,
            f"it walked {measures.forward:.3f} m of {target.advance:.3f} m",
        ),
    )
    return "; ".join(sentence for wrong, sentence in faults if wrong)
