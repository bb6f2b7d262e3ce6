"""What starts from rest say of a joint's break-away beside its model: brackets of voltage, late by the backlash."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from sysid.blocks import CoastingPlay, Play
from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.rate import response
from sysid.joint.value_physics import breakaway_over_place, slope_of, volts_to_move
from sysid.joint.value_record import Started
from sysid.joint.value_spread import LACKS, Spread
from sysid.uncertainty.initial_sensitivity import with_initial_state

_PLACE = 0.03  # standard uncertainty of a break-away at mid stroke that is read elsewhere, as a share of the friction
_TARDY = 0.2  # probability of a late start: a link creeps before it is seen, or crosses a backlash that no model has
_COUNTED = 2.0  # starts that differ: a joint's starts are late for the same reasons
_FACTORS = (0.3, 2.5)  # on the model's friction at rest
_UNKNOWN = 0.2  # of the friction: largest standard uncertainty of the break-away of a fit
_DOUBTFUL = 0.15  # of the friction: starts that differ by more than such an uncertainty are not believed
_APART = 2.0  # standard deviations by which model and starts contradict each other
_SLOW = 0.5  # of the friction: a smaller bracket is one
_STATIC = 0.2  # of the friction: standard uncertainty of a break-away by a model that has no other friction at rest
_CREEPS = 0.03  # of the friction: standard uncertainty that starts share, as a joint that creeps before it is free
_CLOSED = 0.1  # of the backlash: what is left to cross is none


@dataclass(frozen=True)
class Breakaway:
    """What starts add to the model's break-away in one direction: how many agree, the `shift` [V] of the input by which
    the model agrees with them, and its standard uncertainty `std` [V], infinite if they contradict it.

    `share` is that uncertainty relative to the friction at rest, half of what lies between both break-aways.
    """

    count: int
    shift: float
    std: float
    share: float


def breakaway(fit: Fit, data: IOData, starts: Sequence[Started], way: int, spread: Spread) -> Breakaway:
    """The break-away at mid stroke in a direction of the motor from the model and the `starts` of its record.

    A start brackets it if the voltage rose by less than half of the friction from the last one that surely held the
    joint. A motor that crosses its backlash before its link moves started earlier (`_earliest`).
    """
    chain, theta = fit.model, fit.theta
    over, up = breakaway_over_place(chain, theta), way if slope_of(chain, theta) > 0.0 else -way  # of y
    friction = max(0.5 * abs(volts_to_move(chain, theta, 1, True) - volts_to_move(chain, theta, -1, True)), 1e-9)
    known = [_earliest(fit, data, start, way) for start in starts if start.way == up]
    slow = [start for start in known if 0.0 < abs(start.moved - start.held) <= _SLOW * friction]

    def middle(free: np.ndarray) -> float:
        return volts_to_move(chain, free, way, True)

    def farther(free: np.ndarray) -> float:
        volts = breakaway_over_place(chain, free)
        return float(np.mean([volts(start.place, up) for start in slow])) - middle(free)

    volts = np.array([over(start.place, up) for start in slow])
    held, moved = (way * (np.array([getattr(s, name) for s in slow]) - volts) for name in ("held", "moved"))
    agreed = _agreed(1.0 + np.column_stack([held, moved]).reshape(-1, 2) / friction)
    share = spread.std(middle) / friction
    static = 0.0 if motor_of(chain).stribeck else _STATIC
    lack = float(np.linalg.norm([LACKS["breakaway"], share if share < _UNKNOWN else _UNKNOWN, static]))
    place = spread.std(farther) / friction if slow else 0.0
    factor, std = _factor(agreed, lack, place if place < _UNKNOWN else _UNKNOWN)
    return Breakaway(len(agreed), float(way * (factor - 1.0) * friction), float(std * friction), std)


def _earliest(fit: Fit, data: IOData, start: Started, way: int) -> Started:
    """The start with the voltage that surely held the motor, where the model's has to cross the backlash first.

    A motor without inertia that starts at some voltage, and whose friction stays as large as it, is slower than the
    real one, and yet crosses what is left to cross in a time that the record's voltage gives; the model's speed for a
    voltage is the real one's. The next lower voltage than the highest from which on this suffices held the motor; where
    there is none, nothing is known to have held it.
    """
    chain, theta = fit.model, fit.theta
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
    if play is None:
        return start
    record, k = data.experiments[start.experiment], chain.blocks.index(play)
    row = theta if start.experiment == 0 else with_initial_state(chain, theta, record)
    u, rest = record.u[:, 0], slice(start.since, start.sample + 1)
    x, part = chain.through(row, u, 0, k), chain.part(row, play)
    ahead = start.way * (x - play.output(part, x))[rest]
    left = float(np.max(0.5 * part[0] - ahead))
    if left <= _CLOSED * part[0]:
        return start
    motor, pushes = motor_of(chain), way * u[rest]
    speed = motor.value(chain.part(theta, motor), "gain") * abs(slope_of(chain, theta))
    acted = pushes[: max(len(pushes) - round(response(chain, theta)), 1)]
    levels = np.unique(acted)
    beyond = np.array([np.sum(np.maximum(acted[np.argmax(acted >= level) :] - level, 0.0)) for level in levels])
    enough = levels[speed * beyond >= left]
    held = float(enough[-2]) if len(enough) > 1 else -np.inf
    return replace(start, held=way * min(held, way * start.held))


def _agreed(brackets: np.ndarray) -> np.ndarray:
    """The brackets (n, 2) that overlap the earliest one: a link that creeps before it is seen starts late."""
    return brackets[brackets[:, 0] <= brackets[:, 1].min(initial=np.inf)]


def _factor(brackets: np.ndarray, lack: float, place: float) -> tuple[float, float]:
    """Factor on the model's friction at rest from the brackets (n, 2) of starts, and its standard uncertainty.

    Mean and deviation of the factor's distribution, on a grid. The model is a normal distribution around 1 with
    standard deviation `lack`. A bracket is a uniform one, and with the probability `_TARDY` the start was late and the
    factor is below the bracket. Its edges are uncertain by `_PLACE`, and all together by `place`, since the model takes
    the starts to mid stroke. All starts together count as `_COUNTED`. The uncertainty is infinite if starts and model
    contradict each other.
    """
    grid = np.linspace(*_FACTORS, 1001)
    told = np.zeros(len(grid))
    for low, high in brackets:
        below, above = (norm.cdf((grid - edge) / _PLACE) for edge in (low, high))
        inside = (below - above) / max(high - low, _PLACE)
        told += np.log((1.0 - _TARDY) * inside + _TARDY * (1.0 - below) / max(low, _PLACE) + 1e-12)
    told *= min(1.0, _COUNTED / max(len(brackets), 1))
    if place > 0.0:
        step = grid[1] - grid[0]
        kernel = norm.pdf(np.arange(-len(grid) + 1, len(grid)) * step / place)
        told = np.log(np.convolve(np.exp(told - told.max()), kernel, "valid") + 1e-12)
    read, std = _moments(grid, told) if len(brackets) else (1.0, 0.0)
    if abs(read - 1.0) > _APART * np.hypot(std, min(lack, _DOUBTFUL)):
        return read, np.inf
    value, std = _moments(grid, told - 0.5 * ((grid - 1.0) / lack) ** 2)
    return value, float(np.hypot(std, _CREEPS))


def _moments(grid: np.ndarray, log: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of a density that is given by its logarithm."""
    weight = np.exp(log - log.max())
    mean = float(weight @ grid / weight.sum())
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2 / weight.sum()))
