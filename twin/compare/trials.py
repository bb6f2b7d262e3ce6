"""The twin's response to a log's input with any knobs moved; what was simulated once is kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.base.errors import InputError
from twin.compare.knobs import READ, SLOPE, START, ZERO, Knob, knobs, moved
from twin.follow import Follower
from twin.parameters import Parameters

Values = Mapping[str, float]
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
    _courses: dict[tuple, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        f = self.follower
        first = (float(f.y[0]) - self.read.get(ZERO, 0.0)) / self.read.get(SLOPE, 1.0)
        found = knobs(self.parameters, f.joint, first, float(np.abs(f.u).max()))
        self.knobs = found | {name: replace(found[name], nominal=value) for name, value in self.read.items()}

    def rows(self, states: Sequence[Values]) -> np.ndarray:
        """Readings (states, N) [rad]; NaN where no such twin exists or its simulation fails."""
        keys = [self._key(state) for state in states]
        wanted = {key: state for key, state in zip(keys, states, strict=True) if key not in self._courses}
        self._simulate(wanted)
        return np.stack([self._read(self._courses[key], state) for key, state in zip(keys, states, strict=True)])

    def _key(self, state: Values) -> tuple:
        own = {name: value for name, value in state.items() if name not in READ and value != self.knobs[name].nominal}
        return tuple(sorted(own.items()))

    def _simulate(self, wanted: Mapping[tuple, Values]) -> None:
        """Run those that are not known yet."""
        able = {}
        for key in wanted:
            try:
                able[key] = moved(self.parameters, self.follower.joint, dict(key))
            except InputError:
                self._courses[key] = np.array([np.nan, np.nan])
        order = list(able)
        for k in range(0, len(order), MOST):
            part = order[k : k + MOST]
            starts = [dict(key).get(START, self.knobs[START].nominal) for key in part]
            found = self.follower.courses([able[key] for key in part], starts)
            self.simulated += len(part)
            self._courses |= dict(zip(part, found.astype(np.float32), strict=True))

    def _read(self, course: np.ndarray, state: Values) -> np.ndarray:
        late, slope, zero = (state.get(name, self.knobs[name].nominal) for name in READ)
        return slope * self.follower.at(course, late) + zero
