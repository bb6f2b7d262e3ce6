"""From a recorded file to an evaluated model: what `qpal identify` does."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sysid.errors import InputError
from sysid.preprocess import quick_start
from twin.evaluation import Evaluation, Setting, evaluate
from twin.record import Record, read_record
from twin.versions import versions


@dataclass(frozen=True)
class Identification:
    """The record, how it was prepared, and the model with its tests."""

    record: Record
    split: float
    detrend: str
    evaluation: Evaluation

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal identify`, ready for JSON."""
        return {
            "read": {**self.record.as_dict(), "split": self.split, "detrend": self.detrend},
            **self.evaluation.as_dict(),
            "versions": versions(),
        }


def identify_file(
    path: str | os.PathLike[str],
    setting: Setting,
    input: str | None = None,
    output: str | None = None,
    Ts: float | None = None,
    time: str | None = None,
    split: float = 0.5,
    detrend: str = "mean",
    fitting: Callable[[], None] = lambda: None,
) -> Identification:
    """Reads the file, prepares both parts and fits `setting` to the first; `fitting` is called before the fit.

    Every InputError names the file, also where the identifier itself finds that the record will not do.
    """
    record = read_record(path, input, output, Ts, time)
    try:
        estimation, validation = quick_start(record.data, split, detrend)
        fitting()
        evaluation = evaluate(setting, estimation, validation)
    except InputError as error:
        raise InputError(f"{record.path}: {error}") from None
    return Identification(record, split, detrend, evaluation)
