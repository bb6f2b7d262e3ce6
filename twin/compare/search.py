"""Least squares over knobs: many small searches at once, with all their simulations of a round in one batch."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.base.errors import InputError
from twin.compare.effects import READ, SLOPE, START, ZERO, Knob, apply_knobs, knobs
from twin.compare.structures import STRUCTURES, Structure
from twin.follow import Follower
from twin.parameters import Parameters
from twin.plant.added import NOTHING, Added, Grid, grid

Values = Mapping[str, float]
# These need no simulation of their own: they change how a course is read.
_READ = (*READ, *(name for structure in STRUCTURES.values() if structure.read for name in structure.knobs))
MOST = 24  # simulations in one batch: limits the memory in use


@dataclass
class Trials:
    """Responses of the twin of a `follower` with `parameters`, by values of knobs; knobs not named are nominal.

    `read` are nominal values of "delay", "slope" and "zero": how the log is taken to be read.
    """

    follower: Follower
    parameters: Parameters
    read: Values = field(default_factory=dict)
    knobs: dict[str, Knob] = field(init=False)
    simulated: int = field(default=0, init=False)
    _grid: Grid = field(init=False, repr=False)
    _courses: dict[tuple, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        f = self.follower
        first = (float(f.y[0]) - self.read.get(ZERO, 0.0)) / self.read.get(SLOPE, 1.0)
        table = knobs(self.parameters, f.joint, first, float(np.abs(f.u).max()))
        table |= {row.name: row for structure in STRUCTURES.values() for row in structure.rows}
        self._grid = grid(self.parameters, f.joint, f.log.N * f.log.Ts)
        self.knobs = table | {name: replace(table[name], nominal=value) for name, value in self.read.items()}

    def rows(self, states: Sequence[Values]) -> np.ndarray:
        """Readings (states, N) [rad]; NaN where no such twin exists or its simulation fails."""
        keys = [self._key(state) for state in states]
        missing = {key: state for key, state in zip(keys, states, strict=True) if key not in self._courses}
        self._simulate(missing)
        return np.stack([self._read(self._courses[key], state) for key, state in zip(keys, states, strict=True)])

    def _key(self, state: Values) -> tuple:
        changes = {
            name: value for name, value in state.items() if name not in _READ and value != self.knobs[name].nominal
        }
        return tuple(sorted(changes.items()))

    def _simulate(self, missing: Mapping[tuple, Values]) -> None:
        """Run those that are not known yet."""
        able = {}
        for key in missing:
            try:
                able[key] = apply_knobs(self.parameters, self.follower.joint, dict(key))
            except InputError:
                self._courses[key] = np.array([np.nan, np.nan])
        order = list(able)
        for k in range(0, len(order), MOST):
            part = order[k : k + MOST]
            starts = [dict(key).get(START, self.knobs[START].nominal) for key in part]
            courses = self.follower.courses(
                [able[key] for key in part], starts, [self._added(dict(key)) for key in part]
            )
            self.simulated += len(part)
            self._courses |= dict(zip(part, courses.astype(np.float32), strict=True))

    def _present(self, state: Values) -> Iterator[tuple[Structure, dict[str, float]]]:
        """The structures that a state has, with the values of their knobs."""
        for structure in STRUCTURES.values():
            values = {name: state.get(name, self.knobs[name].nominal) for name in structure.knobs}
            if any(values[name] != self.knobs[name].nominal for name in structure.knobs):
                yield structure, values

    def _added(self, state: Values) -> Added:
        """What the drive has beside its parameters."""
        tables = [s.drive(self._grid, values) for s, values in self._present(state) if s.drive]
        return Added(np.sum(tables, axis=0), self._grid.spans) if tables else NOTHING

    def _read(self, course: np.ndarray, state: Values) -> np.ndarray:
        for structure, values in self._present(state):
            if structure.read and len(course) > 2:
                course = structure.read(course.astype(float), self.follower.commands[: len(course)], values)
        delay, slope, zero = (state.get(name, self.knobs[name].nominal) for name in READ)
        return slope * self.follower.sample_course(course, delay) + zero


ROUNDS = 10
_DAMPED = (0.1, 10.0)  # times the current damping: tried together
_LARGEST, _SMALLEST = 0.5, 0.05  # step of a finite difference, in typical changes of a knob
_ENOUGH = 1.0  # a search ends when N times the relative fall of the cost is below this
_SETTLED = 1.15  # times the noise: a search that ends below this has found what there is
_AGAIN, _NEAR = 3, 4.0  # further searches, for those within this factor of the least mean square error


@dataclass
class Search:
    """One search: the knobs that it may move besides the start, where it is now, and further places to begin at.

    With `expected` each of these knobs counts as one more reading, of its nominal value: the data decide where they
    can, and a knob along which they are flat stays near what is known of it.
    """

    name: str
    knobs: tuple[str, ...]
    state: dict[str, float] = field(default_factory=dict)
    cost: float = np.inf
    damping: float = 0.01
    last: np.ndarray | None = None  # the last step, in typical changes
    done: bool = False
    tries: tuple[dict[str, float], ...] = ()
    expected: Mapping[str, float] = field(default_factory=dict)  # how far knobs may be from nominal, standard deviation
    noise: float = 0.0  # variance of the noise, against which `expected` counts
    others: list[dict[str, float]] = field(default_factory=list)  # places that were tried first, the better ones first

    @property
    def free(self) -> tuple[str, ...]:
        """Names of everything that moves."""
        return (START, *self.knobs)


def fit_all(trials: Trials, searches: Sequence[Search], y: np.ndarray, rounds: int = ROUNDS) -> None:
    """Bring every search to its least mean square error (its `cost` [rad^2]) against y (N,)."""
    _scan(trials, searches, y)
    _advance(trials, searches, y, rounds)


def refine(trials: Trials, search: Search, y: np.ndarray, rounds: int = ROUNDS) -> None:
    """Bring one search from its state to its least cost, without trying other places first."""
    best_of(trials, [search], y, rounds)


def best_of(trials: Trials, searches: Sequence[Search], y: np.ndarray, rounds: int = ROUNDS) -> Search:
    """The one of lowest cost after each was brought from its state to its least cost."""
    costs = _costs(trials, [search.state for search in searches], y)
    for search, cost in zip(searches, costs, strict=True):
        search.cost = float(cost) + _surprise(trials, search, search.state) / len(y)
    _advance(trials, searches, y, rounds)
    return min(searches, key=lambda search: search.cost)


def _advance(trials: Trials, searches: Sequence[Search], y: np.ndarray, rounds: int) -> None:
    """Move all searches by up to `rounds` damped steps."""
    start = None
    for _ in range(rounds):
        active = [search for search in searches if not search.done]
        if not active:
            return
        if start is None:  # what the start does changes little from search to search, and costs each one a simulation
            start = differences(trials, [Search("", (), dict(active[0].state))])[0][:, 1]
        jacobians = differences(trials, active, start)
        proposals = [_proposals(trials, s, J, y) for s, J in zip(active, jacobians, strict=True)]
        costs = _costs(trials, [state for steps in proposals for _, state in steps], y)
        for search, steps in zip(active, proposals, strict=True):
            step_costs, costs = costs[: len(steps)], costs[len(steps) :]
            step_costs = step_costs + [_surprise(trials, search, state) / len(y) for _, state in steps]
            _move(trials, search, steps, step_costs, len(y))


def restart(trials: Trials, searches: Sequence[Search], y: np.ndarray, noise: float, rounds: int = ROUNDS) -> None:
    """Search again where a search stopped well above the noise [rad^2]; the better one stays.

    A joint that sticks or does not stick at some voltage makes valleys that a Gauss-Newton step does not leave. Each
    begins at the nominal values once more, and those near the best one at other places that were tried first.
    """
    _search_from(trials, [(search, {}) for search in searches if search.cost > _SETTLED * noise], y, rounds)
    for k in range(_AGAIN):
        limit = _NEAR * min(search.cost for search in searches)
        near = [search for search in searches if _SETTLED * noise < search.cost < limit and k < len(search.others)]
        _search_from(trials, [(search, search.others[k]) for search in near], y, rounds)


def _search_from(trials: Trials, places: Sequence[tuple[Search, dict[str, float]]], y: np.ndarray, rounds: int) -> None:
    """Search again from a place for each of some searches, which take over what is better."""
    fresh = [Search(search.name, search.knobs, dict(place)) for search, place in places]
    if not fresh:
        return
    best_of(trials, fresh, y, rounds)
    for (search, _), rival in zip(places, fresh, strict=True):
        if rival.cost < search.cost:
            search.state, search.cost, search.last = rival.state, rival.cost, rival.last


def differences(trials: Trials, searches: Sequence[Search], start: np.ndarray | None = None) -> list[np.ndarray]:
    """Derivative (N, 1 + free) of each: the response at its state, then differences per typical change.

    A step is about as long as the search's last one: dry friction and stops hide what shorter steps do. `start` (N,) is
    taken as the derivative by the start if it is given.
    """
    states, steps = [], []
    for search in searches:
        states.append(dict(search.state))
        step_sizes = []
        for j, name in enumerate(search.free):
            if name == START and start is not None:
                continue
            knob, value = trials.knobs[name], _value(trials, search.state, name)
            size = _LARGEST if search.last is None else float(np.clip(abs(search.last[j]), _SMALLEST, _LARGEST))
            step = size * knob.typical
            step = step if value + step <= knob.upper and name != "supply_voltage" else -step
            step_sizes.append(step / knob.typical)
            states.append({**search.state, name: value + step})
        steps.append(step_sizes)
    rows = trials.rows(states)
    derivatives = []
    for step_sizes in steps:
        part, rows = rows[: len(step_sizes) + 1], rows[len(step_sizes) + 1 :]
        columns = [] if start is None else [start]
        columns += [(row - part[0]) / step for row, step in zip(part[1:], step_sizes, strict=True)]
        derivatives.append(np.nan_to_num(np.column_stack([part[0], *columns])))
    return derivatives


def _scan(trials: Trials, searches: Sequence[Search], y: np.ndarray) -> None:
    """Begin each search at the best of its knobs' first changes."""
    states: list[dict[str, float]] = []
    owners: list[Search] = []
    for search in searches:
        begins = [dict(search.state), *search.tries]
        states += begins
        owners += [search] * len(begins)
        for name in search.knobs:
            knob, value = trials.knobs[name], _value(trials, search.state, name)
            for change in knob.first:
                states.append({**search.state, name: float(np.clip(value + change, knob.lower, knob.upper))})
                owners.append(search)
    costs = _costs(trials, states, y)
    for search in searches:
        mine = sorted((k for k in range(len(states)) if owners[k] is search), key=lambda k: costs[k])
        search.others = [states[k] for k in mine[1:]]
        if costs[mine[0]] < search.cost:
            search.state, search.cost = states[mine[0]], float(costs[mine[0]])


