"""Beyond the paper: its structure and an actuated joint on the same records of the twin, with ceiling and truth.

Each joint has two records. The paper's sweep repeats itself, and any model with a resonance at its period fits it well.
A sweep with random times and levels does not repeat itself: a good fit there needs the friction and the end stops.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.data.preprocess import quick_start
from sysid.joint.values import JointValue
from sysid.structures import ActuatedJoint
from sysid.workflow.evaluation import evaluate
from sysid.workflow.results import Evaluation
from sysid.workflow.setting import Setting
from twin.experiment import Experiment, run_all
from twin.hardware.actuator import drive
from twin.hardware.potentiometer import SIDES, potentiometer
from twin.log import Log
from twin.parameters import Parameters
from twin.truth import truth

NEAR = 0.5  # points of fit below the ceiling that still count as all but noise explained
STEPS = 4  # what `run` announces
RECORDS = ("sweep", "drawn sweep")
OTHER_SIDE = 0.25  # of a backlash from its middle: a link that came from one side is nearer to the other
LONGER = 1.25  # mean half period of the drawn sweep, relative to the paper's sweep


@dataclass(frozen=True)
class Trial:
    """One record with the fits of both structures.

    `ceiling` [%] is the fit of the twin's noise-free output against its measured output on the validation half.
    """

    record: str
    log: Log
    paper: Evaluation
    joint: Evaluation
    ceiling: float

    @property
    def near(self) -> bool:
        """Whether the actuated joint comes within NEAR points of the ceiling."""
        return self.joint.validation_fit >= self.ceiling - NEAR

    @property
    def gain(self) -> float:
        """Points of fit by which the actuated joint is ahead of the paper's structure."""
        return self.joint.validation_fit - self.paper.validation_fit

    def as_dict(self) -> dict[str, Any]:
        """The trial, ready for JSON."""
        return {
            "paper_structure": self.paper.as_dict(),
            "actuated_joint": self.joint.as_dict(),
            "ceiling": self.ceiling,
            "near_ceiling": self.near,
            "gain": self.gain,
            "log": dict(self.log.meta),
        }


@dataclass(frozen=True)
class RecoveredValue:
    """One physical value in SI units: the truth, the values from each record by name, and the accepted error."""

    name: str
    unit: str
    true: float
    aim: float
    found: Mapping[str, JointValue]

    def as_dict(self) -> dict[str, Any]:
        """The value, ready for JSON."""
        values = {record: [v.value, v.low, v.high] for record, v in self.found.items()}
        return {"unit": self.unit, "truth": self.true, "aim": self.aim, **values}


@dataclass(frozen=True)
class JointTrials:
    """One joint: its two trials and the recovered physical values."""

    joint: str
    trials: tuple[Trial, ...]
    recovered: tuple[RecoveredValue, ...]

    def as_dict(self) -> dict[str, Any]:
        """The joint, ready for JSON."""
        return {
            **{trial.record: trial.as_dict() for trial in self.trials},
            "recovered": {r.name: r.as_dict() for r in self.recovered},
        }


def run(
    joint: str,
    setting: Setting,
    sweep: Log,
    final: Evaluation,
    seed: int,
    duration: float,
    announce: Callable[[str], None] = lambda name: None,
) -> JointTrials:
    """Both trials of `joint`; `sweep` is the paper's record, and `final` the model of `setting` fitted to it."""
    announce(f"{joint}: actuated joint on the sweep")
    trials = [_trial("sweep", sweep, final)]
    announce(f"{joint}: a record that does not repeat itself")
    log = irregular(joint, seed, duration, sweep.Ts)
    announce(f"{joint}: the paper's structure on it")
    paper = evaluate(setting, *quick_start(log.io()))
    announce(f"{joint}: actuated joint on it")
    trials.append(_trial("drawn sweep", log, paper))
    return JointTrials(joint, tuple(trials), recovered_values(twin_truth(joint, sweep.Ts), trials))


def irregular(joint: str, seed: int, duration: float, Ts: float) -> Log:
    """A sweep with random half periods within 50 % of a mean and random levels of at least 60 % of the supply.

    It is somewhat longer than the paper's, so that slow crossings reach the end too. It contains speeds at many
    voltages, and it meets the ends often enough to reset the error of a free run.
    """
    mean = round(LONGER * vars(Experiment(joint, "sweep").signal())["half_period"], 3)
    options = {"half_period": mean, "jitter": 0.5, "shrink": 0.4}
    return Experiment(joint, "sweep", duration, Ts, seed, options=options).run()


