"""What a joint's record shows without a model: noise, rests against an end, starts from rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import IOData

_HELD = 3  # samples that a voltage must have acted, so that delay and lag are over
_REST = 3  # samples of a rest
_SETTLE = 2  # samples after an arrival that are no reading of the end
_SURE = 4.0  # standard deviations of a speed or place that noise does not explain
_WITHIN = 3.0  # standard deviations between the rest that is farthest out and any reading
_NEAR = 0.01  # of the range seen: rests that are this close are at one place
_MOVES = 0.95  # share of the samples at a voltage that must move the joint
_ABOVE = 0.1  # of the voltage that moves the joint, by which a rest must exceed it
_SAME = 0.01  # of the largest voltage: levels this close are one
_CODES = 10  # different readings: fewer do not show the step of a converter
_FEW = 2  # samples elsewhere from which that voltage is read
_AT_SPEED = 0.3  # of the speed elsewhere at this voltage
_SLOW = 0.5  # of a voltage: a slower rise while the joint starts brackets it
_LATE = 2  # samples of delay


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


def noise_level(y: np.ndarray) -> float:
    """Standard deviation of white noise and rounding in y (N,): second differences take a steady motion out."""
    second = np.diff(np.ravel(y), 2)
    return max(float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0)), rounding(y))


def rounding(y: np.ndarray) -> float:
    """Standard deviation of the rounding of y (N,) to the steps of a converter; 0 where no step is seen."""
    seen = np.unique(y)
    return float(np.diff(seen).min()) / np.sqrt(12.0) if len(seen) >= _CODES else 0.0


def rising(u: np.ndarray, y: np.ndarray) -> float:
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
) -> StopTest:
    """Whether the record u, y (N,) shows a stop at the place `end` [y]; several experiments are lists of arrays.

    A stop is met if the joint arrives there at speed, rests there against voltages that move it elsewhere and would
    move it on by the trend of its speeds over voltage and place, and is never seen beyond. A rest by friction lacks the
    voltage, a turn lacks the rest, and a spring or a growing load lacks speed. outward: 1 for an upper, -1 for a lower
    end; noise [y]: its standard deviation, see `noise_level`; slack [y]: a backlash, by which rests at one end may
    differ.
    """
    us, ys = ([np.ravel(a) for a in (x if isinstance(x, list | tuple) else [x])] for x in (u, y))
    way = outward * rising(np.concatenate(us), np.concatenate(ys))
    pushes, places = [way * a for a in us], [outward * a for a in ys]
    end = outward * end
    low, high = (float(f(np.concatenate(places))) for f in (np.min, np.max))
    near = _SURE * noise + _NEAR * (high - low) + slack
    farthest = float(max(_smooth(a).max() for a in places))
    away = (low + max(3.0 * near, 0.05 * (high - low)), end - max(3.0 * near, 0.05 * (high - low)))
    window = _window(noise, np.concatenate([np.abs(np.diff(a)) for a in places]))
    least = _SURE * noise * np.sqrt(2.0 / window) / window
    elsewhere = [_elsewhere(p, a, away, window, least) for p, a in zip(pushes, places, strict=True)]
    held, speed, place = (np.concatenate([part[k] for part in elsewhere]) for k in range(3))
    moving = speed > least
    moves = _moving_from(held, moving)
    free = _Free(held[moving], speed[moving], place[moving])
    visits: list[Visit] = []
    for p, a in zip(pushes, places, strict=True):
        visits += _visits(p, a, end - near, moves, free, noise)
    rests = max((v.reading for v in visits), default=farthest)
    beyond = farthest - end > near or farthest - rests > _WITHIN * noise + 0.5 * _NEAR * (high - low) + slack
    visits = [Visit(v.first, v.last, outward * v.reading, v.push, v.speed) for v in visits]
    found = StopTest(False, "", tuple(visits), outward * farthest, moves)
    why = _missing(found, beyond)
    return StopTest(not why, why, tuple(visits), outward * farthest, moves)


@dataclass(frozen=True)
class _Free:
    """Voltage, speed and place (n,) where the joint moves outward between its ends."""

    held: np.ndarray
    speed: np.ndarray
    place: np.ndarray

    def usual(self, level: float) -> float:
        """Speed at about the voltage `level`, or at any where there was no such voltage."""
        same = (self.held > 0.8 * level) & (self.held < 1.1 * level)
        return float(np.median(self.speed[same] if same.any() else self.speed))

    def trend(self, level: float, place: float) -> float:
        """Speed at a voltage and place by a plane through the speeds in the outer half; a load moves it with place."""
        outer = self.place >= np.median(self.place)
        X = np.column_stack([np.ones(outer.sum()), self.held[outer], self.place[outer]])
        plane = np.linalg.lstsq(X, self.speed[outer], rcond=1e-6)[0]
        return float(plane @ (1.0, level, place))


def _missing(found: StopTest, beyond: bool) -> str:
    """Why no stop is shown; '' if one is."""
    if not np.isfinite(found.moves):
        return "no voltage moves the joint elsewhere, so a rest shows no stop"
    if not found.visits:
        return "the joint never rests there against a voltage that moves it elsewhere"
    if beyond:
        return "the joint is seen beyond it"
    if not found.arrivals:
        return "the joint never arrives there at speed"
    return ""


def _smooth(y: np.ndarray) -> np.ndarray:
    """Medians of three, so that a single reading is no place."""
    return np.median(np.stack([y[:-2], y[1:-1], y[2:]]), axis=0) if len(y) > 2 else y


def _window(noise: float, steps: np.ndarray) -> int:
    """Samples to each side that tell a fifth of the usual speed from noise."""
    large = steps[steps > _SURE * np.sqrt(2.0) * noise]
    if not len(large):
        large = np.quantile(steps, [0.9]) if len(steps) else np.zeros(1)
    usual = float(np.median(large))
    for m in range(1, 25):
        if _SURE * noise * np.sqrt(2.0 / m) / m < 0.2 * usual:
            return m
    return 25


def _speed(a: np.ndarray, m: int) -> np.ndarray:
    """Speed [y per sample] at the samples m to N - m: mean of the m next less that of the m last; none in fewer than
    2 m samples."""
    if len(a) < 2 * m:
        return np.zeros(0)
    mean = np.convolve(a, np.ones(m) / m, "valid")
    return (mean[m:] - mean[:-m]) / m


def _elsewhere(
    push: np.ndarray, place: np.ndarray, between: tuple[float, float], m: int, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voltage, speed, place at the samples with a place `between`; of changing voltages the largest where the joint is
    faster than `least`, which a smaller one may not have moved, else the smallest, which may not have acted long."""
    speed = _speed(place, m)
    at = np.arange(m, m + len(speed))
    around = np.stack([push[np.clip(at + k, 0, len(push) - 1)] for k in range(-_HELD, m)])
    there = (place[at] > between[0]) & (place[at] < between[1])
    return np.where(speed > least, around.max(axis=0), around.min(axis=0))[there], speed[there], place[at][there]


