"""Least squares in the parameters of a simulation: several records, and a Jacobian from one batch for each record."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.base.errors import InputError

# RMS change of the response that a step of the Jacobian aims at, in multiples of the noise. The shoulder's response
# jumps by 0.03 degrees RMS, because the board reads limit switches once in 10 ms; below 0.2 they hide the slope.
LEVEL = 1.5
BAND = 5.0  # a step whose change is this factor off the aim is corrected and simulated again
ROUNDS = 4  # simulations of one Jacobian, at most
CHANGE = 30.0  # of a step, from one round to the next
SMALLEST, LARGEST = 1e-5, 2.0  # of a step, in scales
SAME = 0.5  # of the noise: within this RMS change of the response the Jacobian is the same; its own steps are longer
FARTHEST = 100.0  # [log of scales] a value beyond which no simulation runs; its exponential is still a number
KEPT = 0.5  # of the promised fall of the loss
_NORMAL = 0.6745  # median of the absolute value of a standard normal number


@dataclass(frozen=True)
class Free:
    """A parameter to calibrate [unit], searched from `start` within `lower` and `upper`.

    `scale` is the size of a change that is plausible before the record is seen. A parameter that cannot be negative is
    searched in log(1 + value / scale): steps are relative far above the scale, and absolute near 0, so that a friction
    or a dead zone can leave 0. Others are searched in value / scale. `step` is the first one of the Jacobian in that
    coordinate; later ones adapt. Raises InputError for a start outside the bounds.
    """

    name: str
    start: float
    lower: float
    upper: float
    unit: str
    scale: float
    step: float = 0.05

    def __post_init__(self) -> None:
        if not (self.scale > 0.0 and self.lower < self.upper):
            raise InputError(
                f"{self.name}: scale {self.scale:g}, bounds {self.lower:g} to {self.upper:g}; give a range"
            )
        if not self.lower <= self.start <= self.upper:
            raise InputError(
                f"{self.name} starts at {self.start:g} {self.unit}; give a start from {self.lower:g} to {self.upper:g}"
            )

    def inner(self, value: float | np.ndarray) -> np.ndarray:
        """The coordinate of the search."""
        ratio = np.asarray(value, dtype=float) / self.scale
        return np.log1p(ratio) if self.lower >= 0.0 else ratio

    def outer(self, z: float | np.ndarray) -> np.ndarray:
        """The value at a coordinate of the search, within the bounds."""
        z = np.minimum(z, self.inner(self.upper))  # the end of a wide interval may be more than a number holds
        ratio = np.expm1(np.minimum(z, FARTHEST)) if self.lower >= 0.0 else z
        return np.clip(self.scale * ratio, self.lower, self.upper)

    def slope(self, value: float) -> float:
        """d value / d coordinate at `value`."""
        return self.scale + value if self.lower >= 0.0 else self.scale


@dataclass(frozen=True)
class Record:
    """A measured response y (N,), NaN where it is not scored, and the simulation of it.

    `respond` turns parameters (runs, P + own) into responses (runs, N) in the unit of y, all in one batch: the
    parameters that all records share, then those of this record alone (`own`), for example its initial state. A row of
    NaN is a failed simulation.
    """

    name: str
    y: np.ndarray
    Ts: float
    respond: Callable[[np.ndarray], np.ndarray] = field(repr=False)
    own: tuple[Free, ...] = ()

    @property
    def scored(self) -> np.ndarray:
        """Which samples are scored (N,)."""
        return np.isfinite(self.y)


def noise_of(y: np.ndarray) -> float:
    """Standard deviation of white noise on a slow signal y (N,), from the median size of its second differences.

    A second difference of white noise has the variance 6 sigma^2. A signal that is constant most of the time (rounded
    by a converter) has no median; its RMS is taken then.
    """
    bends = np.diff(y[np.isfinite(y)], 2)
    middle = float(np.median(np.abs(bends))) / _NORMAL if len(bends) else 0.0
    spread = middle if middle > 0.0 else float(np.sqrt(np.mean(bends**2))) if len(bends) else 0.0
    return max(spread / np.sqrt(6.0), 1e-5 * float(np.nanmax(y) - np.nanmin(y)), 1e-12)


class Simulations:
    """A `sysid.solver.iterate.Problem`: the shared parameters, then the own parameters of each record, as coordinates.

    Forward differences, or central ones if `central`. Their steps change the response by `LEVEL` times the noise (RMS
    over the records in which the parameter acts). A much smaller step would see nothing where dry friction or a stop
    holds the joint; a much larger one would leave the range of the linear model. The steps adapt from one Jacobian to
    the next. At a bound, a step points inward.
    """

    def __init__(self, shared: Sequence[Free], records: Sequence[Record], noise: float | None = None) -> None:
        if not records:
            raise InputError("there is no record; give at least one")
        self.shared, self.records = tuple(shared), tuple(records)
        self.free = (*self.shared, *(parameter for record in records for parameter in record.own))
        ends = len(self.shared) + np.cumsum([len(record.own) for record in records])
        self.own = [np.arange(end - len(r.own), end) for r, end in zip(records, ends, strict=True)]
        self.low, self.high = (np.array([f.inner(getattr(f, name)) for f in self.free]) for name in ("lower", "upper"))
        self.noise = noise if noise is not None else float(np.median([noise_of(record.y) for record in records]))
        self.steps = np.array([f.step for f in self.free])
        self.central = False
        self.simulations = 0
        self._known: dict[bytes, list[np.ndarray]] = {}
        self._linear: tuple[bool, list[np.ndarray], np.ndarray] | None = None

    def take_over(self, p: np.ndarray, responses: list[np.ndarray], J: np.ndarray | None = None) -> None:
        """Take over responses, and a Jacobian (N, n), that another problem has simulated at p."""
        self._known[p.tobytes()] = responses
        if J is not None:
            self._linear = self.central, responses, J

    @property
    def start(self) -> np.ndarray:
        """Coordinates of the start (n,)."""
        return np.array([float(f.inner(f.start)) for f in self.free])

    def values(self, p: np.ndarray) -> np.ndarray:
        """Physical values (n,) at coordinates p (n,)."""
        return np.array([float(f.outer(z)) for f, z in zip(self.free, p, strict=True)])

    def spreads(self, p: np.ndarray) -> np.ndarray:
        """One scale of each parameter as a coordinate (n,), at p (n,)."""
        return np.array([f.scale for f in self.free]) / self.slopes(p)

    def slopes(self, p: np.ndarray) -> np.ndarray:
        """d value / d coordinate (n,)."""
        return np.array([f.slope(value) for f, value in zip(self.free, self.values(p), strict=True)])

    @property
    def size(self) -> float:
        """y'y of the scored samples."""
        return float(sum(np.sum(record.y[record.scored] ** 2) for record in self.records))

    @property
    def spread(self) -> float:
        """Sum of squares of the scored samples about the mean of their record."""
        return float(sum(np.sum((r.y[r.scored] - r.y[r.scored].mean()) ** 2) for r in self.records))

    @property
    def lengths(self) -> list[int]:
        """Scored samples of each record."""
        return [int(record.scored.sum()) for record in self.records]

    def responses(self, points: np.ndarray) -> list[np.ndarray]:
        """Responses (m, N) of each record at coordinates `points` (m, n)."""
        return [self._respond(k, points) for k in range(len(self.records))]

    def _respond(self, k: int, points: np.ndarray) -> np.ndarray:
        columns = [*range(len(self.shared)), *self.own[k]]
        values = np.column_stack([self.free[j].outer(points[:, j]) for j in columns])
        self.simulations += len(points)
        return self.records[k].respond(values)

    def responses_at(self, p: np.ndarray) -> list[np.ndarray]:
        """Responses (N,) of each record at p, simulated once."""
        key = p.tobytes()
        if key not in self._known:
            while len(self._known) > 8:
                self._known.pop(next(iter(self._known)))
            self._known[key] = [rows[0] for rows in self.responses(p[None])]
        return self._known[key]

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """y - yhat of the scored samples of all records; None if a simulation failed."""
        e = self._residuals(self.responses_at(p))
        return e if np.all(np.isfinite(e)) else None

    def losses(self, points: np.ndarray) -> np.ndarray:
        """Sum of squares (m,) at coordinates `points` (m, n), in one batch; infinite where a simulation failed."""
        pairs = zip(self.records, self.responses(points), strict=True)
        total = sum(np.sum((record.y - rows)[:, record.scored] ** 2, axis=1) for record, rows in pairs)
        return np.where(np.isfinite(total), total, np.inf)

    def repair(self, p: np.ndarray) -> np.ndarray:
        """p within the bounds."""
        return np.clip(p, self.low, self.high)

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """True (n,) where p is at a bound and descent points beyond it; `gradient` is J'e, the direction of descent."""
        return ((p <= self.low) & (gradient < 0.0)) | ((p >= self.high) & (gradient > 0.0))

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dp (N, n) of the scored samples."""
        e = self.residual(p)
        assert e is not None  # a search only linearises where it found a loss
        if self._linear is None or not self._same(p):
            self._linear = self.central, self.responses_at(p), self.columns(p, range(len(p)))
        return e, self._linear[2]

    def _same(self, p: np.ndarray) -> bool:
        """Whether the last Jacobian serves at p too: p is near, and the loss has fallen as it promised."""
        assert self._linear is not None
        central, responses, J = self._linear
        if central != self.central:
            return False
        old, e = self._residuals(responses), self._residuals(self.responses_at(p))
        if np.sum((e - old) ** 2) > len(e) * (SAME * self.noise) ** 2:
            return False
        promise = np.sum((np.linalg.qr(J)[0].T @ old) ** 2)
        return bool(old @ old - e @ e >= KEPT * promise)

    def _residuals(self, responses: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([(r.y - row)[r.scored] for r, row in zip(self.records, responses, strict=True)])

    def columns(self, p: np.ndarray, indices: Sequence[int]) -> np.ndarray:
        """Columns `indices` of dyhat/dp (N, which) at p (n,).

        Those whose step changed the response by far too little or too much are simulated again.
        """
        base, todo, aim = self.responses_at(p), list(indices), LEVEL * self.noise
        J = np.zeros((sum(self.lengths), len(p)))
        for round_ in range(ROUNDS):
            steps = self._signed_steps(p, todo)
            changes = self._changes(p, base, todo, steps)
            if self.central:
                steps, changes = self._both_sides(p, base, todo, steps, changes)
            sizes = np.array([self._size(j, column) for j, column in zip(todo, changes.T, strict=True)])
            J[:, todo] = np.where(np.isfinite(changes), changes, 0.0) / steps
            wide = np.abs(steps) / self.steps[todo]  # about 2 for central differences, less near a bound
            ratio = np.where(np.isfinite(sizes), sizes, np.inf) / (aim * wide)
            factor = np.clip(1.0 / np.maximum(ratio, 1e-9), 1.0 / CHANGE, CHANGE)
            old_steps = self.steps[todo]
            self.steps[todo] = np.clip(old_steps * factor, SMALLEST, LARGEST)
            outside_band = (ratio > BAND) | (ratio < 1.0 / BAND)
            redo = (
                outside_band & (np.abs(np.log(self.steps[todo] / old_steps)) > 0.1)
                if round_ < ROUNDS - 1
                else outside_band & False
            )
            todo = [j for j, repeat in zip(todo, redo, strict=True) if repeat]
            if not todo:
                break
        return J[:, list(indices)]

    def _signed_steps(self, p: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Signed steps of the columns; to the side with more room where the bound is near."""
        h, room_above, room_below = self.steps[columns], (self.high - p)[columns], (p - self.low)[columns]
        sign = np.where((h <= room_above) | (room_above >= room_below), 1.0, -1.0)
        return sign * np.minimum(h, np.maximum(room_above, room_below))

    def _both_sides(
        self, p: np.ndarray, base: list[np.ndarray], columns: Sequence[int], steps: np.ndarray, changes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steps and changes from the point as far on the other side; one-sided where a bound leaves no room for it."""
        room = np.where(steps > 0.0, (p - self.low)[columns], (self.high - p)[columns])
        opposite = -np.sign(steps) * np.minimum(np.abs(steps), room)
        two = np.flatnonzero(np.abs(opposite) > 0.5 * np.abs(steps))
        if len(two):
            opposite_changes = self._changes(p, base, [columns[int(i)] for i in two], opposite[two])
            steps, changes = steps.copy(), changes.copy()
            steps[two], changes[:, two] = steps[two] - opposite[two], changes[:, two] - opposite_changes
        return steps, changes

    def _changes(self, p: np.ndarray, base: list[np.ndarray], columns: Sequence[int], steps: np.ndarray) -> np.ndarray:
        """Changes (N, columns) of the scored responses; 0 in the records in which a parameter does not act."""
        out = []
        for k, record in enumerate(self.records):
            acts = [i for i, j in enumerate(columns) if j < len(self.shared) or j in self.own[k]]
            change = np.zeros((int(record.scored.sum()), len(columns)))
            if acts:
                points = np.repeat(p[None], len(acts), axis=0)
                points[range(len(acts)), [columns[i] for i in acts]] += steps[acts]
                change[:, acts] = (self._respond(k, points) - base[k])[:, record.scored].T
            out.append(change)
        return np.concatenate(out)

    def _size(self, j: int, column: np.ndarray) -> float:
        """RMS of a change (N,) over the records in which parameter j acts."""
        acts = [j < len(self.shared) or j in indices for indices in self.own]
        return float(np.sqrt(np.sum(column**2) / sum(N for N, a in zip(self.lengths, acts, strict=True) if a)))
