"""What a report remarks on a model beside its record: the sign of its gain, and where it extrapolates."""

from collections.abc import Iterator

import numpy as np

from sysid.base.quantities import display_quantity, ratio, unit_of_channel
from sysid.blocks import Travel
from sysid.data.record import IOData
from sysid.diagnosis.direction import confirmed, direction
from sysid.estimation.result import Fit
from sysid.joint.evidence import stop_tests
from sysid.nlarx.result import NlarxFit

WRONG = "the WRONG SIGN"
JOINT_RECORD = "a joint needs a longer record, which reverses, reaches both ends and rests"
_SETTLED = 0.2  # of the largest value of a step response, below which its end has no sign worth the name
EXTRAPOLATED = 0.05  # of the range seen, by which a signal may leave it before a report speaks of it


def gain_remarks(estimation: IOData, validation: IOData, run: np.ndarray, step: np.ndarray | None) -> list[str]:
    """One sentence for each way in which the model goes against the record.

    None where the record leaves a doubt, or has several inputs or outputs.
    `run` (N,) is the free run over `validation`, `step` (n,) the response of the tangent model to a unit step.
    """
    one = estimation.u.shape[1] == estimation.y.shape[1] == 1
    way = direction(estimation) if one else 0
    if not way:
        return []
    y, u = estimation.y_name, estimation.u_name
    observation = f"in the estimation data {y} {'rises' if way > 0 else 'falls'} when {u} rises"
    q = display_quantity("", "")
    if estimation.u_unit and estimation.y_unit not in ("", "1"):
        q = display_quantity("", ratio(estimation.y_unit, estimation.u_unit))
    unit = f" {q.unit}" if q.unit else ""
    remarks = []
    if direction(validation, run) == -way:
        remarks.append(f"the free run has {WRONG}: {observation}, and the model does the opposite")
    if step is not None and step[-1] * way < 0.0 and abs(step[-1]) > _SETTLED * float(np.max(np.abs(step))):
        gain = f"{step[-1] * q.factor:.3g}{unit}"
        remarks.append(
            f"the steady-state gain of the model at the mean input, {gain}, has {WRONG}: {observation}; do not "
            "design with "
            "this model"
        )
    return remarks if remarks and confirmed(estimation, way) else []


def extrapolated_signals(estimation: IOData, validation: IOData) -> list[str]:
    """One sentence for each signal of the validation data that leaves the range of the estimation data."""
    notes = []
    for name, unit, covered, new, offset in (
        *_signals(estimation, validation, "u"),
        *_signals(estimation, validation, "y"),
    ):
        low, high = float(covered.min()), float(covered.max())
        share_outside = float(np.mean((new < low) | (new > high)))
        if max(low - new.min(), new.max() - high) > EXTRAPOLATED * (high - low):
            q = display_quantity("", unit)
            pairs = ((q.factor * (a + offset), q.factor * (b + offset)) for a, b in ((low, high), _range(new)))
            ranges = [f"{a:.4g} to {b:.4g} {q.unit}".strip() for a, b in pairs]
            notes.append(
                f"{name} was seen from {ranges[0]} and goes from {ranges[1]} in the validation data "
                f"({100 * share_outside:.1f} % of the samples outside): the model extrapolates there"
            )
    return notes


def _signals(
    estimation: IOData, validation: IOData, role: str
) -> Iterator[tuple[str, str, np.ndarray, np.ndarray, float]]:
    """Name, unit, values in both parts and removed offset of every channel of a role, "u" or "y"."""
    name, unit, offsets = (getattr(estimation, f"{role}_{attribute}") for attribute in ("name", "unit", "offset"))
    covered, new = getattr(estimation, role), getattr(validation, role)
    for k, offset in enumerate(offsets):
        several = len(offsets) > 1
        yield f"{role}{k + 1}" if several else name, unit_of_channel(unit, k), covered[:, k], new[:, k], float(offset)


def ends_met(fit: Fit, estimation: IOData) -> tuple[bool, bool]:
    """Whether the estimation data show that an actuated joint met its lower and its upper end; see `stop_test` of
    `sysid.joint.value_record`."""
    tests = stop_tests(fit, estimation)
    low, high = (name in tests and tests[name].met for name in ("end_low", "end_high"))
    return low, high


def warnings_of(fit: Fit | NlarxFit, joint: bool) -> list[str]:
    """The warnings of the fit; of a joint, which values its record does not determine, and what to record."""
    if not joint or not isinstance(fit, Fit):
        return list(fit.warnings)
    names = np.array(fit.model.names)[fit.covariance.unidentifiable]
    open_ = f"the data do not determine {', '.join(names)}; {JOINT_RECORD}: qpal design FILE"
    return [open_ if text.startswith("the data do not determine") else text for text in fit.warnings]


def extrapolated_joint(fit: Fit, estimation: IOData, validation: IOData) -> list[str]:
    """Extrapolation of an actuated joint: ends that the estimation data never reached, and their distance."""
    travel, met = _travel(fit), ends_met(fit, estimation)
    if travel is None:
        return extrapolated_signals(estimation, validation)
    if all(met):
        return []
    covered, new, offset = estimation.y[:, 0], validation.y[:, 0], estimation.y_offset[0]
    q = display_quantity(estimation.y_name, estimation.y_unit)
    low, high = sorted(map(float, fit.model.part(fit.theta, travel)[:2]))
    a, b = _range(covered)
    distances = [
        f"{100 * max(gap, 0.0) / (high - low):.1f} % of the travel to {q.factor * (end + offset):.4g} {q.unit}".strip()
        for gap, end, is_met in ((a - low, low, met[0]), (high - b, high, met[1]))
        if not is_met
    ]
    ends_in_words = (
        "reached neither end stop" if not any(met) else f"did not reach its {'lower' if met[1] else 'upper'} end stop"
    )
    percent_outside = 100 * float(np.mean((new < a) | (new > b)))
    return [
        f"{q.name} was seen from {q.factor * (a + offset):.4g} to {q.factor * (b + offset):.4g} {q.unit}".rstrip()
        + f" and {ends_in_words}; outside this range the model continues its map as a straight line "
        f"({' and '.join(distances)}) to "
        f"an end stop that the data do not show; {percent_outside:.1f} % of the validation samples are outside this "
        "range"
    ]


def _travel(fit: Fit) -> Travel | None:
    return next((block for block in fit.model.blocks if isinstance(block, Travel)), None)


def _range(x: np.ndarray) -> tuple[float, float]:
    return float(x.min()), float(x.max())


def share_outside(estimation: IOData, validation: IOData) -> float:
    """The largest share over the signals of validation samples outside the range of the estimation data."""
    covered, new = (np.column_stack([part.u, part.y]) for part in (estimation, validation))
    return float(np.mean((new < covered.min(axis=0)) | (new > covered.max(axis=0)), axis=0).max())
