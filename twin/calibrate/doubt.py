"""Which calibrated values a log does not determine, although the search ended, and which of them act alike."""

from itertools import combinations

from sysid.base.quantities import display_quantity, number
from twin.calibrate.advice import what_to_record
from twin.calibrate.leg import ROWS, scale
from twin.calibrate.result import Calibration, Value

PLAUSIBLE = 4.0  # scales: a wider interval says less than was plausible before the log was seen
MOST = 0.5  # of the allowed range, the same
EDGE = 1e-6  # of the allowed range: nearer to its end, a value is on it
ONE = 0.995  # correlation that is shown as 1.00


def why(value: Value) -> str:
    """Why the log does not determine the value, in a few words; empty if it does."""
    row = ROWS[value.name]
    width, reach = value.high - value.low, row.upper - row.lower
    q = display_quantity(value.name, value.unit)
    for end, name in ((row.lower, "lower"), (row.upper, "upper")):
        if abs(value.value - end) <= EDGE * reach and end != 0.0:  # at 0 an effect is absent, which may be true
            return f"on the {name} end of its range, {number(q.factor * end, 3)} {q.unit}".rstrip()
    if width > min(PLAUSIBLE * scale(value.name, row.nominal), MOST * reach):
        low, high = (number(q.factor * end, 3) for end in (value.low, value.high))
        return f"anything from {low} to {high} {q.unit}".rstrip()
    return ""


def undetermined(result: Calibration) -> dict[str, str]:
    """Calibrated rows that the logs do not determine, each with why."""
    found = {value.name: why(value) for value in result.values}
    return {name: words for name, words in found.items() if words}


def useless(result: Calibration) -> bool:
    """Whether the logs determine none of the parameters, so that the file is not to be used."""
    return len(undetermined(result)) == len(result.values)


def sentences(result: Calibration) -> list[str]:
    """What is not to be used, and what acts alike; empty for a calibration that determines all."""
    lost, said = undetermined(result), list[str]()
    if lost:
        all_ = useless(result)
        told = "; ".join(f"{name} ({words})" for name, words in lost.items())
        use = "do not use the file" if all_ else "do not use the file for these"
        said.append(f"These logs do not determine {'any of the parameters' if all_ else 'all'}: {told}. So {use}.")
    names = [value.name for value in result.values]
    same = [
        f"{names[i]} and {names[j]} ({number(float(result.correlation[i, j]), 3)})"
        for i, j in combinations(range(len(names)), 2)
        if abs(result.correlation[i, j]) >= ONE
    ]
    if same:
        said.append(
            f"These act alike in the logs, so that only a combination is told (correlation): {'; '.join(same)}."
        )
    return said


def next_step(result: Calibration, files: str) -> str:
    """What to do about values that are not determined; empty if all are."""
    lost = undetermined(result)
    if not lost:
        return ""
    record = "; ".join(dict.fromkeys(what_to_record(result.joint, name) for name in lost))
    if useless(result):
        return f"Next, to determine them: {record}"
    short = ",".join(name.rpartition(".")[2] for name in lost)
    return f"Next: qpal calibrate {files} --joint {result.joint} --fix {short}; or, to determine them: {record}"