def _moving_from(held: np.ndarray, moving: np.ndarray) -> float:
    """Least voltage that moves the joint elsewhere: above it nearly every sample moves, and it exceeds by a margin the
    largest below it that does not."""
    order = np.argsort(-held, kind="stable")
    share = np.cumsum(moving[order]) / np.arange(1, len(order) + 1)
    good = np.flatnonzero((share >= _MOVES) & moving[order])
    if not len(good) or good[-1] + 1 < _FEW:
        return np.inf
    found = float(held[order][good[-1]])
    below = held[~moving & (held < found)]
    return max(found, float(below.max()) + _ABOVE * abs(float(below.max()))) if len(below) else found


def _visits(push: np.ndarray, place: np.ndarray, near: float, moves: float, free: "_Free", noise: float) -> list[Visit]:
    """Rests above the place `near` under a voltage that moves the joint elsewhere."""
    found: list[Visit] = []
    if not np.isfinite(moves):
        return found
    least = moves - _SAME * float(np.abs(push).max())
    at = np.concatenate([[False], (place >= near) & (push >= least), [False]])
    edges = np.flatnonzero(np.diff(at.astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        rest = place[first + _SETTLE : last]
        if len(rest) < _REST:
            continue
        half = len(rest) // 2
        drift, seen = abs(float(rest[half:].mean() - rest[:half].mean())), _SURE * noise * np.sqrt(2.0 / half)
        level = float(np.median(push[first:last]))
        usual = free.usual(level)
        if drift > seen or half * usual < 2.0 * seen:  # a slow motion may look like it
            continue
        if free.trend(level, float(rest.mean())) < _AT_SPEED * usual:  # a load may hold it
            continue
        speed = _arrival(push, place, int(first), near, free)
        found.append(Visit(int(first), int(last), float(rest.mean()), level, speed))
    return found


def _arrival(push: np.ndarray, place: np.ndarray, first: int, near: float, free: "_Free") -> float:
    """Speed just before the sample `first` as a share of that elsewhere at the same voltage; 0 without an approach."""
    back = 2
    if first < back or place[first - 1] >= near:
        return 0.0
    came = float(place[first] - place[first - back]) / back
    usual = free.usual(float(np.median(push[first - back : first + 1])))
    return max(came / usual, 0.0) if usual > 0.0 else 0.0


@dataclass(frozen=True)
class Started:
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
        return 0.0 < abs(self.moved - self.held) <= _SLOW * max(abs(self.moved), abs(self.held))


def starts_from_rest(data: IOData, noise: float, every: int = 1) -> list[Started]:
    """Every start from rest of a record, read in means of `every` samples; `way` is the direction of y.

    The joint is seen to have moved when it is `_SURE` standard deviations from its rest. Under a rising voltage its way
    grows with the square of time or faster, so it began at most twice as long before as a quarter of this way was
    passed, which is no later than it was last seen behind its rest.
    """
    # At rest one and the same rounding error is in every reading.
    noise = max(noise / np.sqrt(every), *(rounding(record.y) for record in data.experiments))
    found = []
    sign = rising(*(np.concatenate([getattr(r, k)[:, 0] for r in data.experiments]) for k in ("u", "y")))
    for k, record in enumerate(data.experiments):
        n = record.N // every
        u, y = (part[: n * every, 0].reshape(n, every) for part in (sign * record.u, record.y))
        y = y.mean(axis=1)
        m = max(_window(noise, np.abs(np.diff(y))), 2)
        if n < 2 * m:  # no speed is seen in so few readings
            continue
        speed = np.concatenate([np.zeros(m), _speed(y, m), np.zeros(m - 1)])
        still = np.abs(speed) < _SURE * noise * np.sqrt(2.0 / m) / m
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        ends = [*edges[2::2], len(y)][: len(edges) // 2]  # a record that never rests has none
        for first, last, following in zip(edges[::2], edges[1::2], ends, strict=True):
            if last - first >= _REST + m and last < len(y):
                start = _start(u, y, noise, (int(first), int(last), int(following)), int(np.sign(speed[last])))
                if start is not None:
                    sample, place, held, moved = start
                    way = int(np.sign(speed[last]))
                    found.append(
                        Started(
                            k, every * int(first), every * sample, way, place, way * sign * held, way * sign * moved
                        )
                    )
    return found


def _start(
    inputs: np.ndarray, y: np.ndarray, noise: float, around: tuple[int, int, int], way: int
) -> tuple[int, float, float, float] | None:
    """Sample at which a start is seen, place of the rest, and voltages before and at it, positive towards `way`; None
    if the joint drifts instead of resting. `inputs` (n, every) and the means y (n,) of as many readings; `around`:
    first sample of the rest, of the motion, and of the next rest."""
    u = inputs[:, 0]
    first, last, following = around
    half = max((last - first) // 2, _REST)
    quarter = max(half // 2, 1)
    rest = float(np.mean(y[first : first + half]))
    drift = abs(float(np.mean(y[first : first + quarter]) - np.mean(y[first + half - quarter : first + half])))
    if drift > _SURE * noise * np.sqrt(2.0 / quarter):
        return None
    gone = way * (np.convolve(y, np.ones(3) / 3, "same") - rest)[first : min(following + 1, len(y) - 1)]
    far = np.flatnonzero(gone > _SURE * noise)
    far = far[far >= half]
    if not len(far):
        return None
    close = np.flatnonzero(gone[: far[0]] <= 0.0)
    seen, passed = first + int(far[0]), first + (int(close[-1]) if len(close) else 0)
    before = max(passed - (seen - passed) - _LATE, first)
    still = before + 1
    if u[before] in (u[before - 1], u[before + 1]):  # under a steady voltage it starts at once or never
        while still > first + 1 and u[still - 1] == u[before]:
            still -= 1
    held, moved = float((way * u)[first:still].max()), float((way * inputs)[before : seen + 1].max())
    return seen, rest, min(held, moved), moved
