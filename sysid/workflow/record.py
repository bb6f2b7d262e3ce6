"""From a file and its named columns to a record ready for identification."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.formats import read_table

OWN = {"input": "voltage_V", "output": "angle_rad", "time": "time_s"}  # the columns that a log of ours has
QUANTITY = {"voltage_V": ("voltage", "V"), "angle_rad": ("angle", "rad"), "angle_true_rad": ("true angle", "rad")}
STEP_TOLERANCE = (
    0.01  # a time step may differ from the middle one by this part of it: printed digits, not a lost sample
)


@dataclass(frozen=True)
class Record:
    """The data and their source columns."""

    path: Path
    data: IOData
    input: str
    output: str
    time: str | None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict:
        """File, columns, Ts [s] and number of samples, for a summary."""
        return {
            "file": str(self.path),
            "input": self.input,
            "output": self.output,
            "time": self.time,
            "Ts": self.data.Ts,
            "samples": self.data.N,
            "notes": list(self.notes),
        }


def read_record(
    path: str | os.PathLike[str],
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
) -> Record:
    """The record in the file at `path`, from the named columns.

    Ts [s] comes from `Ts` or from the `time` column [s]. A log of `qpal simulate` needs no column names; a file of two
    columns is read as input, output. `notes` lists the assumptions. Raises InputError with file and place for missing
    columns, columns of different lengths, cells that are not finite numbers, a constant signal, or a time column that
    does not increase or is not uniform.
    """
    table = read_table(path)
    input, output, notes = _columns(table, input, output)
    u, y = table.numbers(input), table.numbers(output)
    if len(u) != len(y):
        raise InputError(
            f"{table.path}: column {input!r} has {len(u)} samples and {output!r} has {len(y)}; name two of one length"
        )
    if time is None and Ts is None and OWN["time"] in table.names:
        time = OWN["time"]
    Ts = _sampling_time(table, time, Ts, len(u))
    _check_moves(table, "input", input, u)
    _check_moves(table, "output", output, y)
    u_name, u_unit = QUANTITY.get(input, (input if not input.isdigit() else "input", ""))
    y_name, y_unit = QUANTITY.get(output, (output if not output.isdigit() else "output", ""))
    data = IOData(u, y, Ts, u_name, y_name, u_unit, y_unit)
    return Record(table.path, data, input, output, time, tuple(notes))


def _columns(table: Table, input: str | None, output: str | None) -> tuple[str, str, list[str]]:
    notes = []
    names = table.names
    if input is None and output is None:
        if OWN["input"] in names and OWN["output"] in names:
            input, output = OWN["input"], OWN["output"]
        elif len(names) == 2:
            input, output = names
        if input is not None:
            notes.append(f"read column {input!r} as the input and {output!r} as the output")
    missing = [option for option, given in (("--input", input), ("--output", output)) if given is None]
    if missing:
        wanted = " and one with ".join(missing)
        raise InputError(f"{table.path}: found {len(names)} columns ({', '.join(names)}); name one with {wanted}")
    assert input is not None
    assert output is not None
    if input == output and input in names:
        raise InputError(f"{table.path}: column {input!r} is given as input and as output; name two columns")
    return input, output, notes


def _sampling_time(table: Table, time: str | None, Ts: float | None, N: int) -> float:
    if Ts is not None and not (np.isfinite(Ts) and Ts > 0):
        raise InputError(f"--ts is {Ts:g}; give the sampling time as a positive number of seconds")
    if time is None:
        if Ts is None:
            raise InputError(
                f"{table.path}: no sampling time is given; give it with --ts SECONDS or name a time column with --time"
            )
        return Ts
    measured = _uniform_step(table, time, N)
    if Ts is not None and abs(Ts - measured) > STEP_TOLERANCE * measured:
        raise InputError(
            f"{table.path}: --ts is {Ts:g} s but column {time!r} steps by {measured:g} s; leave one of the two out"
        )
    return measured


def _uniform_step(table: Table, name: str, N: int) -> float:
    """The step [s] of a uniformly increasing time column."""
    t = table.numbers(name)
    if len(t) != N:
        raise InputError(f"{table.path}: column {name!r} has {len(t)} samples and the signals have {N}; name another")
    if N < 2:
        raise InputError(f"{table.path} has {N} sample; at least 2 are needed")
    j, steps = table.names.index(name), np.diff(t)
    back = np.flatnonzero(steps <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise table.error(j, k, f"found {t[k]:g} s after {t[k - 1]:g} s; time must increase; sort or remove the rows")
    middle = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - middle) > STEP_TOLERANCE * middle)
    if len(off):
        k = int(off[0]) + 1
        raise table.error(
            j,
            k,
            f"found a step of {steps[k - 1]:g} s where most are {middle:g} s (within {STEP_TOLERANCE:.0%}); "
            "resample the record uniformly or cut it there",
        )
    # Printed times are rounded; the mean over the record is not, and a whole microsecond is meant as one.
    return float(f"{(t[-1] - t[0]) / (N - 1):.9g}")


def _check_moves(table: Table, role: str, name: str, values: np.ndarray) -> None:
    if len(values) < 2:
        raise InputError(f"{table.path}: column {name!r} has {len(values)} sample; at least 2 are needed")
    if np.ptp(values) == 0:
        raise InputError(
            f"{table.path}: the {role} {name!r} is {values[0]:g} in all {len(values)} samples; "
            f"choose a column that moves"
        )
