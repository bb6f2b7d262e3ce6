"""What a record bears out of a fitted joint's values: ends that were met, starts from rest, crossings of the backlash.

A fit has a number for every parameter, and a small interval where the model could not be otherwise. Whether the record
shows what the number stands for is a question to the record.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import norm

from sysid.base.units import number, shown
from sysid.blocks import CoastingPlay, Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.rate import response
from sysid.joint.value_physics import breakaway_over_place, ends_of, travel_of, volts_to_move
from sysid.joint.value_record import Started, StopTest, noise_level, starts_from_rest, stop_test
from sysid.joint.value_spread import FAR, LACKS, Spread, gradient_of, spread_of
from sysid.model.chain import Chain
from sysid.uncertainty.initial_sensitivity import with_initial_state

STARTS = 2  # from rest in one direction, under a slowly rising voltage
CROSSINGS = 6  # of the backlash, both ways together
_PLACE = 0.03  # standard uncertainty of a break-away at mid stroke that is read elsewhere, as a share of it
_TARDY = 0.2  # probability of a late start: a link crosses its backlash first, or creeps before it is seen
_COUNTED = 2.0  # starts that differ: a joint's starts are late for the same reasons
_FACTORS = (0.3, 2.5)  # on the model's break-away
_UNKNOWN = 0.2  # of its value: largest standard uncertainty of the break-away of a fit
_DOUBTFUL = 0.15  # of the model's break-away: starts that differ by more than such an uncertainty are not believed
_APART = 2.0  # standard deviations by which model and starts contradict each other
_CLEAR = 0.15  # of the backlash: a wider standard uncertainty of the fit does not determine it
_SIDE = 0.4  # of the backlash from its middle: the link lies against this side
_TOLD = 0.5  # of lag and delay together: a wider standard deviation of one does not tell it from the other
_TOGETHER = -0.9  # a correlation of lag and delay below it leaves only their sum
STAIRS = "qpal design --for breakaway FILE"


@dataclass(frozen=True)
class Shown:
    """Whether the record determines a value, one plain sentence why (not), and what was counted."""

    determined: bool
    why: str = ""
    counts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Evidence:
    """By name of a value, what the record shows of it; the tests of both ends and the starts from rest behind it.

    A value without an entry needs nothing but information. `breakaway`: factor on the model's break-away by which it
    agrees with the starts, and its standard uncertainty, by name.
    """

    values: Mapping[str, Shown]
    stops: Mapping[str, StopTest]
    starts: tuple[Started, ...]
    noise: float
    breakaway: Mapping[str, tuple[float, float]]

    def determined(self, name: str) -> bool:
        """Whether the record determines the value `name`, as far as it takes more than information."""
        return self.values[name].determined if name in self.values else True

    def why(self, name: str) -> str:
        """The sentence of the value `name`; '' if there is none."""
        return self.values[name].why if name in self.values else ""


def evidence(fit: Fit, data: IOData, spread: Spread | None = None) -> Evidence:
    """What the estimation record `data` shows of the values of an actuated joint `fit`.

    end_low, end_high: see `sysid.joint.value_record.stop_test`. breakaway_up, breakaway_down: at least `STARTS` starts
    from rest that a slowly rising voltage brackets. backlash: at least `CROSSINGS` of the model's link from side to
    side, and a standard uncertainty of 15 % at most in the fit. time_constant and delay: neither is told from their sum
    if Ts is longer than it, or if their correlation in the information matrix, or their uncertainty, says so. `spread`
    spares its computation.
    """
    chain, theta = fit.model, fit.theta
    spread = spread_of(fit, data, 0.95) if spread is None else spread
    noise, links, stops = _noise(data), _links(chain, theta, data), stop_tests(fit, data)
    found = {name: _of_stop(test, data.y_unit or "y", name) for name, test in stops.items()}
    readable = chain.block("sensor") is None and not isinstance(motor_of(chain), ServoMotor)
    starts = tuple(starts_from_rest(data, noise, _every(fit))) if readable else ()
    factors, volts = {}, breakaway_over_place(chain, theta)
    for name, way in (("breakaway_up", 1), ("breakaway_down", -1)):
        agreed = _agreed([start for start in starts if start.way == way and start.slow], volts)
        factors[name] = _factor(agreed, _uncertain(fit, way, spread))
        found[name] = _of_starts(len(agreed), factors[name][1], "up" if way > 0 else "down")
    if links is not None:
        found["backlash"] = _of_crossings(*links, _play_uncertainty(fit, spread))
    if motor_of(chain).delayed:
        found["time_constant"] = found["delay"] = _of_times(fit, spread)
    return Evidence(found, stops, starts, noise, factors)


def stop_tests(fit: Fit, data: IOData) -> dict[str, StopTest]:
    """`stop_test` of the fit's end_low and end_high on its record; empty for a joint without stops and travel.

    Where a map of the sensor follows, the place of the link is the model's, because the record does not show it. What
    drives a servo is its error. An end that the fit has out of reach was not met.
    """
    chain, theta = fit.model, fit.theta
    places = _places(chain, theta, data)
    drives, noise = _drives(chain, theta, data, places), float(np.median([noise_level(y) for y in places]))
    every = _every(fit)
    drives, places = ([a[::every] for a in each] for each in (drives, places))
    seen = max(float(y.max()) for y in places) - min(float(y.min()) for y in places)
    slack, found = min(_width(chain, theta), FAR * seen), {}
    for name, way, at in zip(("end_low", "end_high"), (-1.0, 1.0), ends_of(chain, theta), strict=True):
        if np.isfinite(at):
            found[name] = stop_test(drives, places, every * data.Ts, at, noise, way, slack)
        elif travel_of(chain) is not None:
            farthest = way * max(float(np.max(way * y)) for y in places)
            found[name] = StopTest(False, "no stop explains the record there", (), farthest, np.inf)
    return found


def _every(fit: Fit) -> int:
    """Samples in which lag and delay pass, at least 1: what a record shows of rests does not change faster."""
    return max(1, round(response(fit.model, fit.theta)))


def _drives(chain: Chain, theta: np.ndarray, data: IOData, places: list[np.ndarray]) -> list[np.ndarray]:
    """What drives the motor in each experiment: the input, or the error of a servo."""
    inputs = [record.u[:, 0] for record in data.experiments]
    motor = motor_of(chain)
    if not isinstance(motor, ServoMotor):
        return inputs
    k = chain.blocks.index(motor)
    return [chain.through(theta, u, 0, k) - place for u, place in zip(inputs, places, strict=True)]


def _noise(data: IOData) -> float:
    return float(np.median([noise_level(record.y[:, 0]) for record in data.experiments]))


def _places(chain: Chain, theta: np.ndarray, data: IOData) -> list[np.ndarray]:
    """Place of the link in each experiment: the record, or where a sensor's map follows, what the model says."""
    sensor = chain.block("sensor")
    if sensor is None:
        return [record.y[:, 0] for record in data.experiments]
    k = chain.blocks.index(sensor)
    return [chain.through(row, record.u[:, 0], 0, k) for row, record in _runs(chain, theta, data)]


