"""Preparation: everything that is done to a record before a fit, as one value that can be applied, said and written."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.data import filters, preprocess, resampling
from sysid.data.missing import fill, runs
from sysid.data.record import IOData

MISSING = ("mark", "fill", "split", "refuse")
STRETCH = 20  # samples: a shorter stretch says little beyond its initial state
Band = tuple[float | None, float | None]


@dataclass(frozen=True)
class Preparation:
    """The steps from a record as it was read to the record of a fit, in this order; the default changes nothing.

    `start` and `stop` [s] are kept, both included, after the first sample of each experiment (None: all). `missing`
    says what becomes of outputs that are marked as missing: 'mark' leaves them to the fit, which ignores them, 'fill'
    puts straight lines into gaps of up to three samples, 'split' makes an experiment of each stretch of 20 samples or
    more without any, for gaps in which the input is not known either, 'refuse' raises an InputError. `resample` is the
    new Ts [s]. `filter` is the band (low, high) [Hz] that is kept; with one of them None the filter is a low-pass or a
    high-pass. `detrend` is one of `sysid.data.preprocess.DETREND`; None leaves the choice to the fit.

    Raises InputError for values that make no sense together.
    """

    start: float | None = None
    stop: float | None = None
    missing: str = "mark"
    resample: float | None = None
    filter: Band = (None, None)
    detrend: str | None = None

    def __post_init__(self) -> None:
        if self.missing not in MISSING:
            raise unknown("policy for missing samples", self.missing, MISSING)
        if self.detrend is not None and self.detrend not in preprocess.DETREND:
            raise unknown("detrend", self.detrend, preprocess.DETREND)
        low, high = self.filter
        ends = (("filter", low, high), ("range", self.start, self.stop))
        for name, a, b in ends:
            if a is not None and b is not None and not a < b:
                raise InputError(f"the {name} goes from {a:g} to {b:g}; give the smaller value first")
        if self.resample is not None and not 0 < self.resample < np.inf:
            raise InputError(f"resample is {self.resample:g}; give the new sampling time as a positive number, in s")

    def apply(self, data: IOData) -> IOData:
        """The prepared record. Raises InputError for a step that this record does not allow."""
        return self.steps(data)[0]

    def steps(self, data: IOData) -> tuple[IOData, tuple[str, ...]]:
        """The prepared record, and one sentence for each step that changed it."""
        sentences: list[str] = []
        if self.start is not None or self.stop is not None:
            count, data = data.N, between(data, self.start, self.stop)
            sentences.append(f"kept {data.N} of {count} samples, {_text(self.start)} to {_text(self.stop)} s")
        if data.missing is not None and self.missing == "split":
            count, data = data.N, missing(data, self.missing)
            sentences.append(
                f"{len(data.experiments)} experiments, the stretches of {STRETCH} samples or more without a missing "
                f"one: {data.N} of {count} samples"
            )
        if data.missing is not None:
            missing_count, data = int(data.missing.sum()), missing(data, self.missing)
            remaining = 0 if data.missing is None else int(data.missing.sum())
            if missing_count > remaining:
                sentences.append(
                    f"{missing_count - remaining} of {missing_count} missing outputs filled by straight lines"
                )
        if self.resample is not None and self.resample != data.Ts:
            resampled = resampling.resample(data, self.resample, "held")
            data = resampled.data
            sentences.append(resampled.sentence)
        if self._cutoff is not None:
            cutoff, kind = self._cutoff
            filtered = filters.butterworth(data, cutoff, kind)
            data = filtered.data
            sentences.append(filtered.sentence)
        if self.detrend is not None:
            data = preprocess.detrend(data, self.detrend)
        return data, tuple(sentences)

    def options(self) -> tuple[str, ...]:
        """The options of `qpal identify` that do the same; none for a step that is left out."""
        words: list[str] = []
        for option, value, default in (
            ("--range", _pair(self.start, self.stop), ":"),
            ("--missing", self.missing, "mark"),
            ("--resample", _text(self.resample), ""),
            ("--filter", _pair(*self.filter), ":"),
            ("--detrend", self.detrend or "", ""),
        ):
            words += [] if value == default else [option, value]
        return tuple(words)

    def code(self, name: str = "data") -> list[str]:
        """Lines of Python that do the same to the IOData called `name`, after `import sysid`."""
        calls: list[str] = []
        if self.start is not None or self.stop is not None:
            calls.append(f"sysid.data.preparation.between({name}, {self.start}, {self.stop})")
        if self.missing != "mark":
            calls.append(f"sysid.data.preparation.missing({name}, {self.missing!r})")
        if self.resample is not None:
            calls.append(f'sysid.data.resampling.resample({name}, {self.resample!r}, "held").data')
        if self._cutoff is not None:
            cutoff, kind = self._cutoff
            calls.append(f'sysid.data.filters.butterworth({name}, {cutoff!r}, "{kind}").data')
        if self.detrend is not None:
            calls.append(f'sysid.data.detrend({name}, "{self.detrend}")')
        return [f"{name} = {call}" for call in calls]

    @property
    def _cutoff(self) -> tuple[float | tuple[float, float], str] | None:
        """Cutoff [Hz] and kind of the filter."""
        low, high = self.filter
        if low is not None and high is not None:
            return (low, high), "band"
        if low is not None:
            return low, "high"
        return None if high is None else (high, "low")


def between(data: IOData, start: float | None = None, stop: float | None = None) -> IOData:
    """The samples from start to stop [s], both included, after the first sample of each experiment.

    Raises InputError if an experiment has fewer than two samples there.
    """
    parts = []
    for e in data.experiments:
        slack = 1e-6 * e.Ts  # a time that a person writes is not exactly a multiple of Ts
        low = 0 if start is None else int(np.clip(np.ceil((start - slack) / e.Ts), 0, e.N))
        high = e.N if stop is None else int(np.clip(np.floor((stop + slack) / e.Ts) + 1, 0, e.N))
        if high - low < 2:
            raise InputError(
                f"the range {_pair(start, stop)} s holds {max(high - low, 0)} sample(s) of a record from 0 to "
                f"{(e.N - 1) * e.Ts:.6g} s; give a range inside it"
            )
        parts.append(e.select(low, high))
    return IOData.merge(*parts)


def missing(data: IOData, policy: str = "mark") -> IOData:
    """The record with its missing outputs treated by one of `MISSING`; see `Preparation`."""
    if policy not in MISSING:
        raise unknown("policy for missing samples", policy, MISSING)
    if data.missing is None or policy == "mark":
        return data
    if policy == "refuse":
        first = int(np.flatnonzero(data.missing.any(axis=1))[0])
        raise InputError(
            f"{int(data.missing.sum())} outputs are missing, the first at sample {first} (from 0); "
            "mark leaves them to the fit, which ignores them, and fill puts straight lines into short gaps"
        )
    if policy == "split":
        return _stretches(data)
    open_marks = []
    for e in data.experiments:
        mask = np.zeros(e.y.shape, dtype=bool) if e.missing is None else e.missing
        open_marks.append(np.column_stack([fill(y, missing=m).open for y, m in zip(e.y.T, mask.T, strict=True)]))
    return replace(data, missing=np.concatenate(open_marks))


def _stretches(data: IOData) -> IOData:
    """The stretches without a missing output as experiments; raises InputError where all are too short."""
    parts: list[IOData] = []
    for e in data.experiments:
        complete = np.ones(e.N, dtype=bool) if e.missing is None else np.logical_not(e.missing.any(axis=1))
        parts += [e.select(a, b) for a, b in runs(complete) if b - a >= STRETCH]
    if not parts:
        raise InputError(
            f"no stretch of {STRETCH} samples is without a missing one; mark leaves them to the fit, which ignores them"
        )
    return replace(IOData.merge(*parts), missing=None)


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.12g}"


def _pair(a: float | None, b: float | None) -> str:
    return f"{_text(a)}:{_text(b)}"
