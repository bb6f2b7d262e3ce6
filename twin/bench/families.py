"""Families of benchmark scenarios on the leg: its joints, drawn legs, and stand-ins of a structure no model has."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.errors import unknown
from sysid.bench.task import Task, Truth
from twin.bench.standin import StandIn, draw_parameters
from twin.experiment import PACE, Experiment
from twin.hardware.linkage import end_angles
from twin.imperfections import IMPERFECTIONS, TABLE
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.truth import truth

TS = 0.05  # [s]
TRAIN, TEST = 125.0, 60.0  # [s]
DROP = 50  # samples of a test from which the initial state is taken
ORDERS = (2, 2, 1)  # a lag and an integrator
SERVO = "-servo"
HALF_PERIOD = {"fast": 2.5, "slow": 10.0}  # [s] of a drawn sweep on the nominal leg, on the mean
LEVELS = 0.6  # least level of a drawn sweep, as a share of the supply
ONLY, IDEAL = "only-", "ideal"
NEEDS_FRICTION = ("asymmetry", "stribeck", "load_friction")  # parts of it: alone they would be nothing
SENSOR = ("noise", "adc", "dropouts")  # these leave the motion linear
ALONE = tuple(name for name in TABLE if name != "contact")  # the foot hangs free
KINDS = ("", *(f"{ONLY}{name}" for name in ALONE), IDEAL)
REACH = 0.45  # of the stroke: how far from its middle a joint without end stops may go
LONG, SHORT = 60.0, 30.0  # [s] of the record and of the test
CHIRP = {"shoulder": (0.1, 1.0), "thigh": (0.05, 0.3), "shank": (0.05, 0.3)}  # [Hz]


@dataclass(frozen=True)
class Joints:
    """Scenarios JOINT, JOINT-only-IMPERFECTION and JOINT-ideal, each also with -servo at the end.

    A joint with stops is swept between drawn levels; the test is an aprbs of another seed. One imperfection at a time
    keeps the end stops, so that the joint stays on its way, and parts of friction come with friction. Without any, and
    with one of the sensor alone, levels stay within the stroke, and the truth has the pole of the joint at mid stroke
    (its integrator is the plant's by structure). The seed draws excitation, noise and lost samples.
    """

    name: str = "twin"
    about: str = "shoulder, thigh and shank by voltage and as servos; imperfections all, one at a time, none"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return list(scenario_names(KINDS))

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        joint, kind, mode = split_name(scenario, self.name, KINDS)
        without, linear = left_out(kind), is_linear(kind)
        p = Parameters()
        free = linear and mode == "voltage"  # without stops, and nothing else that holds it
        reach = {"reach": _reach(joint, p)} if free else {}
        excitation, options = ("aprbs", reach) if free else ("sweep", sweep(joint, p, mode))
        train = Experiment(joint, excitation, TRAIN, TS, 2 * seed, without, p, options, mode)
        test = Experiment(joint, "aprbs", TEST, TS, 2 * seed + 1, without, p, reach, mode)
        words = f"{joint}, {mode}; without {', '.join(without) or 'nothing'}; {excitation}, then aprbs"
        return task(train.run(), test.run(), words, _lag(joint, p) if free else None)


def left_out(kind: str) -> tuple[str, ...]:
    """The imperfections that a kind of scenario leaves out."""
    if not kind:
        return ()
    if is_linear(kind):
        present = {kind.removeprefix(ONLY)}
    else:
        imperfection = kind.removeprefix(ONLY)
        present = {imperfection, "end_stops"} | ({"friction"} if imperfection in NEEDS_FRICTION else set())
    return tuple(name for name in IMPERFECTIONS if name not in present)


def is_linear(kind: str) -> bool:
    """Whether nothing but the linkage makes the joint nonlinear."""
    return kind == IDEAL or kind.removeprefix(ONLY) in SENSOR


def _reach(joint: str, p: Parameters) -> float:
    """Largest running integral of the voltage [V s] that keeps the joint within `REACH` of its stroke."""
    low, high = end_angles(p, joint)
    return REACH * (high - low) / abs(truth(joint, TS, p).gain)


def _lag(joint: str, p: Parameters) -> np.ndarray:
    """The pole (1,) of the joint's lag without friction, in z at `TS`."""
    smooth = p.replace({f"{joint}.viscous": 0.0, f"{joint}.bearing_viscous": 0.0})
    poles = truth(joint, TS, smooth).poles
    return poles[np.argsort(np.abs(poles - 1.0))[1:]]  # the nearest to 1 is the integrator


@dataclass(frozen=True)
class Legs:
    """Scenarios JOINT and JOINT-servo. The seed draws geometry, motor, friction, play and delay of the leg (see
    `twin.bench.standin.RANGES`), and excitation and noise; the sweep's half periods fit the leg that was drawn.
    """

    name: str = "legs"
    about: str = "legs with drawn parameters and all imperfections"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return list(scenario_names())

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        joint, _, mode = split_name(scenario, self.name)
        p = draw_parameters(joint, seed)
        train = Experiment(joint, "sweep", TRAIN, TS, 2 * seed, (), p, sweep(joint, p, mode), mode)
        test = Experiment(joint, "aprbs", TEST, TS, 2 * seed + 1, (), p, {}, mode)
        return task(train.run(), test.run(), f"{joint}, {mode}; {changes(p)}")


@dataclass(frozen=True)
class Mismatch:
    """Scenario JOINT: an aprbs, then a chirp, on the stand-in that the seed draws; sampled as a rig's capture."""

    name: str = "mismatch"
    about: str = "stand-ins with hidden parameters, the other actuator realisation and a crooked potentiometer"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return list(JOINTS)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        if scenario not in JOINTS:
            raise unknown(f"scenario of {self.name}", scenario, JOINTS)
        rig, (low, high) = StandIn(scenario, seed), CHIRP[scenario]
        train, test = rig.log("aprbs", LONG, 2), rig.log("chirp", SHORT, 3, f_min=low, f_max=high)
        return task(train, test, f"{scenario}, closed loop, voltage; {changes(rig.parameters)}")


def split_name(scenario: str, family: str, kinds: tuple[str, ...] = ("",)) -> tuple[str, str, str]:
    """Joint, kind and mode of a scenario "JOINT[-KIND][-servo]"; raises InputError for another name."""
    names = scenario_names(kinds)
    if scenario not in names:
        raise unknown(f"scenario of {family}", scenario, names)
    return names[scenario]


def scenario_names(kinds: tuple[str, ...] = ("",)) -> dict[str, tuple[str, str, str]]:
    """Joint, kind and mode by scenario name."""
    return {
        f"{joint}{f'-{kind}' if kind else ''}{SERVO if mode == 'servo' else ''}": (joint, kind, mode)
        for joint in JOINTS
        for kind in kinds
        for mode in ("voltage", "servo")
    }


def crossing(joint: str, p: Parameters) -> float:
    """Time [s] that the joint of these parameters needs from end to end at full voltage, without friction."""
    low, high = end_angles(p, joint)
    return (high - low) / (abs(truth(joint, TS, p).gain) * p["supply_voltage"])


def sweep(joint: str, p: Parameters, mode: str) -> dict[str, Any]:
    """Settings of a sweep between drawn levels whose half periods fit the leg; it reaches the ends now and then."""
    half = HALF_PERIOD[PACE[joint]] * crossing(joint, p) / crossing(joint, Parameters())
    return {"half_period": round(half, 2), "jitter": 0.5, "shrink": 1.0 - LEVELS if mode == "voltage" else 0.8}


def task(train: Log, test: Log, description: str, poles: np.ndarray | None = None, orders: Any = ORDERS) -> Task:
    """The task of two logs with true readings [rad]; its noise is all that lies between reading and record."""
    assert train.y_true is not None
    assert test.y_true is not None
    facts = Truth({"test": test.y_true}, float(np.std(train.y - train.y_true)), poles)
    return Task(train.io(), {"test": test.io()}, DROP, "rad", orders, facts, given=description)


def changes(p: Parameters) -> str:
    """The values that differ from nominal, in words."""
    return ", ".join(f"{name} {value:.4g}" for name, value in p.changed().items())
