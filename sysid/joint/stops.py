"""What a joint's record shows without a model: its noise, and rests against an end stop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import IOData

_HELD_SAMPLES = 3  # samples that a voltage must have acted, so that delay and lag are over
REST_SAMPLES = 3  # samples of a rest
_SETTLING_SAMPLES = 2  # samples after an arrival that are no reading of the end
SURE_DEVIATIONS = 4.0  # standard deviations of a speed or place that noise does not explain
_REST_TOLERANCE = 3.0  # standard deviations between the rest that is farthest out and any reading
_SAME_PLACE = 0.01  # of the range seen: rests that are this close are at one place
_MOVING_SHARE = 0.95  # share of the samples at a voltage that must move the joint
_VOLTAGE_MARGIN = 0.1  # of the voltage that moves the joint, by which a rest must exceed it
_SAME_LEVEL = 0.01  # of the largest voltage: levels this close are one
_FEWEST_READINGS = 10  # different readings: fewer do not show the step of a converter
_DIGITS = 9  # of second differences, beyond which equal ones differ by the computer's rounding
_QUARTILE = 0.6745  # of a standard normal variable
_FEWEST_SAMPLES = 2  # samples elsewhere from which that voltage is read
_AT_SPEED = 0.3  # of the speed elsewhere at this voltage


@dataclass(frozen=True)
class Visit:
    """One rest at an end: samples from `first` to before `last`, `reading` [y], voltage `push` outward [V], and `speed`
    of the arrival as a share of the joint's speed elsewhere at the voltage of the approach (0 if it was there before).
    """

    first: int
    last: int
    reading: float
    push: float
    speed: float


@dataclass(frozen=True)
class StopTest:
    """Whether a record shows a stop at a candidate end, why not, the rests against it, and the farthest place seen.

    `moves` [V]: voltage outward from which on the joint moves elsewhere; infinite if no voltage does so.
    """

    met: bool
    why: str
    visits: tuple[Visit, ...]
    farthest: float
    moves: float

    @property
    def arrivals(self) -> int:
        """Rests that the joint came to at speed."""
        return sum(visit.speed >= _AT_SPEED for visit in self.visits)


def noise_level(y: np.ndarray, observed: np.ndarray | None = None) -> float:
    """Standard deviation of white noise and rounding in y (N,): second differences take a steady motion out.

    Samples that were not `observed` (N,) count for nothing. Multiples of a converter's step have few values, of which a
    plain quartile is one; theirs are of the mid-distribution: Ma, Genton and Parzen, Annals of the Institute of
    Statistical Mathematics 63 (2011) 227.
    """
    y = np.ravel(y)
    seen = np.ones(len(y), dtype=bool) if observed is None else observed
    second, rounding = np.diff(y, 2)[seen[2:] & seen[1:-1] & seen[:-2]], rounding_deviation(y[seen])
    scale = float(np.abs(second).max(initial=0.0))
    if not scale > 0.0:
        return rounding
    if rounding > 0.0:
        values, counts = np.unique(np.round(second / scale, _DIGITS), return_counts=True)
        low, high = scale * np.interp([0.25, 0.75], (np.cumsum(counts) - 0.5 * counts) / len(second), values)
    else:  # where most are 0, at rest without noise, the next ones tell nothing of it
        low, high = np.quantile(second, [0.25, 0.75])
    return max(float(high - low) / (2.0 * _QUARTILE * np.sqrt(6.0)), rounding)


def reading_noise(data: IOData, output: int = 0) -> float:
    """Standard deviation of a reading [y], by the samples that were observed."""
    return float(np.median([noise_level(r.y[:, output], r.observed[:, output]) for r in data.experiments]))


def rounding_deviation(y: np.ndarray) -> float:
    """Standard deviation of the rounding of y (N,) to the steps of a converter; 0 where no step is seen."""
    readings = np.unique(y)
    return float(np.diff(readings).min()) / np.sqrt(12.0) if len(readings) >= _FEWEST_READINGS else 0.0


def drive_sign(u: np.ndarray, y: np.ndarray) -> float:
    """1 if y grows under a positive voltage u (N,), -1 if it falls."""
    speed, drive = np.diff(np.ravel(y)), np.ravel(u)[:-1]
    return 1.0 if not len(drive) or float(np.sum(speed * (drive - drive.mean()))) >= 0.0 else -1.0


def stop_test(
    u: np.ndarray | Sequence[np.ndarray],
    y: np.ndarray | Sequence[np.ndarray],
    Ts: float,
    end: float,
    noise: float,
    outward: float = 1.0,
    slack: float = 0.0,
    breakaway: float = np.inf,
    every: int = 1,
) -> StopTest:
    """Whether the record u, y (N,) shows a stop at the place `end` [y]; several experiments are lists of arrays.

    A stop is met if the joint arrives there at speed, rests there against voltages that move it elsewhere and would
    move it on by the trend of its speeds over voltage and place, and is never seen beyond. A rest by friction lacks the
    voltage, a turn lacks the rest, and a spring or a growing load lacks speed. outward: 1 for an upper, -1 for a lower
    end; noise [y]: its standard deviation, see `noise_level`; slack [y]: a backlash, by which rests at one end may
    differ; breakaway [V]: outward voltage that would move the joint there, where a model tells it; every: samples in
    which lag and delay pass: motion under a voltage is looked at in such steps, and rests that much later.
    """
    inputs, ys = ([np.ravel(a) for a in (x if isinstance(x, list | tuple) else [x])] for x in (u, y))
    way = outward * drive_sign(np.concatenate(inputs), np.concatenate(ys))
    pushes, places = [way * a for a in inputs], [outward * a for a in ys]
    end = outward * end
    low, high = (float(f(np.concatenate(places))) for f in (np.min, np.max))
    margin = SURE_DEVIATIONS * noise + _SAME_PLACE * (high - low) + slack
    farthest = float(max(_medians(a).max() for a in places))
    between_ends = (low + max(3.0 * margin, 0.05 * (high - low)), end - max(3.0 * margin, 0.05 * (high - low)))
    steps = [a[::every] for a in places]
    window = speed_window(noise, np.concatenate([np.abs(np.diff(a)) for a in steps]))
    least = SURE_DEVIATIONS * noise * np.sqrt(2.0 / window) / window
    motions = [_motion_between(p[::every], a, between_ends, window, least) for p, a in zip(pushes, steps, strict=True)]
    voltages, speed, place = (np.concatenate([part[k] for part in motions]) for k in range(3))
    moving = speed > least
    moves = _moving_voltage(voltages, moving)
    if np.isfinite(moves):  # a sweep shows it late: the joint crosses its backlash, and answers after its delay
        moves = min(moves, (1.0 + _VOLTAGE_MARGIN) * max(breakaway, 0.0))
    free = _FreeMotion(voltages[moving], speed[moving] / every, place[moving])
    visits: list[Visit] = []
    for p, a in zip(pushes, places, strict=True):
        visits += _visits(p, a, end - margin, moves, free, noise, np.isfinite(breakaway), max(_SETTLING_SAMPLES, every))
    rests = max((v.reading for v in visits), default=farthest)
    beyond = (
        farthest - end > margin or farthest - rests > _REST_TOLERANCE * noise + 0.5 * _SAME_PLACE * (high - low) + slack
    )
    visits = [Visit(v.first, v.last, outward * v.reading, v.push, v.speed) for v in visits]
    test = StopTest(False, "", tuple(visits), outward * farthest, moves)
    reason = _missing_evidence(test, beyond)
    return StopTest(not reason, reason, tuple(visits), outward * farthest, moves)


@dataclass(frozen=True)
class _FreeMotion:
    """Voltage, speed and place (n,) where the joint moves outward between its ends."""

    held: np.ndarray
    speed: np.ndarray
    place: np.ndarray

    def usual(self, level: float) -> float:
        """Speed at about the voltage `level`, or at any where there was no such voltage."""
        at_level = (self.held > 0.8 * level) & (self.held < 1.1 * level)
        return float(np.median(self.speed[at_level] if at_level.any() else self.speed))

    def trend(self, level: float, place: float) -> float:
        """Speed at a voltage and place by a plane through the speeds in the outer half; a load moves it with place."""
        outer = self.place >= np.median(self.place)
        X = np.column_stack([np.ones(outer.sum()), self.held[outer], self.place[outer]])
        plane = np.linalg.lstsq(X, self.speed[outer], rcond=1e-6)[0]
        return float(plane @ (1.0, level, place))


def _missing_evidence(test: StopTest, beyond: bool) -> str:
    """Why no stop is shown; '' if one is."""
    if not np.isfinite(test.moves):
        return "no voltage moves the joint elsewhere, so a rest shows no end stop"
    if not test.visits:
        return "the joint never rests there against a voltage that moves it elsewhere"
    if beyond:
        return "the joint is seen beyond it"
    if not test.arrivals:
        return "the joint never arrives there at speed"
    return ""


def _medians(y: np.ndarray) -> np.ndarray:
    """Medians of three, so that a single reading is no place."""
    return np.median(np.stack([y[:-2], y[1:-1], y[2:]]), axis=0) if len(y) > 2 else y


def speed_window(noise: float, steps: np.ndarray) -> int:
    """Samples to each side that tell a fifth of the usual speed from noise."""
    large = steps[steps > SURE_DEVIATIONS * np.sqrt(2.0) * noise]
    if not len(large):
        large = np.quantile(steps, [0.9]) if len(steps) else np.zeros(1)
    usual = float(np.median(large))
    for m in range(1, 25):
        if SURE_DEVIATIONS * noise * np.sqrt(2.0 / m) / m < 0.2 * usual:
            return m
    return 25


def mean_speeds(a: np.ndarray, m: int) -> np.ndarray:
    """Speed [y per sample] at the samples m to N - m: mean of the m next less that of the m last; none in fewer than
    2 m samples."""
    if len(a) < 2 * m:
        return np.zeros(0)
    mean = np.convolve(a, np.ones(m) / m, "valid")
    return (mean[m:] - mean[:-m]) / m


def _motion_between(
    push: np.ndarray, place: np.ndarray, between: tuple[float, float], m: int, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voltage, speed, place at the samples with a place `between`; of changing voltages the largest where the joint is
    faster than `least`, which a smaller one may not have moved, else the smallest, which may not have acted long."""
    speed = mean_speeds(place, m)
    samples = np.arange(m, m + len(speed))
    recent_pushes = np.stack([push[np.clip(samples + k, 0, len(push) - 1)] for k in range(-_HELD_SAMPLES, m)])
    is_between = (place[samples] > between[0]) & (place[samples] < between[1])
    return (
        np.where(speed > least, recent_pushes.max(axis=0), recent_pushes.min(axis=0))[is_between],
        speed[is_between],
        place[samples][is_between],
    )


