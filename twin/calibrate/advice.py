"""What to do with a calibration: values that the logs do not determine, what to record, and the file of parameters."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

from sysid.base.files import write_text
from sysid.base.quantities import display_quantity, estimate, number
from twin.calibrate.leg import DELAY, ROWS, scale
from twin.calibrate.result import Calibration, Value
from twin.parameter_file import to_toml

PLAUSIBLE = 4.0  # scales: a wider interval says less than was plausible before the log was seen
MOST = 0.5  # of the allowed range, the same
EDGE = 1e-6  # of the allowed range: nearer to its end, a value is on it
ONE = 0.995  # correlation that is shown as 1.00


def reason_undetermined(value: Value) -> str:
    """Why the log does not determine the value, in a few words; empty if it does."""
    row = ROWS[value.name]
    width, reach, plausible = value.high - value.low, row.upper - row.lower, PLAUSIBLE * scale(value.name, row.nominal)
    is_news = value.low > row.nominal + plausible / 2 or value.high < row.nominal - plausible / 2  # none was plausible
    q = display_quantity(value.name, value.unit)
    for end, name in ((row.lower, "lower"), (row.upper, "upper")):
        if abs(value.value - end) <= EDGE * reach and end != 0.0:  # at 0 an effect is absent, which may be true
            return f"on the {name} end of its range, {number(q.factor * end, 3)} {q.unit}".rstrip()
    if width > (MOST * reach if is_news else min(plausible, MOST * reach)):
        low, high = (number(q.factor * end, 3) for end in (value.low, value.high))
        return f"anything from {low} to {high} {q.unit}".rstrip()
    return ""


def undetermined_rows(result: Calibration) -> dict[str, str]:
    """Calibrated rows that the logs do not determine, each with why."""
    reasons = {value.name: reason_undetermined(value) for value in result.values}
    return {name: words for name, words in reasons.items() if words}


def useless(result: Calibration) -> bool:
    """Whether the logs determine none of the parameters, so that the file is not to be used."""
    return len(undetermined_rows(result)) == len(result.values)


def sentences(result: Calibration) -> list[str]:
    """What is not to be used, and what acts alike; empty for a calibration that determines all."""
    reasons, texts = undetermined_rows(result), list[str]()
    if reasons:
        is_useless = useless(result)
        listing = "; ".join(f"{name} ({words})" for name, words in reasons.items())
        use = "do not use the file" if is_useless else "do not use the file for these"
        texts.append(
            f"These logs do not determine {'any of the parameters' if is_useless else 'all'}: {listing}. So {use}."
        )
    names = [value.name for value in result.values]
    pairs = [
        f"{names[i]} and {names[j]} ({number(float(result.correlation[i, j]), 3)})"
        for i, j in combinations(range(len(names)), 2)
        if abs(result.correlation[i, j]) >= ONE
    ]
    if pairs:
        texts.append(
            f"These act alike in the logs, so that only a combination is told (correlation): {'; '.join(pairs)}."
        )
    return texts


def again(result: Calibration, fix: Sequence[str] = (), by_run: Sequence[str] = ()) -> str:
    """The command of the same calibration with more rows fixed, or with a value of their own in each log."""
    plain = ["qpal", "calibrate", *result.provenance["logs"], "--joint", result.joint]
    words = [result.provenance.get("command") or shlex.join(plain)]
    known = result.provenance.get("fixed", ())
    for option, rows in (("--by-run", (*result.by_run, *by_run)), ("--fix", (*known, *fix))):
        words += [option, ",".join(row.rpartition(".")[2] for row in rows)] if rows else []
    return " ".join(words)


def next_step(result: Calibration) -> str:
    """What to do about values that are not determined; empty if all are."""
    reasons = undetermined_rows(result)
    if not reasons:
        return ""
    record = "; ".join(dict.fromkeys(what_to_record(result.joint, name) for name in reasons))
    if useless(result):
        return f"Next, to determine them: {record}"
    return f"Next: {again(result, fix=list(reasons))}; or, to determine them: {record}"


_ENDS = (
    "drive the {joint} into both end stops at full voltage: qpal simulate --joint {joint} --excitation sweep shows how"
)
_LEVELS = (
    "let it start often from many low voltages: "
    "qpal simulate --joint {joint} --excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs shows how"
)
_STEPS = (
    "record at least 100 samples a second under random levels: "
    "qpal simulate --joint {joint} --excitation aprbs --ts 0.01 shows how"
)
_ADVICE = {
    "retracted_length": _ENDS,
    "stroke": _ENDS,
    "lower": _ENDS,
    "upper": _ENDS,
    "no_load_speed": "drive it at several voltages: qpal simulate --joint {joint} --excitation aprbs shows how",
    "coulomb": _LEVELS,
    "asymmetry": _LEVELS,
    "stribeck": _LEVELS,
    "stribeck_speed": _LEVELS,
    "dead_band": "measure the voltage of the bridge without a motor at a small duty",
    "rotor_inertia": _STEPS,
    "delay": _STEPS,
    "backlash": (
        "let the link cross its backlash, for example with the leg on its side; "
        "with the drive at rest and power off, move the link by hand"
    ),
    "load_friction": "record once more with a known weight on the foot",
    "stall_force": "measure the force of the stalled motor, or record once more with a known weight on the foot",
    "stall_torque": "measure the torque of the stalled motor, or record once more with a known weight on the foot",
}
_ANY = "record the {joint} from end stop to end stop, at several voltages, with rests"


def what_to_record(joint: str, row: str) -> str:
    """What to record to tell `row` of `joint`, as the second half of a sentence."""
    return _ADVICE.get(row.rpartition(".")[2], _ANY).format(joint=joint)


def file_of_log(calibration: Calibration, k: int) -> str:
    """The name of the file with the values of log number k, which has its number where two logs have one name."""
    stems = [Path(log).stem for log in calibration.provenance["logs"]]
    return f"{calibration.joint}-{stems[k]}{f'-{k + 1}' if stems.count(stems[k]) > 1 else ''}.toml"


def write(calibration: Calibration, path: str | Path) -> Path:
    """Write every row that differs from nominal as TOML; `twin.parameter_file.read` gives back every bit.

    Rows with a value in each log have the mean over those that agree, and a file beside `path` for each log.
    """
    logs, path = calibration.provenance["logs"], Path(path)
    means = {
        row: f"{ROWS[row].unit}; mean over {', '.join(logs[k] for k in which)}"
        for row, which in calibration.typical.items()
    }
    for k in range(len(logs)) if means else ():
        own = {row: comment(calibration.by_run[row][k], calibration.level) for row in means}
        _write(replace(calibration, parameters=calibration.of_log(k)), path.with_name(file_of_log(calibration, k)), own)
    return _write(calibration, path, means)


def _write(calibration: Calibration, path: Path, by_run: dict[str, str]) -> Path:
    comments = {value.name: comment(value, calibration.level) for value in calibration.values} | by_run
    comments |= {
        row: f"{ROWS[row].unit}; not calibrated, set beyond the angles of the logs" for row in calibration.moved
    }
    return write_text(path, to_toml(calibration.parameters, _head(calibration), comments))


def comment(value: Value, level: float) -> str:
    """Unit, interval and nominal value."""
    unit = "no unit" if value.unit == "1" else value.unit
    factor, shown = (180.0 / math.pi, "deg") if value.unit == "rad" else (1.0, "")
    _, low, high = estimate(*(factor * x for x in (value.value, value.low, value.high)))
    nominal = number(value.nominal, 4)
    if value.name == DELAY:
        unit += f", found {number(value.value, 4)} and rounded to whole periods of the board"
    reason = reason_undetermined(value)
    unit = f"NOT DETERMINED by the logs; {unit}" if reason else unit
    return f"{unit}; {100 * level:g} % interval {low} to {high}{f' {shown}' if shown else ''}; was {nominal}"


def _head(calibration: Calibration) -> list[str]:
    """Comments above the values: logs, how the search ended, scores, and what is not determined."""
    provenance = calibration.provenance
    lines = [
        f"Parameters of the twin in SI units, {calibration.joint} calibrated; parameters not named are nominal.",
        f"Logs: {', '.join(provenance['logs'])}. Left out: {', '.join(provenance['without']) or 'nothing'}.",
        "Forces are relative to the motor's data sheet (stall force or torque, rated voltage, gear).",
        f"The search {'ended' if calibration.converged else 'DID NOT CONVERGE'}: {calibration.reason}.",
    ]
    for score in calibration.scores:
        kind = "held out" if score.held_out else "used"
        lines.append(f"{score.log} ({kind}): fit {score.fit_before:.2f} % before, {score.fit_after:.2f} % after.")
    lines += sentences(calibration)
    return [*lines, *(f"Not calibrated: {sentence}" for sentence in calibration.fixed.values())]
