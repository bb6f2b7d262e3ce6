"""A calibration as a parameter file that other verbs take, with intervals and provenance in comments."""

import math
from pathlib import Path

from sysid.base.files import write_text
from sysid.base.quantities import number
from twin.calibrate import doubt
from twin.calibrate.leg import DELAY, ROWS
from twin.calibrate.result import Calibration, Value
from twin.parameter_file import to_toml


def write(calibration: Calibration, path: str | Path) -> Path:
    """Write every row that differs from nominal as TOML; `twin.parameter_file.read` gives back every bit."""
    said = {value.name: comment(value, calibration.level) for value in calibration.values}
    said |= {row: f"{ROWS[row].unit}; not calibrated, set beyond the angles of the logs" for row in calibration.moved}
    return write_text(Path(path), to_toml(calibration.parameters, _head(calibration), said))


def comment(value: Value, level: float) -> str:
    """Unit, interval and nominal value."""
    unit = "no unit" if value.unit == "1" else value.unit
    factor, shown = (180.0 / math.pi, "deg") if value.unit == "rad" else (1.0, "")
    low, high = (number(factor * bound, 5) for bound in (value.low, value.high))
    nominal = number(value.nominal, 4)
    if value.name == DELAY:
        unit += f", found {number(value.value, 4)} and rounded to whole periods of the board"
    lost = doubt.why(value)
    unit = f"NOT DETERMINED by the logs; {unit}" if lost else unit
    return f"{unit}; {100 * level:g} % interval {low} to {high}{f' {shown}' if shown else ''}; was {nominal}"


def _head(calibration: Calibration) -> list[str]:
    told = calibration.provenance
    lines = [
        f"Parameters of the twin in SI units, {calibration.joint} calibrated; parameters not named are nominal.",
        f"Logs: {', '.join(told['logs'])}. Left out: {', '.join(told['without']) or 'nothing'}.",
        "Forces are relative to the motor's data sheet (stall force or torque, rated voltage, gear).",
        f"The search {'ended' if calibration.converged else 'DID NOT CONVERGE'}: {calibration.reason}.",
    ]
    for score in calibration.scores:
        kind = "held out" if score.held_out else "used"
        lines.append(f"{score.log} ({kind}): fit {score.fit_before:.2f} % before, {score.fit_after:.2f} % after.")
    lines += doubt.sentences(calibration)
    return [*lines, *(f"Not calibrated: {sentence}" for sentence in calibration.fixed.values())]