def ceiling(log: Log, samples: slice) -> float:
    """Fit [%] of the noise-free output against the measured one: no model can be expected to do better."""
    assert log.y_true is not None
    return fit_percent(log.y[samples], log.y_true[samples])


def _trial(record: str, log: Log, paper: Evaluation) -> Trial:
    estimation, validation = quick_start(log.io(), kind="none")
    # The data sheets give the resolution of the bridge and the linearity of the potentiometer; the fit finds the rest.
    p = Parameters()
    setting = Setting(
        ActuatedJoint(driver_step=drive(p, log.joint).step, sensor_linearity=potentiometer(p).nonlinearity)
    )
    joint = evaluate(setting, estimation, validation)
    return Trial(record, log, paper, joint, ceiling(log, slice(estimation.N + joint.fit.n_init, None)))


UNITS = {
    **{"speed_per_volt": "rad/s/V", "backlash": "rad", "end_low": "rad", "end_high": "rad"},
    **dict.fromkeys(("time_constant", "delay", "lag_and_delay"), "s"),
    **{f"{name}_{way}": "V" for name in ("breakaway", "coulomb", "moving_friction") for way in ("up", "down")},
}


def twin_truth(joint: str, Ts: float, parameters: Parameters | None = None) -> dict[str, float]:
    """True values of a twin's joint, with the names and units of `sysid.joint_values`."""
    p = parameters or Parameters()
    t = truth(joint, Ts, p)
    return {
        "speed_per_volt": t.gain,
        "time_constant": -1.0 / t.continuous_pole,
        "breakaway_up": t.breakaway_voltage[1],
        "breakaway_down": t.breakaway_voltage[0],
        "coulomb_up": t.moving_voltage[1],
        "coulomb_down": t.moving_voltage[0],
        "end_low": t.end_angles[0],
        "end_high": t.end_angles[1],
        "backlash": t.backlash,
        "delay": t.delay,
        "lag_and_delay": t.delay - 1.0 / t.continuous_pole,
        "moving_friction_up": t.moving_voltage[1],
        "moving_friction_down": t.moving_voltage[0],
    }


def link_crosses(joint: str, parameters: Parameters | None = None) -> bool:
    """Whether inputs of full voltage bring the link of a joint from one side of its backlash to the other.

    Where its weight holds the link on one side under every input, a record is that of a joint without backlash whose
    ends lie half of it elsewhere: it has no information on the backlash. The sweeps here go over the whole way, strike
    both ends and turn as hard as the supply can; quick turns throw the link farthest, slow ones are at every place.
    """
    p = parameters or Parameters()
    without = ("noise", "adc", "jitter", "dropouts", "nonlinearity")
    for half in (0.2, 1.0, 8.0):  # [s]
        options = {"half_period": half, "jitter": 0.5, "shrink": 0.25}
        settings = ("sweep", 60.0, 0.01, 0, without, p, options)
        logs = run_all([Experiment(joint, *settings, pot_side=side) for side in SIDES])
        link, drive_side = (np.asarray(log.y_true) for log in logs)
        place = (link - drive_side) / p[f"{joint}.backlash"]
        if min(-place.min(), place.max()) > OTHER_SIDE:
            return True
    return False


def aim(name: str, true: float, Ts: float) -> float:
    """Accepted error of an estimate, in the value's own unit; a tenth of a sample for times."""
    if name.startswith("end_"):
        return float(np.deg2rad(0.5))
    if name == "backlash":
        return max(0.2 * true, float(np.deg2rad(0.1)))
    if name in ("time_constant", "delay", "lag_and_delay"):
        return 0.1 * Ts
    return abs(true) * (0.02 if name == "speed_per_volt" else 0.1)


def recovered_values(true: Mapping[str, float], trials: list[Trial]) -> tuple[RecoveredValue, ...]:
    """The physical values of every trial and the truth; a value that a record does not determine may be missing.

    Moving friction is left out: it stands for a break-away that is not determined, and is the friction in motion.
    """
    Ts, rows = trials[0].log.Ts, []
    for name, true_value in true.items():
        values = {t.record: value for t in trials for value in t.joint.values if value.name == name}
        if not name.startswith("moving_friction"):
            rows.append(RecoveredValue(name, UNITS[name], true_value, aim(name, true_value, Ts), values))
    return tuple(rows)
