"""Starts of a joint from rest: what its record shows of them, and the break-away voltage from them and the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from sysid.blocks import CoastingPlay, Play
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.physics import breakaway_over_place, slope_of, volts_to_move, way_up
from sysid.joint.sampling import response_samples
from sysid.joint.spread import LACKS, Spread
from sysid.joint.stops import REST_SAMPLES, SURE_DEVIATIONS, drive_sign, mean_speeds, rounding_deviation, speed_window

_SLOW_RISE = 0.5  # of a voltage: a slower rise while the joint starts brackets it
_DELAY_SAMPLES = 2  # samples of delay
_PLACE_DEVIATION = (
    0.03  # standard uncertainty of a break-away at mid stroke that is read elsewhere, as a share of the friction
)
_LATE_PROBABILITY = (
    0.2  # probability of a late start: a link creeps before it is seen, or crosses a backlash that no model has
)
_INDEPENDENT_STARTS = 2.0  # starts that differ: a joint's starts are late for the same reasons
_FACTORS = (0.3, 2.5)  # on the model's friction at rest
_UNKNOWN_DEVIATION = 0.2  # of the friction: largest standard uncertainty of the break-away of a fit
_DOUBTFUL_DEVIATION = 0.15  # of the friction: starts that differ by more than such an uncertainty are not believed
_CONTRADICTION = 2.0  # standard deviations by which model and starts contradict each other
_SLOW_BRACKET = 0.5  # of the friction: a smaller bracket is one
_STATIC_DEVIATION = (
    0.2  # of the friction: standard uncertainty of a break-away by a model that has no other friction at rest
)
_CREEP_DEVIATION = (
    0.03  # of the friction: standard uncertainty that starts share, as a joint that creeps before it is free
)
_CLOSED_SHARE = 0.1  # of the backlash: what is left to cross is none


@dataclass(frozen=True)
class RestStart:
    """A start from rest in the direction `way` at the place `place` [y]: the voltages `held` and `moved` [V] between
    which it began, in the sense of u. It rested from the sample `since` on and is seen to move at `sample`."""

    experiment: int
    since: int
    sample: int
    way: int
    place: float
    held: float
    moved: float

    @property
    def slow(self) -> bool:
        """Whether the voltage rose, and slowly enough to bracket the start."""
        return 0.0 < abs(self.moved - self.held) <= _SLOW_RISE * max(abs(self.moved), abs(self.held))


def starts_from_rest(data: IOData, noise: float, every: int = 1) -> list[RestStart]:
    """Every start from rest of a record, read in means of `every` samples; `way` is the direction of y.

    The joint is seen to have moved when it is `_SURE` standard deviations from its rest. Under a rising voltage its way
    grows with the square of time or faster, so it began at most twice as long before as a quarter of this way was
    passed, which is no later than it was last seen behind its rest.
    """
    # At rest one and the same rounding error is in every reading.
    noise = max(noise / np.sqrt(every), *(rounding_deviation(record.y[record.observed]) for record in data.experiments))
    starts = []
    sign = drive_sign(*(np.concatenate([getattr(r, k)[:, 0] for r in data.experiments]) for k in ("u", "y")))
    for k, record in enumerate(data.experiments):
        n = record.N // every
        u, y = (part[: n * every, 0].reshape(n, every) for part in (sign * record.u, record.y))
        y = y.mean(axis=1)
        m = max(speed_window(noise, np.abs(np.diff(y))), 2)
        if n < 2 * m:  # no speed is seen in so few readings
            continue
        speed = np.concatenate([np.zeros(m), mean_speeds(y, m), np.zeros(m - 1)])
        still = np.abs(speed) < SURE_DEVIATIONS * noise * np.sqrt(2.0 / m) / m
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        ends = [*edges[2::2], len(y)][: len(edges) // 2]  # a record that never rests has none
        for first, last, following in zip(edges[::2], edges[1::2], ends, strict=True):
            if last - first >= REST_SAMPLES + m and last < len(y):
                start = _rest_start(u, y, noise, (int(first), int(last), int(following)), int(np.sign(speed[last])))
                if start is not None:
                    sample, place, held_level, moved_level = start
                    way = int(np.sign(speed[last]))
                    starts.append(
                        RestStart(
                            k,
                            every * int(first),
                            every * sample,
                            way,
                            place,
                            way * sign * held_level,
                            way * sign * moved_level,
                        )
                    )
    return starts


def _rest_start(
    inputs: np.ndarray, y: np.ndarray, noise: float, spans: tuple[int, int, int], way: int
) -> tuple[int, float, float, float] | None:
    """Sample at which a start is seen, place of the rest, and voltages before and at it, positive towards `way`; None
    if the joint drifts instead of resting. `inputs` (n, every) and the means y (n,) of as many readings; `spans`:
    first sample of the rest, of the motion, and of the next rest."""
    u = inputs[:, 0]
    first, last, following = spans
    half = max((last - first) // 2, REST_SAMPLES)
    quarter = max(half // 2, 1)
    rest = float(np.mean(y[first : first + half]))
    drift = abs(float(np.mean(y[first : first + quarter]) - np.mean(y[first + half - quarter : first + half])))
    # A quarter of the rest that drifts by less is not seen to have moved after all four.
    if drift > SURE_DEVIATIONS * noise * max(np.sqrt(2.0 / quarter), 0.25):
        return None
    distance = way * (np.convolve(y, np.ones(3) / 3, "same") - rest)[first : min(following + 1, len(y) - 1)]
    gone_far = np.flatnonzero(distance > SURE_DEVIATIONS * noise)
    gone_far = gone_far[gone_far >= half]
    if not len(gone_far):
        return None
    close = np.flatnonzero(distance[: gone_far[0]] <= 0.0)
    seen_at, last_behind = first + int(gone_far[0]), first + (int(close[-1]) if len(close) else 0)
    last_held = max(last_behind - (seen_at - last_behind) - _DELAY_SAMPLES, first)
    last_still = last_held + 1
    if u[last_held] in (u[last_held - 1], u[last_held + 1]):  # under a steady voltage it starts at once or never
        while last_still > first + 1 and u[last_still - 1] == u[last_held]:
            last_still -= 1
    held_level, moved_level = (
        float((way * u)[first:last_still].max()),
        float((way * inputs)[last_held : seen_at + 1].max()),
    )
    return seen_at, rest, min(held_level, moved_level), moved_level


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


def breakaway(fit: Fit, data: IOData, starts: Sequence[RestStart], way: int, spread: Spread) -> Breakaway:
    """The break-away at mid stroke in a direction of the motor from the model and the `starts` of its record.

    A start brackets it if the voltage rose by less than half of the friction from the last one that surely held the
    joint. A motor that crosses its backlash before its link moves started earlier (`_earliest`).
    """
    chain, theta = fit.model, fit.theta
    volts_at, output_way = breakaway_over_place(chain, theta), way * way_up(chain, theta)  # of y
    friction = max(0.5 * abs(volts_to_move(chain, theta, 1, True) - volts_to_move(chain, theta, -1, True)), 1e-9)
    bounded_starts = [_with_earliest_voltage(fit, data, start, way) for start in starts if start.way == output_way]
    slow = [start for start in bounded_starts if 0.0 < abs(start.moved - start.held) <= _SLOW_BRACKET * friction]

    def middle(free: np.ndarray) -> float:
        return volts_to_move(chain, free, way, True)

    def farther(free: np.ndarray) -> float:
        volts = breakaway_over_place(chain, free)
        return float(np.mean([volts(start.place, output_way) for start in slow])) - middle(free)

    volts = np.array([volts_at(start.place, output_way) for start in slow])
    held_levels, moved_levels = (
        way * (np.array([getattr(s, name) for s in slow]) - volts) for name in ("held", "moved")
    )
    brackets = _agreeing_brackets(1.0 + np.column_stack([held_levels, moved_levels]).reshape(-1, 2) / friction)
    share = spread.std(middle) / friction
    static = 0.0 if motor_of(chain).stribeck else _STATIC_DEVIATION
    lack = float(
        np.linalg.norm([LACKS["breakaway"], share if share < _UNKNOWN_DEVIATION else _UNKNOWN_DEVIATION, static])
    )
    place = spread.std(farther) / friction if slow else 0.0
    factor, std = _friction_factor(brackets, lack, place if place < _UNKNOWN_DEVIATION else _UNKNOWN_DEVIATION)
    return Breakaway(len(brackets), float(way * (factor - 1.0) * friction), float(std * friction), std)


def _with_earliest_voltage(fit: Fit, data: IOData, start: RestStart, way: int) -> RestStart:
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
    row = theta if start.experiment == 0 else estimate_initial(chain, theta, record)
    u, rest = record.u[:, 0], slice(start.since, start.sample + 1)
    x, part = chain.through(row, u, 0, k), chain.part(row, play)
    gap = start.way * (x - play.output(part, x))[rest]
    distance_left = float(np.max(0.5 * part[0] - gap))
    if distance_left <= _CLOSED_SHARE * part[0]:
        return start
    motor, pushes = motor_of(chain), way * u[rest]
    speed = motor.value(chain.part(theta, motor), "gain") * abs(slope_of(chain, theta))
    effective_pushes = pushes[: max(len(pushes) - round(response_samples(chain, theta)), 1)]
    levels = np.unique(effective_pushes)
    path = np.array(
        [np.sum(np.maximum(effective_pushes[np.argmax(effective_pushes >= level) :] - level, 0.0)) for level in levels]
    )
    sufficient = levels[speed * path >= distance_left]
    held_level = float(sufficient[-2]) if len(sufficient) > 1 else -np.inf
    return replace(start, held=way * min(held_level, way * start.held))


def _agreeing_brackets(brackets: np.ndarray) -> np.ndarray:
    """The brackets (n, 2) that overlap the earliest one: a link that creeps before it is seen starts late."""
    return brackets[brackets[:, 0] <= brackets[:, 1].min(initial=np.inf)]


def _friction_factor(brackets: np.ndarray, lack: float, place: float) -> tuple[float, float]:
    """Factor on the model's friction at rest from the brackets (n, 2) of starts, and its standard uncertainty.

    Mean and deviation of the factor's distribution, on a grid. The model is a normal distribution around 1 with
    standard deviation `lack`. A bracket is a uniform one, and with the probability `_TARDY` the start was late and the
    factor is below the bracket. Its edges are uncertain by `_PLACE`, and all together by `place`, since the model takes
    the starts to mid stroke. All starts together count as `_COUNTED`. The uncertainty is infinite if starts and model
    contradict each other.
    """
    grid = np.linspace(*_FACTORS, 1001)
    log_likelihood = np.zeros(len(grid))
    for low, high in brackets:
        lower_cdf, upper_cdf = (norm.cdf((grid - edge) / _PLACE_DEVIATION) for edge in (low, high))
        density = (lower_cdf - upper_cdf) / max(high - low, _PLACE_DEVIATION)
        log_likelihood += np.log(
            (1.0 - _LATE_PROBABILITY) * density
            + _LATE_PROBABILITY * (1.0 - lower_cdf) / max(low, _PLACE_DEVIATION)
            + 1e-12
        )
    log_likelihood *= min(1.0, _INDEPENDENT_STARTS / max(len(brackets), 1))
    if place > 0.0:
        step = grid[1] - grid[0]
        kernel = norm.pdf(np.arange(-len(grid) + 1, len(grid)) * step / place)
        log_likelihood = np.log(np.convolve(np.exp(log_likelihood - log_likelihood.max()), kernel, "valid") + 1e-12)
    read, std = _moments(grid, log_likelihood) if len(brackets) else (1.0, 0.0)
    if abs(read - 1.0) > _CONTRADICTION * np.hypot(std, min(lack, _DOUBTFUL_DEVIATION)):
        return read, np.inf
    value, std = _moments(grid, log_likelihood - 0.5 * ((grid - 1.0) / lack) ** 2)
    return value, float(np.hypot(std, _CREEP_DEVIATION))


def _moments(grid: np.ndarray, log: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of a density that is given by its logarithm."""
    weight = np.exp(log - log.max())
    mean = float(weight @ grid / weight.sum())
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2 / weight.sum()))