def _runs(chain: Chain, theta: np.ndarray, data: IOData) -> list[tuple[np.ndarray, IOData]]:
    """theta with the initial state of each experiment, and the experiment."""
    return [
        (theta if k == 0 else with_initial_state(chain, theta, record), record)
        for k, record in enumerate(data.experiments)
    ]


def _width(chain: Chain, theta: np.ndarray) -> float:
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
    return 0.0 if play is None else float(chain.part(theta, play)[0])


def _links(chain: Chain, theta: np.ndarray, data: IOData) -> tuple[int, int] | None:
    """How often the model's link crosses its backlash upward and downward; None without a backlash."""
    play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
    if play is None:
        return None
    k, width, counts = chain.blocks.index(play), _width(chain, theta), [0, 0]
    for row, record in _runs(chain, theta, data):
        x = chain.through(row, record.u[:, 0], 0, k)
        share = (play.output(chain.part(row, play), x) - x) / max(width, 1e-300)
        sides = np.sign(share[np.abs(share) > _SIDE])
        counts[0] += int(np.sum(np.diff(sides) > 0))
        counts[1] += int(np.sum(np.diff(sides) < 0))
    return counts[0], counts[1]


def _of_stop(test: StopTest, unit: str, name: str) -> Shown:
    counts = {"rests": len(test.visits), "arrivals": test.arrivals, "farthest": test.farthest}
    if test.met:
        return Shown(True, f"{len(test.visits)} rests against it", counts)
    as_shown = shown(name, unit)
    place = f"{number(test.farthest * as_shown.factor, 4)} {as_shown.unit}".rstrip()
    return Shown(False, f"not met: beyond {place} ({test.why})", counts)


def _of_starts(count: int, std: float, way: str) -> Shown:
    counts = {"slow_starts": count, "uncertainty": std}
    said = f"{count or 'no'} start{'' if count == 1 else 's'} from rest {way} under a slowly rising voltage"
    if count < STARTS:
        return Shown(False, f"{said}, {STARTS} that agree are needed: record slow stairs ({STAIRS})", counts)
    if not np.isfinite(std):
        return Shown(False, f"{said} contradict the model: record slower stairs ({STAIRS})", counts)
    return Shown(True, said, counts)


def _agreed(slow: Sequence[Started], volts: Callable[[float, int], float]) -> np.ndarray:
    """Brackets (n, 2) of slow starts as shares of the model's break-away `volts`, those that overlap the earliest one.

    A link that crosses its backlash first, or creeps before it is seen, starts late and never early.
    """
    model = np.array([volts(start.place, start.way) for start in slow])
    brackets = np.array([sorted((abs(start.held), abs(start.moved))) for start in slow]).reshape(-1, 2)
    brackets /= np.maximum(np.abs(model), 1e-9)[:, None]
    return brackets[brackets[:, 0] <= brackets[:, 1].min(initial=np.inf)]


