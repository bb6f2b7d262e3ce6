"""A joint of the leg as a record to calibrate: what may be free, and the response to it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError, unknown
from twin.calibrate.problem import Free, Record
from twin.follow import Follower
from twin.hardware.actuator import check_rotor
from twin.hardware.linkage import end_angles
from twin.log import Log
from twin.parameters import TABLE, Parameters

START = "start"  # [rad] angle of the drive at the first sample of a run
ZERO = "zero"  # [rad] of the sensor in a run, less that in the first run
DELAY = "delay"  # continuous here: the board reads commands once in a period, and a step below that would do nothing
OFFSET = Free(ZERO, 0.0, -0.5, 0.5, "rad", np.deg2rad(1.0))
ROWS = {row.name: row for row in TABLE}

# Free unless something else is asked for: what records of voltage and angle usually tell. Each with a scale.
_COMMON: Mapping[str, float] = {
    "asymmetry": 0.15,
    "rotor_inertia": 1e-7,
    DELAY: 0.01,
    "backlash": np.deg2rad(0.25),
    "stribeck": 0.3,
    "load_friction": 0.3,
}
_ROD: Mapping[str, float] = {
    "retracted_length": 0.005,
    "stroke": 0.005,
    "no_load_speed": 0.003,
    "coulomb": 10.0,
    **_COMMON,
}
_GEARED: Mapping[str, float] = {
    "lower": np.deg2rad(5.0),
    "upper": np.deg2rad(5.0),
    "no_load_speed": 0.2,
    "coulomb": 0.3,
    **_COMMON,
    "rotor_inertia": 2e-7,
}
# First steps of the Jacobian that change the response by about the noise, in coordinates of the search.
_STEPS: Mapping[str, float] = {
    "retracted_length": 0.0015,
    "stroke": 0.01,
    "lower": 0.05,
    "upper": 0.02,
    "no_load_speed": 0.01,
    "coulomb": 0.02,
    "asymmetry": 0.1,
    "rotor_inertia": 0.3,
    DELAY: 0.4,
    "backlash": 0.5,
    "stribeck": 0.1,
    "load_friction": 0.04,
}
_SCALES: Mapping[str, float] = {"dead_band": 0.1, "supply_resistance": 0.5, "pot_linearity": 5e-4, DELAY: 0.01}


def usual(joint: str) -> tuple[str, ...]:
    """Rows that are free unless others are named, in the order in which doubtful ones are kept."""
    return tuple(name if name == DELAY else f"{joint}.{name}" for name in (_GEARED if joint == "shoulder" else _ROD))


def row_name(joint: str, name: str) -> str:
    """The row of the table that a user means by "coulomb" or "thigh.coulomb"; raises InputError for no row of it."""
    for full in (f"{joint}.{name}", name):
        if full in ROWS and full.partition(".")[0] not in {"shoulder", "thigh", "shank"} - {joint}:
            return full
    raise unknown(
        f"parameter of the {joint}", name, [r.removeprefix(f"{joint}.") for r in ROWS if r in own_rows(joint)]
    )


def own_rows(joint: str) -> tuple[str, ...]:
    """Rows on which the joint may depend: its own, and those that all joints share."""
    return tuple(name for name in ROWS if "." not in name or name.startswith(f"{joint}."))


def scale(name: str, value: float) -> float:
    """Size of a change of a row that is plausible before the record is seen."""
    joint, _, short = name.rpartition(".")
    table = _SCALES if not joint else _GEARED if joint == "shoulder" else _ROD
    row = ROWS[name]
    return table.get(short) or 0.3 * abs(value) or 0.05 * (row.upper - row.lower)


def free(names: Sequence[str], start: Parameters) -> tuple[Free, ...]:
    """The rows `names` to calibrate from the values of `start`."""
    entries = []
    for name in names:
        row = ROWS[name]
        step = _STEPS.get(name.rpartition(".")[2], 0.05)
        entries.append(Free(name, start[name], row.lower, row.upper, row.unit, scale(name, row.nominal), step))
    return tuple(entries)


@dataclass(frozen=True)
class Leg:
    """The twin's `joint` with parameters `base`, of which the rows `names` are calibrated.

    `without`, `pot_side`, `realisation` and `threads` are those of a `twin.Follower`. Rows `by_run`, and "zero", have a
    value of their own in each run.
    """

    joint: str
    base: Parameters
    names: tuple[str, ...]
    without: tuple[str, ...] = ()
    pot_side: str = "link"
    realisation: str = "tendon"
    threads: int = 2
    by_run: tuple[str, ...] = ()

    def record(self, log: Log, name: str = "log", first: bool = True) -> Record:
        """The log, whose own parameters are its start and those `by_run`; lost samples are not scored."""
        follower = Follower(log, self.joint, self.without, self.pot_side, self.realisation, self.threads)
        low, high = end_angles(self.base, self.joint)
        mask = log.io(self.joint if log.joint else None).observed.ravel()
        y = np.where(mask, follower.y, np.nan)
        angle = float(np.clip(np.median(follower.y[:3]), low, high))
        own = [Free(START, angle, min(low, angle) - 0.3, max(high, angle) + 0.3, "rad", np.deg2rad(1.0))]
        own += free([row for row in self.by_run if row != ZERO], self.base)
        if ZERO in self.by_run and not first:
            own.append(OFFSET)
        order = (*self.names, *(row.name for row in own))
        return Record(name, y, log.Ts, lambda values: self.respond(follower, values, order), tuple(own))

    def parameters(self, values: Sequence[float] | np.ndarray) -> Parameters:
        """The twin's parameters with the calibrated rows at `values`."""
        return self.base.replace({name: float(value) for name, value in zip(self.names, values, strict=True)})

    def respond(self, follower: Follower, values: np.ndarray, order: Sequence[str]) -> np.ndarray:
        """Readings (runs, N) at `values` (runs, n) of the rows in `order`; NaN where there is no leg.

        Delay and zero are applied to the reading. Rows that differ only in them are simulated once.
        """
        columns = dict(zip(order, values.T, strict=True))
        delays = columns.pop(DELAY, np.full(len(values), self.base[DELAY]))
        zeros = columns.pop(ZERO, np.zeros(len(values)))
        unique_points, indices = np.unique(np.column_stack(list(columns.values())), axis=0, return_inverse=True)
        legs = [self._leg(dict(zip(columns, row, strict=True))) for row in unique_points]
        starts = unique_points[:, list(columns).index(START)]
        out = np.full((len(values), len(follower.y)), np.nan)
        rows = [i for i in range(len(values)) if legs[indices[i]] is not None]
        simulated_legs = list(dict.fromkeys(indices[rows]))
        if simulated_legs:
            out[rows] = follower.readings(
                [legs[k] for k in simulated_legs],
                starts[simulated_legs],
                delays[rows],
                [simulated_legs.index(k) for k in indices[rows]],
            )
        return out + zeros[:, None]

    def _leg(self, values: Mapping[str, float]) -> Parameters | None:
        """The parameters, None for pins that the actuator cannot span or a rotor too light for the simulation."""
        try:
            changes = {name: float(value) for name, value in values.items() if name != START}
            parameters = self.base.replace({**changes, DELAY: 0.0})
            end_angles(parameters, self.joint)
            check_rotor(parameters, self.joint)
        except InputError:
            return None
        return parameters
