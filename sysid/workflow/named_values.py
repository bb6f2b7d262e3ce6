"""Values of a model whose parameters engineers name, such as a gain or a time constant, with intervals."""

from sysid.base.errors import InputError
from sysid.base.quantities import rate, ratio
from sysid.data.frequency import FrequencyData
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.joint.values import JointValue
from sysid.uncertainty import intervals
from sysid.uncertainty.information import information


def named_values(fit: Fit, data: IOData, level: float = 0.95) -> tuple[JointValue, ...]:
    """Every parameter that has words, in seconds and the units of its record `data`; none of other models.

    Intervals allow for coloured residuals, see `sysid.uncertainty.information`.
    """
    named = [(name, slot) for name, slot in zip(fit.model.names, fit.model.slots, strict=True) if slot.words]
    if not named:
        return ()
    try:
        found, why = intervals.parameters(information(fit, data), level), ""
    except InputError as error:
        found, why = {}, str(error)
    values = []
    for name, slot in named:
        value, unit = float(fit.theta[fit.model.names.index(name)]), unit_of(slot.unit, data)
        if name in fit.model.fixed:
            values.append(JointValue(slot.words, value, value, value, unit))
        elif name in found and found[name].note == "":
            low, high = max(found[name].lower, slot.lower), min(found[name].upper, slot.upper)
            values.append(JointValue(slot.words, value, low, high, unit))
        else:
            values.append(JointValue(slot.words, value, None, None, unit, False, why or found[name].note))
    return tuple(values)


def unit_of(unit: str, data: IOData | FrequencyData) -> str:
    """The unit of a slot with those of the record in place of Y and U; empty where the record names none."""
    if not unit.startswith("Y/U"):
        return unit
    y, u = ("" if each == "1" else each for each in (data.y_unit, data.u_unit))
    gain, time = ratio(y, u), unit.removeprefix("Y/U/")
    return gain if unit == "Y/U" else rate(gain or "1", time)
