"""What a card says of poles, gain and noise, and why a fit should not be used as it is."""

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import display_quantity, number, percent
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.diagnosis.residuals import ResidualTests, poor
from sysid.estimation.result import Fit
from sysid.linear.modes import Mode, gain, modes
from sysid.linear.noise import Noise, noise_model
from sysid.notebook.card import Table

UNKNOWN = "not determined"
HEADINGS = ("pole", "std", "frequency [Hz]", "std", "damping", "std", "time constant [s]", "std")
LONGEST = 20_000  # samples; what a card computes must not keep its reader waiting
JOINTS = ("actuated_joint", "servo_joint")


def modes_of(fit: Fit, data: IOData | None) -> tuple[tuple[Mode, ...], str]:
    """The poles, and what their deviations assume about the residuals."""
    if not len(fit.poles):
        return (), ""
    if data is not None and data.N <= LONGEST:
        with suppress(InputError, np.linalg.LinAlgError):
            return modes(fit, data), "coloured residuals allowed for"
    return modes(fit), "white residuals assumed"


def pole_table(modes: Sequence[Mode], assumption: str = "") -> Table | None:
    """Every pole with its deviations, each pair once; None for a model without a linear block."""
    rows = [_row(m) for m in modes if m.pole.imag > -1e-9]
    caption = "Poles with standard deviations"
    return Table(HEADINGS, rows, f"{caption}, {assumption}" if assumption else caption) if rows else None


def gain_fact(fit: Fit, data: IOData | None) -> tuple[str, str] | None:
    """The DC gain with its deviation and unit; None for a model that has none."""
    try:
        g = gain(fit, data=data if data is not None and data.N <= LONGEST else None)
    except (InputError, np.linalg.LinAlgError):
        return None
    if not math.isfinite(g.value):
        return "DC gain", "infinite: the model integrates"
    unit = (
        display_quantity("", data.y_unit).per(display_quantity("", data.u_unit))
        if data is not None
        else display_quantity("", "")
    )
    place = f" at u = {number(g.u)}" if g.u else ""
    if lost(g.value, g.std) or (g.value == 0.0 and g.std == 0.0):
        reason = "the maps are flat there" if g.value == 0.0 else "its standard deviation is larger than the value"
        return "DC gain", f"{UNKNOWN} at u = {number(g.u)}: {reason}"
    spread = f" ± {number(g.std * unit.factor, 2)}" if math.isfinite(g.std) else ", std not determined"
    return "DC gain", f"{number(g.value * unit.factor)}{spread}{f' {unit.unit}' if unit.unit else ''}{place}"


def noise_of(fit: Fit, data: IOData | None) -> Noise | None:
    """The noise model of a record that is not too long, if it has one."""
    if data is None or data.N > LONGEST:
        return None
    try:
        return noise_model(fit, data)
    except (InputError, np.linalg.LinAlgError):
        return None


def _row(m: Mode) -> tuple[str, ...]:
    real, imag = m.pole.real, abs(m.pole.imag)
    text = number(real) if imag < 1e-9 else f"{number(real)} ± {number(imag)}i"
    damping = (number(m.damping), number(m.damping_std, 2))
    lasting = (UNKNOWN, "–") if m.note else _cells(m.time_constant, m.time_constant_std)
    return text, number(m.pole_std, 2), *_cells(m.hertz, m.hertz_std), *damping, *lasting


def _cells(value: float, std: float) -> tuple[str, str]:
    """A value and its deviation; without numbers where the deviation is larger than the value."""
    return (UNKNOWN, "–") if lost(value, std) else (number(value), number(std, 2))


def doubts(fit: Fit, data: IOData | None, score: float | None, modes: Sequence[Mode]) -> list[str]:
    """Sentences about a fit of `score` [%] on its record `data` and with the poles `found`; none about a good fit."""
    sentences, open_ = [], [m for m in modes if not determined(m) and m.pole.imag > -1e-9]
    # The tests of a good fit are not asked for: they take time.
    bad = score is not None and poor(score, None) and poor(score, _tests(fit, data))
    if bad and score is not None:
        sentences.append(f"Warning: the free run explains only {percent(score)} of the model's own record.")
    if not fit.stop.converged:
        call = "fit.refine(options=sysid.Options(max_iterations=500))"
        sentences.append(f"Warning: the search did not converge; go on with {call}.")
    if open_:
        poles = ", ".join(number(m.pole.real) for m in open_)
        sentences.append(
            f"Warning: the record does not determine how fast the pole at {poles} is: the standard deviation is larger "
            "than the value, or a zero may cancel the pole."
        )
    if bad or open_:
        sentences.append(_next(fit, data))
    return sentences


def determined(mode: Mode) -> bool:
    """False where a zero may cancel the pole, or a deviation of it or of its time constant is larger than the value."""
    return not (mode.note or mode.pole_std > abs(mode.pole) > 0.0 or lost(mode.time_constant, mode.time_constant_std))


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
    return f"Next: {call}, because the output rests at end stops and this model has none; or sysid.select(data)."
