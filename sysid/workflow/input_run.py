"""A saved model on a file that has inputs alone: its run from rest."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import versions
from sysid.channels.column import numeric_columns
from sysid.channels.guess import Given, guess
from sysid.channels.reading import read_map_of, sample
from sysid.channels.signals import common_text, common_unit
from sysid.data.record import IOData
from sysid.data.table import Table
from sysid.data.trends import restore_offsets
from sysid.estimation.free_run import quiet
from sysid.estimation.result import Fit
from sysid.formats import read_table
from sysid.workflow.record import Record, columns
from sysid.workflow.saved import AnyFit, Reading, Saved, data_for, remarks


@dataclass(frozen=True)
class InputRun:
    """A model's run from rest under the input of `data`: output (N, ny); the outputs of `data` are none."""

    model: Saved
    record: Record
    data: IOData
    output: np.ndarray
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal run`, ready for JSON."""
        return {
            "model": self.model.as_dict(),
            "read": self.record.as_dict(),
            "fit_percent": None,
            "notes": list(self.notes),
            "next": None,
            "versions": versions(),
        }


def record_of_inputs(fit: AnyFit, reading: Reading, table: Table | None = None) -> Record | None:
    """The record of a file with the inputs of `fit` alone, with zero for its outputs; None for another file.

    `table` is the file's, where it is read already.
    """
    table, notes = read_table(reading.path) if table is None else table, tuple[str, ...]()
    if reading.mapping is not None:
        mapping = read_map_of(reading.mapping)
    else:
        first, *further = columns(reading.input, table.names) or (None,)
        given = Given(first, None, reading.time, reading.time_unit, reading.Ts, {"input": tuple(further)})
        guessed = guess(table, given)
        mapping, notes = guessed.mapping, guessed.why
        known = {mapping.clock.column, *(channel.column for channel in mapping.input)}
        others = (c for name, c in numeric_columns(table).items() if name not in known and not (c.constant or c.dated))
        if reading.output is not None or mapping.output[0].column or len(guessed.unclear) > 1:
            return None
        left = [name for name in numeric_columns(table) if name not in known]
        if not mapping.input[0].column and len(left) == 1 and left[0].isdigit():  # columns without names
            raise InputError(
                f"{reading.path}: no header says whether column {left[0]} is the input; a run from rest needs the "
                f"input alone: give --input {left[0]}"
            )
        if any(others):
            return None
        mapping = mapping.model_copy(update={"output": ()})
    if mapping.output or not all(channel.column for channel in mapping.input) or not mapping.input:
        return None
    signals = sample(table, mapping.within(reading.range.start, reading.range.stop), notes)
    u, origin = signals.input, fit.origin
    ny = fit.model.channels[1] if isinstance(fit, Fit) else 1
    data = IOData(
        np.column_stack([signal.values for signal in u]),
        np.zeros((signals.N, ny)),
        signals.Ts,
        *(common_text([signal.name for signal in u]) or "u", "y" if origin is None else origin.y_name),
        *(common_unit([signal.unit for signal in u]), "" if origin is None else origin.y_unit),
    )
    names = ",".join(signal.column for signal in u)
    return Record(table.path, data, names, "", signals.mapping.clock.column or None, signals)


@quiet()
def run_inputs(saved: Saved, record: Record, reading: Reading, horizon: int | None) -> InputRun:
    """The run of `saved` from rest on the record that `record_of_inputs` gave; raises the errors of `data_for`."""
    fit = saved.fit
    if horizon is not None:
        raise InputError(
            f"--horizon is {horizon} and {record.path} has no output: a prediction needs measured ones; leave it out"
        )
    data, notes = data_for(fit, record, reading)
    levelled = fit.own_level(data)
    output = restore_offsets(fit.simulate(levelled.u).reshape(data.y.shape), levelled, data)
    if isinstance(fit, Fit):
        rest = "filters and speeds at zero"
        rest += ", positions where its estimation data began" if any(s.holds for s in fit.model.slots) else ""
    else:
        rest = "all earlier signals at zero"
    rest += ", counted from the levels of its estimation data" if levelled is not data else ""
    sentence = f"the record has no output to compare with: the model runs from rest, {rest}"
    return InputRun(saved, record, data, output, (sentence, *notes, *remarks(fit, data, output, from_rest=True)))
