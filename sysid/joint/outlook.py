"""What a designed experiment is not expected to show, in sentences that name the next step."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sysid.base.quantities import display_quantity, number
from sysid.data.record import IOData
from sysid.joint.course import Course
from sysid.joint.values import JointValue

_ADVICE = re.compile(r"[:;] (?:record|reverse|sample) ")
_WIDER = 1.3  # times the interval of the first record
_STRONG_INPUT = 1.7  # of the friction in motion: inputs that start most joints
_WORDS = {
    **{"end_low": "the lower end stop", "end_high": "the upper end stop"},
    **{"speed_per_volt": "the speed per volt"},
    **{"breakaway_up": "the break-away voltage up", "breakaway_down": "the break-away voltage down"},
    **{"backlash": "the backlash"},
}


def unseen_ends(course: Course, data: IOData) -> list[str]:
    """One sentence for each end that the first record does not show, and that the input therefore keeps away from."""
    sentences = []
    y, unit = data.y, display_quantity("", data.y_unit or "")
    falls = course.falls
    for name, way, farthest in (("lower", -1, float(y.min())), ("upper", 1, float(y.max()))):
        if course.may_meet[-way if falls else way]:
            continue
        place = f"{number(farthest * unit.factor, 4)} {unit.unit}".rstrip()
        sentences.append(
            f"the first record shows no {name} end stop, so the input keeps the joint "
            f"{'above' if way < 0 else 'below'} {place}, where it was farthest, and this experiment will not "
            "show that stop either; if the joint may run into it, add --to-stops"
        )
    if not course.may_meet[-1]:  # else the experiment begins with a run to that end
        start = f"{number(float(y[0, 0]) * unit.factor, 4)} {unit.unit}".rstrip()
        sentences.append(f"begin the experiment at {start}, where the first record began")
    return sentences


def shortfalls(names: Iterable[str], now: Sequence[JointValue], then: Sequence[JointValue], Ts: float) -> list[str]:
    """Sentences for the values `names` that an experiment in samples of `Ts` is not expected to determine, and for
    those that it tells less well than the first record does."""
    missing, wider = [], []
    values_now, values_then = ({v.name: v for v in values} for values in (now, then))
    for name in names:
        old, new = values_now.get(name), values_then.get(name)
        if name.startswith("end_") and not (old and old.determined):
            continue  # see `unmet`
        if new is None or not new.determined:
            missing.append(_WORDS[name] + _missing_reason(name, values_then))
        elif _width(new) > _WIDER * (_width(old) if old else np.inf):
            wider.append(_WORDS[name])
    sentences = []
    if missing:
        sentences.append(
            f"this experiment is not expected to determine: {'; '.join(missing)}. Try a shorter sampling time, "
            f"--sample {Ts / 2:.3g}, or larger inputs, --volts"
        )
    if wider:
        sentences.append(f"the first record tells more than this experiment is expected to tell of: {', '.join(wider)}")
    return sentences


def weak_inputs(course: Course, unit: str) -> list[str]:
    """A sentence if the largest inputs may not start a joint with much friction at rest."""
    middle, friction = course.band
    largest = f"{number(-course.tops[-1], 3)} and {number(course.tops[1], 3)} {unit}".rstrip()
    share = min((course.tops[way] - way * middle) / friction for way in (1, -1))
    if share >= _STRONG_INPUT:
        return []
    return [
        f"the largest inputs, {largest}, are only {share:.2f} times the friction in motion (beside the load): a joint "
        "with more friction at rest does not start; allow larger inputs (--volts) or speeds (--strike)"
    ]


def distant_prediction(course: Course, y: np.ndarray, data: IOData) -> list[str]:
    """A sentence if the predicted y (N,) leaves the range of `data` by more than the range itself."""
    low, high, unit = float(data.y.min()), float(data.y.max()), display_quantity("", data.y_unit or "")
    farthest = float(y[np.argmax(np.abs(y - 0.5 * (low + high)))])
    if low - (high - low) <= farthest <= high + (high - low):
        return []
    place = f"{number(farthest * unit.factor, 4)} {unit.unit}".rstrip()
    return [
        f"the prediction goes to {place}: the first fit has no end stop there; leave --to-stops out if the joint "
        "has none"
    ]


def _missing_reason(name: str, values: Mapping[str, JointValue]) -> str:
    """Why a value is not determined, in brackets, without what to record next; '' if nothing is told."""
    value = values.get(name) or values.get(name.replace("breakaway", "moving_friction"))
    reason = value.why.removeprefix("break-away is not determined: ") if value else ""
    return f" ({_ADVICE.split(reason)[0]})" if reason else ""


def _width(value: JointValue) -> float:
    """Width of the interval; infinite without one."""
    if value.low is None or value.high is None:
        return np.inf
    return value.high - value.low
