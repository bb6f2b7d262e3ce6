"""From a log to the next experiment: a joint is fitted to the log, and an input is designed on the fit."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import versions
from sysid.base.quantities import Quantity, display_quantity
from sysid.channels.conversion import convert
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import Range
from sysid.channels.reading import sample as sample_table
from sysid.channels.signals import resample_signals
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.formats import check_written, read_table, write_table
from sysid.joint.clock import Clock
from sysid.joint.design import Design, design
from sysid.joint.posterior import fit_joint
from sysid.joint.values import displayed_value
from sysid.joint.verdict import verdict
from sysid.structures import ActuatedJoint
from sysid.workflow.record import Record, read_record, with_places

_SHORTEST_USE = 20  # samples: fewer are no motion
_LITTLE = 0.05  # of the range of the inputs that are tried


@dataclass(frozen=True)
class Proposal:
    """The log, the joint fitted to it, and the next experiment."""

    record: Record
    fit: Fit
    design: Design

    @property
    def command(self) -> str:
        """The command that identifies the joint once the second record exists: of both, if it was made for a use.

        The columns are those of the first record, the range is not.
        """
        files = ["RECORDED.csv"] if self.design.use is None else [str(self.record.path), "RECORDED.csv"]
        pairs = zip(self.record.options[::2], self.record.options[1::2], strict=True)
        options = [word for pair in pairs if pair[0] != "--range" for word in pair]
        return shlex.join(["qpal", "identify", *files, *options, "--structure", ActuatedJoint.name])

    @property
    def speed(self) -> Quantity:
        """How speeds of the output are told: in degrees per second where it is an angle."""
        return display_quantity("speed", f"{self.design.units[1] or '1'}/s")

    @property
    def strike_unit(self) -> str:
        """The unit in which `strike` is given: that of the output's column per second."""
        return f"{_column_unit(self.record) or '1'}/s"

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal design`, ready for JSON."""
        return {
            "record": self.record.as_dict(),
            "fit_percent": self.fit.fit_percent(self.record.data),
            **self.design.as_dict(),
            "largest_input_unit": self.design.units[0],
            "fastest": self.design.fastest * self.speed.factor,
            "fastest_unit": self.speed.unit,
            "now": [vars(displayed_value(v)) for v in self.design.now],
            "then": [vars(displayed_value(v)) for v in self.design.then],
            "next": self.command,
            "versions": versions(),
        }


def propose(
    path: str,
    targets: tuple[str, ...],
    volts: float | None = None,
    strike: float | None = None,
    seed: int = 0,
    sample: float | None = None,
    to_stops: bool = False,
    use: str | None = None,
    progress: Callable[[], None] = lambda: None,
    heard: Callable[[str], None] | None = None,
    seconds: float = np.inf,
    **columns: Any,
) -> Proposal:
    """The next experiment on the joint in the log at `path`, in samples of `sample` [s]; `columns` as in `read_record`.

    volts: largest input [unit of u]. strike: largest speed, in the unit of the output's column per second. `to_stops`:
    it may run into stops that the log does not show. `use`: a file with the input that the joint will get, for which
    the experiment is designed (`sysid.joint.use`). `progress` is called before the fit, `heard` with a text after
    each search of it; after `seconds` the fit is stopped, as `sysid.fit_joint` says, with a note in the design, and no
    more parts for a use are sought. Raises InputError for limits that are not positive or longer samples than the
    log's, before any fit; for a file that is no log, a log that is not a joint's, and as `sysid.joint.design.design`. A
    log that does not show whether it is a joint's is named in the notes.
    """
    for name, value in (("volts", volts), ("strike", strike), ("sample", sample)):
        if value is not None and not 0.0 < value < np.inf:
            raise InputError(f"--{name} is {value:g}; give a positive number, or leave it out")
    record = with_places(read_record(path, **columns))
    if sample is not None and sample > record.data.Ts:
        raise InputError(
            f"--sample is {sample:g} s and the log has a sample every {record.data.Ts:g} s; give at most this"
        )
    wanted = None if use is None else input_of_use(use, record)
    strike = None if strike is None else strike * convert(_column_unit(record)).factor
    progress()
    data, clock = ActuatedJoint().scale(record.data), Clock(seconds)
    found = fit_joint(data, seed=seed, progress=heard, seconds=seconds)
    judgement = verdict(found, data)
    if not judgement.joint and not judgement.undetermined:
        prefix = f"{found.stopped}; " if found.stopped else ""
        raise InputError(
            f"{prefix}{judgement.sentence()} No experiment is designed from it. To see the fit: "
            + shlex.join(["qpal", "identify", str(path), *record.options, "--structure", ActuatedJoint.name])
        )
    fit = found.fit
    experiment = design(fit, data, targets, volts, strike, seed, sample, to_stops=to_stops, use=wanted, clock=clock)
    if wanted is not None:
        experiment = replace(experiment, notes=(*experiment.notes, *_beyond(wanted, experiment, data, volts)))
    if judgement.undetermined:
        experiment = replace(experiment, notes=(judgement.sentence().rstrip("."), *experiment.notes))
    if found.stopped:
        experiment = replace(experiment, notes=(found.stopped, *experiment.notes))
    return Proposal(record, fit, experiment)


def input_of_use(path: str, record: Record) -> np.ndarray:
    """The input (N,) in the file at `path`, in the column that the record's has, at the record's sampling time.

    Raises InputError for a file without this column or a clock, and for an input that is too short or never moves.
    """
    table = read_table(path)
    given = Given(input=record.input if record.input in table.names else None)
    mapping = guess(table, given).mapping.model_copy(update={"output": (), "other": (), "range": Range()})
    if not mapping.input[0].column:
        raise InputError(f"{path}: no column {record.input!r}, the input of {record.path}; name it so")
    u = resample_signals(sample_table(table, mapping), record.data.Ts).input[0].values
    if len(u) < _SHORTEST_USE or np.ptp(u) == 0.0:
        raise InputError(
            f"{path}: the input of use has {len(u)} samples from {u.min():g} to {u.max():g}; give at least "
            f"{_SHORTEST_USE} samples of one that moves, as the joint will get it"
        )
    return u


def _beyond(u: np.ndarray, experiment: Design, data: IOData, volts: float | None = None) -> tuple[str, ...]:
    """A note where the input of use goes farther than the log and the experiment, whose inputs reach `volts`, do."""
    tried = np.concatenate([experiment.u, data.u[:, 0]])
    (low, high), (least, most) = ((float(np.min(x)), float(np.max(x))) for x in (u, tried))
    if max(least - low, high - most) <= _LITTLE * (most - least):
        return ()
    unit, top = experiment.units[0], float(np.abs(u).max())
    allowed = volts or float(np.abs(data.u).max())
    remedy = f"allow it with --volts {top:.4g}" if top > allowed else "a longer log, or one of larger inputs, tries it"
    return (
        f"the input of use goes from {low:.3g} to {high:.3g} {unit}, the log and the experiment from {least:.3g} to "
        f"{most:.3g}: beyond this the expected deviation is not tried; {remedy}",
    )


def _column_unit(record: Record) -> str:
    """Unit of the output's column as the file writes it."""
    return record.signals.mapping.output[0].unit


def write_input(proposal: Proposal, path: Path) -> Path:
    """Time, input and predicted output as a table; raises InputError for a place that cannot be written to."""
    d = proposal.design
    t = np.arange(len(d.u)) * d.Ts
    names = [f"{name} [{unit}]" if unit else name for name, unit in zip(("u", "y"), d.units, strict=True)]
    return write_table(check_written(path), {"time [s]": t, names[0]: d.u, names[1]: d.y})
