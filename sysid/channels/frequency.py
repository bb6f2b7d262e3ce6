"""A table of a frequency response: what makes it one, its columns by their names, and what it lacks."""

import re
from collections.abc import Sequence

import numpy as np

from sysid.base.errors import InputError
from sysid.channels.clock import is_named_clock
from sysid.channels.column import Column, numeric_columns, words
from sysid.channels.complex_columns import with_parts
from sysid.data.frequency import FrequencyData, frequency_data
from sysid.data.table import Table

_NAMES = {
    "frequency": words("frequency freq frequenz omega f w"),
    "magnitude": words("magnitude mag gain amplitude modulus abs betrag verstärkung"),
    "phase": words("phase angle arg phi"),
    "real": words("real re"),
    "imaginary": words("imaginary imag im"),
    "coherence": words("coherence coh kohärenz"),
    "std": words("std sigma deviation"),
}
_HERTZ = {"hz": 2.0 * np.pi, "khz": 2e3 * np.pi, "mhz": 2e-3 * np.pi, "rad/s": 1.0, "rad": 1.0, "rad/sec": 1.0}
_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
_TURN = {
    "grad": np.pi / 180.0,
    "deg": np.pi / 180.0,
    "°": np.pi / 180.0,
    "degrees": np.pi / 180.0,
    "degree": np.pi / 180.0,
    "rad": 1.0,
}
_HOW = (
    "frequency data have a column frequency [Hz] or [rad/s], and magnitude [dB] or [abs] with phase [deg] or [rad], or "
    "real and imag; beside them coherence, or std, the deviation of real and imaginary part"
)


def frequency_of(table: Table, Ts: float | None = None) -> FrequencyData | None:
    """The frequency response in a table; None of one that is none, or has a clock.

    Where other columns stand beside those of a response, its frequencies rise or fall: else it may be a log with a
    chirp. A response alone may have its rows in any order. Raises InputError for one that lacks something, in a
    sentence that names the file and how its rows are read as samples in time.
    """
    columns = numeric_columns(with_parts(table))
    named = _by_name(list(columns.values()))
    found = {kind: each[0] for kind, each in named.items()}
    others = [kind for kind in ("magnitude", "phase", "real", "imaginary") if kind in found]
    frequency = found.get("frequency")
    if frequency is None or not others or any(is_named_clock(c.header) for c in columns.values()):
        return None
    is_whole = {"magnitude", "phase"} <= {*others} or {"real", "imaginary"} <= {*others}
    is_alone = sum(map(len, named.values())) == len(columns)
    if not is_whole and not is_alone:
        return None  # a log of a chirp may have its frequency and an angle beside other signals
    is_named = _unit(frequency, _HERTZ) or frequency.header.has(words("frequency freq frequenz omega"))
    if not is_named and not (is_whole and is_alone):
        return None  # a force f or a speed w
    steps = np.diff(frequency.values)
    is_sorted = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    if not len(steps) or np.any(frequency.values < 0.0) or not (is_sorted or (is_whole and is_alone)):
        return None
    try:
        for kind, each in named.items():
            if len(each) > 1:
                raise InputError(f"{' and '.join(repr(c.name) for c in each)} are both a {kind}; leave out all but one")
        return _response(found, Ts)
    except InputError as error:
        raise InputError(
            f"{table.path} seems to be a frequency response; {error}; where its rows are samples in time instead, name "
            "--input and --output, and give --ts SECONDS"
        ) from None


def _by_name(columns: Sequence[Column]) -> dict[str, list[Column]]:
    """The columns of each kind; "phase of real" is none of the second."""
    found: dict[str, list[Column]] = {}
    for column in columns:
        kinds = [kind for kind, names in _NAMES.items() if column.header.has(names)]
        if len(kinds) > 1 and "frequency" in kinds:  # f_re
            kinds.remove("frequency")
        if len(kinds) > 1 and "magnitude" in kinds and not column.header.has(words("magnitude mag")):
            kinds.remove("magnitude")  # the phase of a gain
        if not kinds and re.search(r"\|.+\|", column.name):
            kinds = ["magnitude"]
        if kinds:
            found.setdefault(kinds[0], []).append(column)
    return found


def _unit(column: Column, units: dict[str, float]) -> float:
    """What the values of a column are to be multiplied with, by the unit in its name; 0 without one."""
    brackets = _BRACKETS.search(column.name)
    texts = (column.header.unit.strip().lower(), brackets[1].lower() if brackets else "", *sorted(column.header.words))
    return next((units[text] for text in texts if text in units), 0.0)


def _response(found: dict[str, Column], Ts: float | None) -> FrequencyData:
    factor, column = _unit(found["frequency"], _HERTZ), found["frequency"]
    if not factor:
        raise InputError(f"column {column.name!r} has no unit; write it behind the name, [Hz] or [rad/s]")
    if "real" in found and "imaginary" in found:
        response = found["real"].values + 1j * found["imaginary"].values
        unit = found["real"].header.unit
    elif "magnitude" in found and "phase" in found:
        size, unit = _magnitude(found["magnitude"])
        turn = _unit(found["phase"], _TURN)
        if not turn:
            raise InputError(f"column {found['phase'].name!r} has no unit; write it behind the name, [deg] or [rad]")
        response = size * np.exp(1j * turn * found["phase"].values)
    else:
        missing = {"magnitude": "phase", "phase": "magnitude", "real": "imag", "imaginary": "real"}
        lacks = next(other for kind, other in missing.items() if kind in found)
        raise InputError(f"it has no column {lacks}; {_HOW}")
    w = factor * column.values
    if (count := len(w) - len(np.unique(w))) > 0:
        raise InputError(f"{count} of its {len(w)} frequencies stand there twice; leave out all but one row of each")
    keep = (w > 0.0) & np.isfinite(response)  # at 0 an integrator has no response, and its phase says nothing
    std = found["std"].values[keep] if "std" in found else None
    coherence = found["coherence"].values[keep] if "coherence" in found and std is None else None
    y_unit, _, u_unit = unit.partition("/")
    return frequency_data(w[keep], response[keep], std, coherence, Ts=Ts, y_unit=y_unit, u_unit=u_unit)


def _magnitude(column: Column) -> tuple[np.ndarray, str]:
    """The size of the response (n,), and its unit Y/U where the name has it."""
    unit, values = column.header.unit.strip(), column.values
    if unit.lower() == "db" or column.header.has({"db"}):
        return 10.0 ** (values / 20.0), ""
    if not unit and not column.header.has(words("abs modulus betrag")):
        raise InputError(f"column {column.name!r} has no unit; write it behind the name, [dB], [abs] or that of y/u")
    if np.any(values < 0.0):
        raise InputError(
            f"column {column.name!r} has values below 0, which no magnitude has; if it is in dB, write [dB]"
        )
    if unit.lower() in ("", "abs", "1", "-", "lin", "linear"):
        return values, ""
    if "/" not in unit:  # the size of a signal, as in a record of a run-up
        raise InputError(
            f"column {column.name!r} is in {unit}, and a response in a unit of y/u; write it behind the name, [dB], "
            f"[abs] or such as [{unit}/V]"
        )
    return values, unit