def _moving_voltage(held: np.ndarray, moving: np.ndarray) -> float:
    """Least voltage that moves the joint elsewhere: above it nearly every sample moves, and it exceeds by a margin the
    largest below it that does not."""
    order = np.argsort(-held, kind="stable")
    share = np.cumsum(moving[order]) / np.arange(1, len(order) + 1)
    good = np.flatnonzero((share >= _MOVING_SHARE) & moving[order])
    if not len(good) or good[-1] + 1 < _FEWEST_SAMPLES:
        return np.inf
    voltage = float(held[order][good[-1]])
    resting_voltages = held[~moving & (held < voltage)]
    return (
        max(voltage, float(resting_voltages.max()) + _VOLTAGE_MARGIN * abs(float(resting_voltages.max())))
        if len(resting_voltages)
        else voltage
    )


def _visits(
    push: np.ndarray,
    place: np.ndarray,
    near: float,
    moves: float,
    free: _FreeMotion,
    noise: float,
    load_known: bool,
    settling: int,
) -> list[Visit]:
    """Rests above the place `near` under a voltage that moves the joint elsewhere; `moves` allows for a known load.

    A rest begins `settling` samples after the joint has come and the voltage too.
    """
    visits: list[Visit] = []
    if not np.isfinite(moves):
        return visits
    least = moves - _SAME_LEVEL * float(np.abs(push).max())
    is_pushed = np.concatenate([[False], (place >= near) & (push >= least), [False]])
    edges = np.flatnonzero(np.diff(is_pushed.astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        rest = place[first + settling : last]
        if len(rest) < REST_SAMPLES:
            continue
        half = len(rest) // 2
        drift, visible_drift = (
            abs(float(rest[half:].mean() - rest[:half].mean())),
            SURE_DEVIATIONS * noise * np.sqrt(2.0 / half),
        )
        level = float(np.median(push[first:last]))
        usual = free.usual(level)
        if drift > visible_drift or half * usual < 2.0 * visible_drift:  # a slow motion may look like it
            continue
        if not load_known and free.trend(level, float(rest.mean())) < _AT_SPEED * usual:  # a load may hold it
            continue
        speed = _arrival(push, place, int(first), near, free)
        visits.append(Visit(int(first), int(last), float(rest.mean()), level, speed))
    return visits


def _arrival(push: np.ndarray, place: np.ndarray, first: int, near: float, free: _FreeMotion) -> float:
    """Speed just before the sample `first` as a share of that elsewhere at the same voltage; 0 without an approach."""
    lookback = 2
    if first < lookback or place[first - 1] >= near:
        return 0.0
    came = float(place[first] - place[first - lookback]) / lookback
    usual = free.usual(float(np.median(push[first - lookback : first + 1])))
    return max(came / usual, 0.0) if usual > 0.0 else 0.0
