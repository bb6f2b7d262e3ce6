"""Whether a record is that of an actuated joint at all: the joint beside models without any physics."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks import ServoMotor
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.free_run import resting_theta
from sysid.estimation.joint_parts import motor_of
from sysid.estimation.result import Fit
from sysid.joint.ends import MARGIN
from sysid.joint.evidence import stop_tests
from sysid.joint.holdout import holdout_errors, holdout_folds
from sysid.joint.posterior import JointFit
from sysid.model.chain import Chain
from sysid.solver.iterate import Options
from sysid.structures import hammerstein_wiener, output_error

LEAST = 80.0  # [%] a joint's free run over the record that it was fitted to
DRY = 0.03  # of the deviation of the input: dry friction of a motor that drives a joint; filters come to below 0.01
# Of the samples: a servo whose drive is at its limit so often follows a large step slower than a small one, as no
# filter does. By noise alone its readings pass a limit that it keeps below in hardly any.
LIMITED = 0.05
# A filter's output settles where its input holds it: read as a motor, it works against a spring that takes the whole
# range of the input. Friction of a share of that spring would hold a motor where it is.
SPRING, HELD = 0.7, 0.15
_SAME = 1.1  # ratio of errors on unseen parts within which two models are equally good
_CLEARLY_BETTER = (
    0.8  # of the general model's error: so much better over the whole record, a joint may drift on unseen parts
)
# Of the general model's error on unseen parts: a joint so much better there is not refused by BIC, which takes the
# coloured residuals of both as white. A servo drives its motor by the angle, and in that loop a filter of many
# parameters repeats the record without being the motor.
_BETTER_UNSEEN = 0.8
# A joint that follows the record it was fitted to and loses this many times that error on unseen parts, or whose
# friction no input of the record overcomes, is not determined by it: the record may be a joint's or not.
_FOLLOWS, _LOSES = 95.0, 3.0
_STARTS, _SEARCH = 2, Options(max_iterations=50)
GENERAL: dict[str, Chain] = {
    "a linear model of order 4": output_error(4, 4, 1),
    "a Hammerstein-Wiener model of order 2": hammerstein_wiener(2, 2, 1),
}


@dataclass(frozen=True)
class Verdict:
    """Whether the record is a joint's, the reason in words, and the figures that it rests on.

    `seen` and `unseen` are fits [%] of the joint's free run, over the record that it was fitted to and over parts that
    it was not fitted to; `general` names the best model without physics, with the same two fits (None and nan where
    none was needed). `friction` is the dry friction as a share of the input's standard deviation, `spring` the range
    of the load over the positions of the record as a share of the input's range. `undetermined`: the record shows no
    joint and does not exclude one.
    """

    joint: bool
    reason: str
    seen: float
    unseen: float
    friction: float
    spring: float = 0.0
    general: str | None = None
    general_seen: float = float("nan")
    general_unseen: float = float("nan")
    undetermined: bool = False

    def sentence(self) -> str:
        """The verdict in words; empty for a joint."""
        if self.joint:
            return ""
        if self.undetermined:
            return (
                f"This record does not show whether it is that of an actuated joint: {self.reason}, and no joint is "
                "determined; no physical value is given. Record again: longer, and at larger inputs."
            )
        return f"This record is not that of an actuated joint: {self.reason}; no physical value is given."

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON; a figure that was not needed is None."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in vars(self).items()}


def verdict(joint: JointFit, data: IOData) -> Verdict:
    """Whether the joint that was fitted to `data` explains it as a joint would.

    A joint's free run must come to `LEAST` over the record. Its motor must have dry friction, strike a stop or, of a
    servo, come to the limit of its drive; without them it is a linear filter under another name. Output-error and
    Hammerstein-Wiener models must not explain the record better: neither by BIC over the whole record, unless the joint
    is clearly better in free run over parts that neither was fitted to, nor on these parts.
    """
    judgement = _judge(joint, data)
    friction = judgement.friction * float(np.std(data.u))
    is_stuck = np.isfinite(friction) and friction > float(np.abs(data.u).max()) and not _is_servo(joint.fit)
    loses = 100.0 - judgement.unseen > _LOSES * (100.0 - judgement.seen)
    return replace(judgement, undetermined=not judgement.joint and judgement.seen >= _FOLLOWS and (is_stuck or loses))


def _judge(joint: JointFit, data: IOData) -> Verdict:
    fit = joint.fit
    y = data.y[data.observed[:, 0], 0]
    seen_percent = _percent(float(np.sqrt(fit.criteria.mse)), y)
    friction = _friction(fit, data)
    spring = _spring(fit, data)
    judgement = Verdict(True, "", seen_percent, joint.unseen_percent, friction, spring)
    if not seen_percent >= LEAST:
        return replace(
            judgement,
            joint=False,
            reason=f"no joint explains it (fit of the free run {max(seen_percent, 0.0):.0f} % where fitted)",
        )
    bends = _limited(fit, data) > LIMITED or any(test.met for test in stop_tests(fit, data).values())
    if friction < DRY and not bends:  # no filter strikes a stop
        return replace(
            judgement,
            joint=False,
            reason=f"the motor that fits it has no dry friction ({100 * friction:.1f} % of the input), as a filter",
        )
    centred_data = replace(data, u=data.u - data.u.mean(axis=0), y=data.y - y.mean())
    pair = holdout_folds(centred_data)
    for name, chain in GENERAL.items():
        general_fit = _fit_general(chain, centred_data)
        if general_fit is None:
            continue
        run = holdout_errors(general_fit.model, general_fit.theta, pair).percent if pair else float("nan")
        general_percent = _percent(float(np.sqrt(general_fit.criteria.mse)), y)
        beside_general = replace(judgement, general=name, general_seen=general_percent, general_unseen=run)
        better = 100.0 - judgement.unseen < _BETTER_UNSEEN * (100.0 - run)
        if general_fit.criteria.bic < fit.criteria.bic + MARGIN and not better:
            reason = f"{name} explains it as well (fit {general_percent:.1f} %, the joint {seen_percent:.1f} %)"
            return replace(beside_general, joint=False, reason=reason)
        if 100.0 - judgement.unseen > _SAME * (100.0 - run) and 100.0 - seen_percent > _CLEARLY_BETTER * (
            100.0 - general_percent
        ):
            reason = f"{name} is better where it was not fitted ({run:.1f} %, the joint {judgement.unseen:.1f} %)"
            return replace(beside_general, joint=False, reason=reason)
        judgement = beside_general if judgement.general is None or run > judgement.general_unseen else judgement
    if spring > SPRING and friction < HELD * spring:
        return replace(
            judgement,
            joint=False,
            reason=f"the output returns by itself (the load takes {100 * spring:.0f} % of the input), as a filter's",
        )
    return judgement


def _spring(fit: Fit, data: IOData) -> float:
    """Range of the load over the positions of most samples, as a share of the input's."""
    if _is_servo(fit):  # returns to its goal by its loop, not by its load
        return 0.0
    return float(np.ptp(_loads(fit, data))) / max(float(np.ptp(np.quantile(data.u, [0.02, 0.98]))), 1e-300)


