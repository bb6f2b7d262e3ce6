"""Why a fit should not be used as it is, in sentences with the call to try next: they stand first on its card."""

from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import number, percent
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.diagnosis.residuals import ResidualTests, poor
from sysid.estimation.result import Fit
from sysid.linear.modes import Mode

LONGEST = 20_000  # samples; what a card computes must not keep its reader waiting
JOINTS = ("actuated_joint", "servo_joint")


def doubts(fit: Fit, data: IOData | None, score: float | None, found: Sequence[Mode]) -> list[str]:
    """Sentences about a fit of `score` [%] on its record `data` and with the poles `found`; none about a good fit."""
    said, open_ = [], [m for m in found if not determined(m) and m.pole.imag > -1e-9]
    # The tests of a good fit are not asked for: they take time.
    bad = score is not None and poor(score, None) and poor(score, _tests(fit, data))
    if bad and score is not None:
        said.append(f"Warning: the free run explains only {percent(score)} of the model's own record.")
    if not fit.stop.converged:
        call = "fit.refine(options=sysid.Options(max_iterations=500))"
        said.append(f"Warning: the search did not converge; go on with {call}.")
    if open_:
        which = ", ".join(number(m.pole.real) for m in open_)
        said.append(
            f"Warning: the record does not determine how fast the pole at {which} is: the standard deviation is larger "
            "than the value."
        )
    if bad or open_:
        said.append(_next(fit, data))
    return said


def determined(mode: Mode) -> bool:
    """False where the standard deviation of the pole or of its time constant is larger than the value."""
    return not (mode.pole_std > abs(mode.pole) > 0.0 or lost(mode.time_constant, mode.time_constant_std))


def lost(value: float, std: float) -> bool:
    """Whether a finite value is smaller than its standard deviation."""
    return bool(np.isfinite(value) and std > abs(value))


def _tests(fit: Fit, data: IOData | None) -> ResidualTests | None:
    """The tests of the residuals; None without a record, for a long one, and where there are no residuals."""
    if data is None or data.N > LONGEST:
        return None
    try:
        return fit.residual_tests(data)
    except InputError:
        return None


def _next(fit: Fit, data: IOData | None) -> str:
    """The call to try: a joint where the output rests at its ends, as `qpal identify` says, else a search."""
    rests = data is not None and any(a.topic == "rest" and a.severity != "fine" for a in advise(data))
    if data is None or not rests or fit.model.structure in JOINTS:
        return "Next: sysid.select(data).fit, which tries other structures and orders."
    raw = "sysid.data.preprocess.retrend(data)" if data.u_offset.any() or data.y_offset.any() else "data"
    call = f"sysid.fit(sysid.structures.actuated_joint(), {raw})"
    return f"Next: {call}, because the output rests at its ends and this model has no end stops; or sysid.select(data)."