def _uncertain(fit: Fit, way: int, spread: Spread) -> float:
    """Standard uncertainty of the model's break-away, as a share of it."""

    def read(theta: np.ndarray) -> float:
        return volts_to_move(fit.model, theta, way, True)

    std = spread.std(gradient_of(read, fit.theta))
    share = std / max(abs(read(fit.theta)), 1e-9)
    return float(np.hypot(LACKS["breakaway"], share if share < _UNKNOWN else _UNKNOWN))


def _factor(brackets: np.ndarray, lack: float) -> tuple[float, float]:
    """Factor on the model's break-away from the brackets (n, 2) of starts, and its standard uncertainty.

    Mean and deviation of the factor's distribution, on a grid. The model is a normal distribution around 1 with
    standard deviation `lack`. A bracket is a uniform one, and with the probability `_TARDY` the start was late and the
    factor is below the bracket. Its edges are uncertain by `_PLACE`. All starts together count as `_COUNTED`. The
    uncertainty is infinite if starts and model contradict each other.
    """
    grid = np.linspace(*_FACTORS, 1001)
    told = np.zeros(len(grid))
    for low, high in brackets:
        below, above = (norm.cdf((grid - edge) / _PLACE) for edge in (low, high))
        inside = (below - above) / max(high - low, _PLACE)
        told += np.log((1.0 - _TARDY) * inside + _TARDY * (1.0 - below) / low + 1e-12)
    told *= min(1.0, _COUNTED / max(len(brackets), 1))
    read, std = _moments(grid, told) if len(brackets) else (1.0, 0.0)
    if abs(read - 1.0) > _APART * np.hypot(std, min(lack, _DOUBTFUL)):
        return read, np.inf
    return _moments(grid, told - 0.5 * ((grid - 1.0) / lack) ** 2)


def _moments(grid: np.ndarray, log: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of a density that is given by its logarithm."""
    weight = np.exp(log - log.max())
    mean = float(weight @ grid / weight.sum())
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2 / weight.sum()))


def _of_crossings(up: int, down: int, std: float) -> Shown:
    counts = {"crossings_up": up, "crossings_down": down, "uncertainty": std}
    if up + down < CROSSINGS:
        why = f"the link crosses it {up + down} times, {CROSSINGS} are needed: reverse slowly where its weight changes"
        return Shown(False, f"{why} sides (qpal design --for backlash FILE)", counts)
    if not std <= _CLEAR:
        size = f"{100 * std:.0f} % of it" if std < 10.0 else "larger than itself"
        why = f"its standard uncertainty is {size}: what the link does on its way across looks like lag and friction"
        return Shown(False, f"{why}; sample faster (qpal design --for backlash FILE)", counts)
    return Shown(True, f"the link crosses it {up + down} times", counts)


def _play_uncertainty(fit: Fit, spread: Spread) -> float:
    """Standard uncertainty of the backlash in the fit, as a share of it."""
    std = spread.std(gradient_of(lambda theta: _width(fit.model, theta), fit.theta))
    return std / max(_width(fit.model, fit.theta), 1e-300) if np.isfinite(std) else np.inf


def _of_times(fit: Fit, spread: Spread) -> Shown:
    """Whether lag and delay are told apart; the correlation of their estimates decides, and the sampling time."""
    chain, motor, Ts = fit.model, motor_of(fit.model), fit.Ts
    gradient = np.array([[float(name == f"{motor.role}.{part}") for name in chain.names] for part in ("lag", "delay")])
    lag, delay = (motor.value(chain.part(fit.theta, motor), part) for part in ("lag", "delay"))
    std = [spread.std(row) for row in gradient]
    cov = spread.noise.covariance_of(gradient)
    size = float(np.sqrt(cov[0, 0] * cov[1, 1]))
    r = float(cov[0, 1]) / size if size > 0.0 else 0.0
    counts = {"correlation": r, "samples": lag + delay}
    limits = chain.limits
    at = [chain.names.index(f"{motor.role}.{part}") for part in ("lag", "delay")]
    free = all(limits[0][i] < fit.theta[i] < limits[1][i] for i in at)
    if lag + delay < 1.0:
        why = f"the sampling time of {Ts:g} s is longer than time constant and delay together"
    elif not free or not np.all(np.isfinite(std)) or r < _TOGETHER or max(std) > _TOLD * (lag + delay) / 2:
        why = f"this record does not tell time constant and delay apart (correlation {r:.2f})"
    else:
        return Shown(True, f"correlation {r:.2f}", counts)
    return Shown(False, f"{why}; sample faster to tell them apart", counts)
