"""The nominal leg's joints: all imperfections, one at a time, none; driven by voltage or by a servo's reference."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.bench.task import Task
from twin.bench.records import TEST, TRAIN, TS, both, named, split_name, sweep, task
from twin.experiment import Experiment
from twin.hardware.linkage import end_angles
from twin.imperfections import IMPERFECTIONS, TABLE
from twin.parameters import Parameters
from twin.truth import truth

ONLY, IDEAL = "only-", "ideal"
NEEDS_FRICTION = ("asymmetry", "stribeck", "load_friction")  # parts of it: alone they would be nothing
SENSOR = ("noise", "adc", "dropouts")  # these leave the motion linear
ALONE = tuple(name for name in TABLE if name != "contact")  # the foot hangs free
KINDS = ("", *(f"{ONLY}{name}" for name in ALONE), IDEAL)
REACH = 0.45  # of the stroke: how far from its middle a joint without end stops may go


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
        return list(named(KINDS))

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        joint, kind, mode = split_name(scenario, self.name, KINDS)
        without, linear = left_out(kind), is_linear(kind)
        p = Parameters()
        free = linear and mode == "voltage"  # without stops, and nothing else that holds it
        inside = {"reach": _reach(joint, p)} if free else {}
        excitation, options = ("aprbs", inside) if free else ("sweep", sweep(joint, p, mode))
        train = Experiment(joint, excitation, TRAIN, TS, 2 * seed, without, p, options, mode)
        test = Experiment(joint, "aprbs", TEST, TS, 2 * seed + 1, without, p, inside, mode)
        said = f"{joint}, {mode}; without {', '.join(without) or 'nothing'}; {excitation}, then aprbs"
        return task(*both(train, test), said, _lag(joint, p) if free else None)


def left_out(kind: str) -> tuple[str, ...]:
    """The imperfections that a kind of scenario leaves out."""
    if not kind:
        return ()
    if is_linear(kind):
        kept = {kind.removeprefix(ONLY)}
    else:
        one = kind.removeprefix(ONLY)
        kept = {one, "end_stops"} | ({"friction"} if one in NEEDS_FRICTION else set())
    return tuple(name for name in IMPERFECTIONS if name not in kept)


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
