"""A slow crawl, planned offline: one foot in the air at a time, and the body moves only while all four stand.

The order rear left, front left, rear right, front right is the creeping gait with the largest longitudinal stability
margin (McGhee and Frank 1968, Mathematical Biosciences 3, 331-351). Legs of one side step while the body leans over the
other side, then the body moves on and across: the two-phase discontinuous gait of Gonzalez de Santos and Jimenez (1995,
Journal of Robotic Systems 12). It suits slow, self-locking actuators: no loaded leg moves while three feet stand.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from twin.parameters import Parameters
from twin.plant.leg import LEGS, robot
from twin.robot.kinematics import Body, body
from twin.robot.statics import Statics

ORDER = (("rear_left", "front_left"), ("rear_right", "front_right"))
CREEP = 1e-9  # [m/s or rad/s] speed at break-away
STILL = 1e-6  # [m or rad per path] less is rounding
LEAST_MARGIN = 0.005  # [m] smallest stability margin of a plan
POINTS = 33  # points of a move's path at which loads and speeds are checked


@checked(late=True)
@dataclass(frozen=True)
class Gait:
    """Settings of a crawl. `height` [m] of the torso's centre over the floor and `spread` [m] of a foot from its
    shoulder's axis give the stance; `stride` [m] is the distance of a cycle, `sway` [m] the body's lean to either
    side, `lift` [m] the height of a foot in swing, `pause` [s] the rest after each move. `effort` is the share of the
    supply voltage that the plan uses: the rest is for servo errors and for friction above nominal.
    """

    cycles: int = 2
    stride: float = 0.12
    sway: float = 0.02
    lift: float = 0.03
    height: float = 0.41
    spread: float = 0.16
    effort: float = 0.85
    pause: float = 0.4
    Ts: float = 0.05

    def __post_init__(self) -> None:
        if not isinstance(self.cycles, int) or not 0 <= self.cycles <= 100:
            raise InputError(f"the crawl has {self.cycles!r} cycles; give a whole number from 0 to 100")
        for name, low, high in _BOUNDS:
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name} of the crawl is {value}; give a value from {low:g} to {high:g}")


_BOUNDS = (
    ("stride", 0.0, 0.3),
    ("sway", 0.0, 0.15),
    ("lift", 0.005, 0.15),
    ("height", 0.1, 0.6),
    ("spread", 0.0, 0.5),
    ("effort", 0.1, 1.0),
    ("pause", 0.0, 10.0),
    ("Ts", 0.01, 0.5),
)


@dataclass(frozen=True)
class Plan:
    """The planned motion of a crawl, sampled every `Ts` [s].

    `angles` (N, 12) [rad] in the order of the model's actuators; `torso` (N, 3) [m], level; `feet` (N, 4, 3) [m],
    their centres, in the order of `LEGS`; `stance` (N, 4): which feet stand; `margin` (N,) [m]: distance of the centre
    of mass from the edge of the support polygon, positive inside; `moves`: (first sample, name) of each move. `load`
    (12,) and `need` (12,) [N, or N m for a shoulder]: the largest load of each actuator and the largest force required
    for its motion; `stall` (12,): its stall force.
    """

    gait: Gait
    Ts: float
    angles: np.ndarray
    torso: np.ndarray
    feet: np.ndarray
    stance: np.ndarray
    margin: np.ndarray
    moves: tuple[tuple[int, str], ...]
    load: np.ndarray
    need: np.ndarray
    stall: np.ndarray

    @property
    def t(self) -> np.ndarray:
        """Time (N,) [s]."""
        return self.Ts * np.arange(len(self.angles))

    @property
    def advance(self) -> float:
        """Planned distance forward [m]."""
        return float(self.torso[-1, 0] - self.torso[0, 0])


@dataclass(frozen=True)
class _Move:
    """A torso (n, 3) and feet (n, 4, 3) along a path, and the standing feet (4,); all four during the last `rest`."""

    name: str
    torso: np.ndarray
    feet: np.ndarray
    stance: np.ndarray
    rest: int = 0

    @property
    def stances(self) -> np.ndarray:
        """Which feet stand (n, 4) at each sample."""
        resting = np.arange(len(self.torso)) >= len(self.torso) - self.rest
        return self.stance | resting[:, None]


def start(gait: Gait, shape: Body) -> tuple[np.ndarray, np.ndarray]:
    """Torso (3,) and feet (4, 3) [m] of the stance in which the crawl starts and ends: right feet straight out from
    their shoulders, left feet half a stride behind that."""
    torso = np.array([0.0, 0.0, gait.height])
    out = np.stack([np.cos(shape.headings), np.sin(shape.headings), np.zeros(4)], axis=-1)
    feet = shape.mounts + gait.spread * out
    feet[shape.mounts[:, 1] > 0, 0] -= gait.stride / 2
    feet[:, 2] = shape.foot_radius
    return torso, feet


@checked(late=True)
def plan(gait: Gait | None = None, parameters: Parameters | None = None) -> Plan:
    """The crawl of `gait` for a robot with `parameters`.

    Raises InputError if a foot is out of reach, if an actuator is too weak for its load, or if the centre of mass comes
    closer than LEAST_MARGIN to the edge of its support.
    """
    gait, parameters = gait or Gait(), parameters or Parameters()
    model = robot(parameters)
    shape, statics = body(parameters, model), Statics(model, parameters)
    torso, feet = start(gait, shape)
    rest = max(1, round(gait.pause / gait.Ts))
    pieces = [_Move("stand", np.repeat(torso[None], rest, 0), np.repeat(feet[None], rest, 0), np.ones(4, dtype=bool))]
    load, need = np.zeros(12), np.zeros(12)
    for move in _moves(gait, torso, feet):
        sample, loads, needs = _time_move(move, gait, shape, statics, rest)
        pieces.append(sample)
        load, need = np.maximum(load, loads), np.maximum(need, needs)
    starts = np.cumsum([0] + [len(piece.torso) for piece in pieces])
    torsos, feet = (np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("torso", "feet"))
    stance = np.concatenate([piece.stances for piece in pieces])
    angles = shape.angles(torsos, feet)
    margin = np.array([statics.margin(*row) for row in zip(torsos, angles, feet, stance, strict=True)])
    if margin.min() < LEAST_MARGIN:
        k = int(np.argmin(margin))
        name = next(piece.name for piece, stop in zip(pieces, starts[1:], strict=True) if k < stop)
        raise InputError(
            f"at {name!r} the centre of mass is planned {1000 * margin[k]:.1f} mm inside its support; backlash and "
            f"soft feet need {1000 * LEAST_MARGIN:g}; give more sway, or another stride"
        )
    names = tuple((int(start), piece.name) for start, piece in zip(starts, pieces, strict=False))
    return Plan(gait, gait.Ts, angles, torsos, feet, stance, margin, names, load, need, statics.stall)


def _moves(gait: Gait, torso: np.ndarray, feet: np.ndarray) -> Iterator[_Move]:
    """All moves of the crawl, each from the end of the previous one."""
    way = np.array([gait.stride, 0.0, 0.0])
    all_feet = np.ones(4, dtype=bool)
    path = np.linspace(0.0, 1.0, POINTS)
    for phase in range(2 * gait.cycles):
        side = 1.0 if phase % 2 else -1.0  # first over the right side, while the left legs step
        target = np.array([gait.stride / 2 * phase, side * gait.sway, gait.height])
        yield _shift("body moves", torso, target, feet, all_feet)
        torso = target
        for leg in ORDER[phase % 2]:
            k = tuple(LEGS).index(leg)
            swing = np.repeat(feet[None], POINTS, axis=0)
            advance = _ramp(np.clip((path - 0.25) / 0.5, 0, 1))[:, None]
            swing[:, k] += advance * way
            swing[:, k, 2] += gait.lift * np.sin(np.pi * path) ** 2
            stance = all_feet.copy()
            stance[k] = False
            yield _Move(leg.replace("_", " "), np.repeat(torso[None], POINTS, axis=0), swing, stance)
            feet = swing[-1]
    if gait.cycles:
        yield _shift("body moves", torso, np.array([gait.stride * gait.cycles, 0.0, gait.height]), feet, all_feet)


def _shift(name: str, start: np.ndarray, stop: np.ndarray, feet: np.ndarray, stance: np.ndarray) -> _Move:
    path = np.linspace(0.0, 1.0, POINTS)[:, None]
    return _Move(name, start + path * (stop - start), np.repeat(feet[None], POINTS, axis=0), stance)


def _ramp(s: np.ndarray) -> np.ndarray:
    """Profile from 0 to 1 with zero speed at both ends."""
    return s * s * (3 - 2 * s)


def _time_move(
    move: _Move, gait: Gait, shape: Body, statics: Statics, rest: int
) -> tuple[_Move, np.ndarray, np.ndarray]:
    """The move sampled at Ts, then a rest, as fast as its slowest actuator allows; loads and required forces (12,)."""
    s = np.linspace(0.0, 1.0, len(move.torso))
    angles = shape.angles(move.torso, move.feet)
    way = np.array([statics.travel(row) for row in angles])  # of each actuator [m or rad]
    speed = np.gradient(way, s, axis=0)
    loads = np.array([statics.loads(*row, move.stance) for row in zip(move.torso, angles, strict=True)])
    need = statics.needs(loads, CREEP * np.sign(np.where(np.abs(speed) > STILL, speed, 0.0)))
    limit = statics.speeds(need, gait.effort)
    if np.any(limit <= 0):
        k, j = np.unravel_index(int(np.argmin(limit)), limit.shape)
        unit = "N m" if statics.names[j].startswith("shoulder") else "N"
        raise InputError(
            f"at {move.name!r} actuator {statics.names[j]} needs {need[k, j]:.3g} {unit} and has "
            f"{gait.effort * statics.stall[j]:.3g} at {100 * gait.effort:.0f} % of the supply; "
            "raise the body, bring the feet in, or give more effort"
        )
    # The slowest actuator runs at its available speed along the whole path; only the ends are smoothed.
    pace = np.max(np.abs(speed) / limit, axis=1)  # [s] per path
    at_s = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(s))])
    n = max(1, int(np.ceil(at_s[-1] / gait.Ts)))
    places = np.interp(np.arange(1, n + rest + 1) * gait.Ts, at_s, s)
    torso, feet = _resample(places, s, move.torso), _resample(places, s, move.feet)
    return _Move(move.name, torso, feet, move.stance, rest), np.abs(loads).max(0), need.max(0)


def _resample(places: np.ndarray, s: np.ndarray, values: np.ndarray) -> np.ndarray:
    flat = values.reshape(len(s), -1)
    return np.stack([np.interp(places, s, column) for column in flat.T], axis=-1).reshape(
        len(places), *values.shape[1:]
    )