def _proposals(
    trials: Trials, search: Search, J: np.ndarray, y: np.ndarray
) -> list[tuple[np.ndarray, dict[str, float]]]:
    """Damped Gauss-Newton steps (Levenberg and Marquardt), in typical changes, and where they lead."""
    rest, columns = y - J[:, 0], J[:, 1:]
    gram, right = columns.T @ columns, columns.T @ rest
    stiff = stiffness(trials, search)
    distance = [
        (_value(trials, search.state, n) - trials.knobs[n].nominal) / trials.knobs[n].typical for n in search.free
    ]
    gram, right = gram + np.diag(stiff), right - stiff * distance
    scale = np.maximum(np.diag(gram), 1e-9 * max(float(np.diag(gram).max()), 1e-30))
    proposals = []
    for factor in _DAMPED:
        step = np.linalg.solve(gram + factor * search.damping * np.diag(scale), right)
        state = dict(search.state)
        for name, change in zip(search.free, step, strict=True):
            knob = trials.knobs[name]
            state[name] = float(np.clip(_value(trials, state, name) + change * knob.typical, knob.lower, knob.upper))
        proposals.append((step, state))
    return proposals


def stiffness(trials: Trials, search: Search) -> np.ndarray:
    """What the expected size of each free knob adds to J'J (free,), per typical change."""
    ratio = [trials.knobs[n].typical / search.expected[n] if n in search.expected else 0.0 for n in search.free]
    return search.noise * np.array(ratio) ** 2