def _is_servo(fit: Fit) -> bool:
    """Whether the input is a goal."""
    return isinstance(motor_of(fit.model), ServoMotor)


def _limited(fit: Fit, data: IOData) -> float:
    """Share of the samples in which a servo's drive is at its limit; 0 of another motor."""
    chain, motor = fit.model, motor_of(fit.model)
    if not isinstance(motor, ServoMotor):
        return 0.0
    part = chain.part(fit.theta, motor)
    drive = motor.value(part, "kp") * np.abs(data.u[:, 0] - data.y[:, 0])
    return float(np.mean(drive[data.observed[:, 0]] > motor.value(part, "limit")))


def _loads(fit: Fit, data: IOData) -> np.ndarray:
    """The load [V] (49,) at the positions of most samples, in order of position."""
    chain, motor = fit.model, motor_of(fit.model)
    with np.errstate(all="ignore"):
        positions = chain.signals(resting_theta(chain, fit.theta), data.experiments[0].u)[
            1 + chain.blocks.index(motor)
        ].ravel()
        offsets = np.quantile(positions, np.linspace(0.02, 0.98, 49)) - motor.at
        part = chain.part(fit.theta, motor)
        load = np.sum([motor.value(part, f"load{k}") * offsets**k for k in range(3)], axis=0)
    return np.nan_to_num(load, posinf=0.0, neginf=0.0)


def _fit_general(chain: Chain, data: IOData) -> Fit | None:
    """A general model, from few starts; None where it has no valid fit."""
    try:
        with np.errstate(all="ignore"):
            return fit_chain(chain, data, starts=_STARTS, options=_SEARCH)
    except (InputError, np.linalg.LinAlgError):
        return None


def _percent(rms: float, y: np.ndarray) -> float:
    return 100.0 * (1.0 - rms / max(float(np.std(y)), 1e-300))


def _friction(fit: Fit, data: IOData) -> float:
    """Dry friction with stick and the loss of a screw, as a share of the input; a driver map may hold it instead."""
    chain, motor = fit.model, motor_of(fit.model)
    if chain.block("driver") is not None:
        return float("inf")
    part = chain.part(fit.theta, motor)
    rise, fall, stick, loss = (motor.value(part, name) for name in ("rise", "fall", "stick", "loss"))
    if motor.sided:
        stick = 0.5 * (stick + motor.value(part, "stick_down"))
    load_friction = loss * float(np.mean(np.abs(_loads(fit, data))))
    # A servo's input is a goal, and its drive goes up to a limit of which it uses, on the mean, a good part.
    drive = 0.5 * motor.value(part, "limit") if isinstance(motor, ServoMotor) else float(np.std(data.u))
    return (0.5 * (rise + fall) + stick + load_friction) / max(drive, 1e-300)
