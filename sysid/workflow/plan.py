"""Before a fit: the steps of a preparation, several files as one record, and its two parts for fit and validation."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.base.rates import drift_note, same_rate
from sysid.data.preparation import Preparation
from sysid.data.preprocess import detrend, quick_start
from sysid.data.record import IOData
from sysid.data.trends import CONSTANT, Trend
from sysid.workflow.record import Record


@dataclass(frozen=True)
class Plan:
    """What comes before a fit: the steps of a preparation, and where the validation data come from.

    `split` is the share of each experiment that is used for the fit, from its start; it is not used where `validation`
    names records of their own. `whole` says that all of the record is for the fit, and nothing is left to validate.
    """

    preparation: Preparation = field(default_factory=Preparation)
    split: float = 0.5
    detrend: str = "none"
    validation: Record | None = None
    whole: bool = False

    def in_words(self) -> str:
        """Where the offsets that were removed come from."""
        span = "over the whole record" if self.validation is None else "over the estimation data"
        return {"steady": "levels before the first movement", "none": "the zero of the saved model"}.get(
            self.detrend, f"means {span}"
        )

    def parts(self, data: IOData) -> tuple[IOData, IOData]:
        """Estimation and validation data of a prepared record.

        Means and levels at rest are those of the whole record that is split, or of the estimation data where the
        validation data are other records: a model counts from one zero. Lines are each record's own. Both are all of
        a `whole` record.
        """
        if self.whole:
            return (detrended := detrend(data, self.detrend)), detrended
        if self.validation is None:
            return quick_start(data, self.split, self.detrend)
        validation = self.validation.data
        if self.detrend == "none":
            return data, validation
        trend = Trend.of(data, self.detrend)
        return trend.remove(data), (trend if self.detrend in CONSTANT else Trend.of(validation, self.detrend)).remove(
            validation
        )


def prepare_record(record: Record, preparation: Preparation) -> Record:
    """The record after every step but the detrending, with a remark for each that changed it."""
    data, sentences = replace(preparation, detrend=None).steps(record.data)
    return record if not sentences else replace(record, data=data, remarks=(*record.remarks, *sentences))


def merge_records(records: Sequence[Record], absolute: bool = False) -> Record:
    """One record whose experiments are these; raises InputError where channels, units or sampling times differ.

    `absolute`: inputs count from zero, so their levels may differ from file to file.
    """
    first, *further_records = records
    if not further_records:
        return first
    for other in further_records:
        _check_alike(first, other)
    data = IOData.merge(*(record.data for record in records))
    files = tuple(record.path for record in records for _ in record.data.lengths)
    sizes = " and ".join(f"{record.path.name} ({record.data.N} samples)" for record in records)
    summary = f"{len(records)} files are {len(files)} experiments, each with its own initial state: {sizes}"
    levels = _levels(records, ("y",) if absolute else ("u", "y"))
    further_notes = (
        f"{record.path.name}: {note}"
        for record in further_records
        for note in (*record.notes, drift_note(record.data.Ts, data.Ts, record.data.N, f"that of {first.path.name}"))
        if note and note not in first.notes
    )
    return replace(first, data=data, files=files, remarks=(*first.remarks, summary, *levels, *further_notes))


def _levels(records: Sequence[Record], signals: Sequence[str]) -> tuple[str, ...]:
    """A remark if the levels of the files differ so much that they may count from different zeros."""
    roles = []
    for role in signals:
        values = [getattr(record.data, role) for record in records]
        means = [np.nanmean(signal, axis=0) for signal in values]
        ways = [np.nanmax(signal, axis=0) - np.nanmin(signal, axis=0) for signal in values]
        if (np.ptp(means, axis=0) > np.max(ways, axis=0)).any():
            roles.append("inputs" if role == "u" else "outputs")
    if not roles:
        return ()
    own = (
        "--offset each gives it one" if roles == ["outputs"] and "u" in signals else "subtract it from each file first"
    )
    return (
        f"the levels of the {' and '.join(roles)} differ from file to file by more than they move within one; where "
        f"each file has a zero of its own, {own}",
    )


def check_same_channels(first: Record, other: Record) -> None:
    """Raises InputError if another record has other channels, units or another sampling time."""
    _check_alike(first, other)


def paths_from(texts: Sequence[str]) -> tuple[Path, ...]:
    """Paths from texts, each of which is a file or several with commas between them."""
    paths: list[Path] = []
    for text in texts:
        parts = [text] if Path(text).exists() else [part.strip() for part in text.split(",")]
        paths += [Path(part) for part in parts if part]
    return tuple(paths)


def _check_alike(first: Record, other: Record) -> None:
    a, b = first.data, other.data
    shapes = [(data.u.shape[1], data.y.shape[1]) for data in (a, b)]
    if shapes[0] != shapes[1]:
        raise InputError(
            f"{other.path} has {shapes[1][0]} input(s) and {shapes[1][1]} output(s), {first.path} {shapes[0][0]} and "
            f"{shapes[0][1]}; name the same columns with --input and --output"
        )
    for role, first_signals, second_signals in (
        ("input", first.signals.input, other.signals.input),
        ("output", first.signals.output, other.signals.output),
    ):
        for first_signal, second_signal in zip(first_signals, second_signals, strict=True):
            if first_signal.unit != second_signal.unit:
                raise InputError(
                    f"the {role} {second_signal.column!r} of {other.path} is in {second_signal.unit or 'no unit'}, "
                    f"{first_signal.column!r} "
                    f"of {first.path} in {first_signal.unit or 'no unit'}; name the columns with --{role}, or the "
                    "unit with "
                    "--map"
                )
    if not same_rate(a.Ts, b.Ts):
        raise InputError(
            f"{other.path} is sampled every {b.Ts:g} s and {first.path} every {a.Ts:g} s; bring both to one sampling "
            f"time with --resample {max(a.Ts, b.Ts):g}"
        )
