"""The actuated joint fitted to a log and to the other side's response to the same input, value by value."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.joint.posterior import fit_joint
from sysid.joint.values import JointValue, distinct_values, joint_values

# Which effect a value belongs to.
EFFECTS = {
    "speed_per_volt": "speed",
    "time_constant": "supply",
    "breakaway_up": "friction",
    "breakaway_down": "friction",
    "coulomb_up": "friction",
    "coulomb_down": "friction",
    "end_low": "end_stop",
    "end_high": "end_stop",
    "backlash": "backlash",
    "delay": "delay",
    "moving_friction_up": "friction",
    "moving_friction_down": "friction",
    "lag_and_delay": "delay",
}


SUM = "lag_and_delay"


@dataclass(frozen=True)
class Pair:
    """A physical value of the log and of the other side; `apart`: the intervals of the two do not overlap."""

    name: str
    log: JointValue
    other: JointValue

    @property
    def apart(self) -> bool | None:
        """Whether the values differ by more than both intervals together allow; None where an interval is missing."""
        halves = [None if v.low is None or v.high is None else (v.high - v.low) / 2 for v in (self.log, self.other)]
        if halves[0] is None or halves[1] is None:
            return None
        return abs(self.log.value - self.other.value) > float(np.hypot(halves[0], halves[1]))


def pairs(log: IOData, response: IOData, seed: int = 0, starts: int = 2) -> tuple[Pair, ...]:
    """Values of both sides, in one order; none if no actuated joint can be fitted to these records.

    The joint grows on the log. The same joint is then fitted to the other side from there, so that what the joint lacks
    is missing in both. Intervals of level 0.95 allow for coloured residuals.
    """
    try:
        fit = fit_joint(log, starts=starts, seed=seed).fit
        second = fit_chain(fit.model, response, start=fit.theta, search="lm")
        log_values, response_values = joint_values(fit, data=log), joint_values(second, data=response)
    except InputError:
        return ()
    if any(
        value.name == SUM for value in (*log_values, *response_values)
    ):  # one side tells time constant and delay as one value
        log_values, response_values = _sum_lag_and_delay(log_values), _sum_lag_and_delay(response_values)
    by_name = {value.name: value for value in response_values}
    return tuple(
        Pair(value.name, value, by_name[value.name]) for value in distinct_values(log_values) if value.name in by_name
    )


def _sum_lag_and_delay(values: tuple[JointValue, ...]) -> tuple[JointValue, ...]:
    """The values with the sum of time constant and delay in place of both, without an interval."""
    parts = [value for value in values if value.name in ("time_constant", "delay")]
    if len(parts) < 2:
        return values
    total = JointValue(SUM, sum(part.value for part in parts), None, None, "s")
    return (*(value for value in values if value not in parts), total)


__all__ = ["EFFECTS", "Pair", "pairs"]