def _surprise(trials: Trials, search: Search, state: Mapping[str, float]) -> float:
    """What the expected sizes add to the sum of squares at a state."""
    deviation = [(_value(trials, state, n) - trials.knobs[n].nominal) / std for n, std in search.expected.items()]
    return search.noise * float(np.sum(np.square(deviation)))


def _move(trials: Trials, search: Search, proposals: Sequence, costs: np.ndarray, N: int) -> None:
    """Take the best proposal into `search`, or damp the next ones more; the search ends where the fall is small."""
    best = int(np.argmin(costs))
    if costs[best] >= search.cost:
        search.damping *= 100.0
        search.last = np.full(len(search.free), _SMALLEST) if search.last is None else 0.3 * search.last
        search.done = search.damping > 1e4
        return
    fall = N * (search.cost - costs[best]) / costs[best]
    search.last, search.state = proposals[best]
    search.cost, search.damping = float(costs[best]), search.damping * _DAMPED[best]
    search.done = bool(fall < _ENOUGH)


def _costs(trials: Trials, states: Sequence[Mapping[str, float]], y: np.ndarray) -> np.ndarray:
    costs = np.mean((trials.rows(states) - y) ** 2, axis=1)
    return np.where(np.isfinite(costs), costs, np.inf)


def _value(trials: Trials, state: Mapping[str, float], name: str) -> float:
    return state.get(name, trials.knobs[name].nominal)
