"""From a log to the next experiment: a joint is fitted to the log, and an input is designed on the fit."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.versions import versions
from sysid.estimation.result import Fit
from sysid.formats import check_written, write_table
from sysid.joint.design import Design, design
from sysid.joint.growth import grow_joint
from sysid.structures import ActuatedJoint
from sysid.workflow.record import Record, read_record


@dataclass(frozen=True)
class Proposal:
    """The log, the joint fitted to it, and the next experiment."""

    record: Record
    fit: Fit
    design: Design

    @property
    def command(self) -> str:
        """The command that identifies the joint from both records, once the second exists."""
        return shlex.join(["qpal", "identify", "RECORDED.csv", "--structure", ActuatedJoint.name])

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal design`, ready for JSON."""
        return {
            "record": self.record.as_dict(),
            "fit_percent": self.fit.fit_percent(self.record.data),
            **self.design.as_dict(),
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
    progress: Callable[[], None] = lambda: None,
    **columns: Any,
) -> Proposal:
    """The next experiment on the joint in the log at `path`, in samples of `sample` [s]; `columns` as in `read_record`.

    Raises InputError for a file that is no log, and as `sysid.joint.design.design`.
    """
    record = read_record(path, **columns)
    progress()
    data = ActuatedJoint().scale(record.data)
    fit = grow_joint(data, seed=seed).fit
    return Proposal(record, fit, design(fit, data, targets, volts, strike, seed, sample))


def write_input(proposal: Proposal, path: Path) -> Path:
    """Time, input and predicted output as a table; raises InputError for a place that cannot be written to."""
    d = proposal.design
    t = np.arange(len(d.u)) * d.Ts
    names = [f"{name} [{unit}]" if unit else name for name, unit in zip(("u", "y"), d.units, strict=True)]
    return write_table(check_written(path), {"time [s]": t, names[0]: d.u, names[1]: d.y})
