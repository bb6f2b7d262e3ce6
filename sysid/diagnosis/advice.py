"""Advice on a record before a model is fitted: what it can show, what disturbs it, and what to do about it.

Every line has the number behind it. The tests' false-alarm rates and power are measured in tests/recovery.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from sysid.base.threads import one_blas_thread
from sysid.data.outliers import hampel
from sysid.data.record import IOData
from sysid.diagnosis import signals
from sysid.diagnosis.response import Delay, delay
from sysid.diagnosis.whitening import Whitened, drift, drift_size, feedback, nonlinearity, whiten

LEVEL = 0.01  # false-alarm rate of each statistical test
KNOTS = 10  # break points of the default piecewise linear map
_DRIFT = 0.3  # standard deviations of the output over the record; less hardly moves a fit
_FAST = 0.1  # cycles per sample: slower inputs do not show what happens within three samples
ORDER = 10  # twice the order of excitation that a model with nb + nf = 5 needs


@dataclass(frozen=True)
class Advice:
    """One finding: `severity` is 'fine', 'note' or 'warning', `value` the number behind the sentence.

    `interval` holds the value with 99 % confidence, where it is an estimate that has one.
    """

    topic: str
    sentence: str
    value: float
    action: str
    severity: str
    interval: tuple[float, float] | None = None

    def __str__(self) -> str:
        return f"{self.sentence}; {self.action}" if self.action else self.sentence


def advise(data: IOData) -> tuple[Advice, ...]:
    """Findings on the record, by topic, for every input and output.

    Topics: excitation, levels, delay, feedback, nonlinearity, rate, rest, resolution, outliers, drift. The level of
    the statistical tests is 1 % false alarms per record; scripts/advice_rates.py prints their rates by class of input.
    The tests use at most the first 20,000 samples.
    """
    with one_blas_thread():
        found = [a for i in range(data.u.shape[1]) for a in _input(data, i)]
        for j in range(data.y.shape[1]):
            white = whiten(data, j)
            found += _output(data, j, white)
            if white is None:
                found.append(_too_little(data, j))
            else:
                found += _between(data, j, white)
    return tuple(found)


def _input(data: IOData, i: int) -> Iterator[Advice]:
    name, u = _name(data, "u", i), data.u[:, i]
    order = signals.persistence(u)
    if order >= ORDER:
        yield Advice("excitation", f"{name} is persistently exciting of order {order} or more", order, "", "fine")
    else:
        yield Advice(
            "excitation",
            f"{name} is persistently exciting of order {order} only: it identifies at most {order} linear parameters",
            order,
            f"excite with an aprbs or a multisine, or keep nb + nf at most {order}",
            "warning",
        )
    n = signals.levels(u)
    if n >= KNOTS:
        yield Advice("levels", f"{name} takes {n} distinct levels", n, "", "fine")
    else:
        yield Advice(
            "levels",
            f"{name} takes {n} distinct level(s), fewer than the {KNOTS} break points of a piecewise linear input map",
            n,
            "use an aprbs, which has many levels, or use no input map or one with fewer parameters",
            "warning",
        )


def _output(data: IOData, j: int, white: Whitened | None) -> Iterator[Advice]:
    name, unit = _name(data, "y", j), f" {data.y_unit}" if data.y_unit else ""
    y = data.y[data.observed[:, j], j]
    yield _rest(name, y, _noise(y, white), unit)
    q = signals.step(y)
    if q is None:
        yield Advice("resolution", f"{name} shows no converter step", 0.0, "", "fine")
    else:
        coarse = q > 0.02 * float(np.ptp(y))
        yield Advice(
            "resolution",
            f"{name} moves in steps of {q:.4g}{unit}, 1/{np.ptp(y) / q:.0f} of its range: rounding alone is noise of "
            f"{q / np.sqrt(12):.3g}{unit}",
            q,
            "use more of the converter's range, or average faster readings" if coarse else "",
            "warning" if coarse else "note",
        )
    yield _outliers(data, j, white, name)


def _noise(y: np.ndarray, white: Whitened | None) -> float:
    """Noise level: the smaller of two estimates, from second differences (valid at rest) and a linear model."""
    second = np.abs(np.diff(y, 2)) / np.sqrt(6.0)
    left = np.abs(white.regression.e) if white is not None else second
    return 1.4826 * min(float(np.median(second)) if len(second) else 0.0, float(np.median(left)))


def _rest(name: str, y: np.ndarray, noise: float, unit: str) -> Advice:
    rest = signals.rests(y, noise)
    moving = signals.sine_rest(rest.band / (float(np.ptp(y)) or 1.0))
    most = max(rest.low, rest.high)
    if most <= max(0.08, 1.5 * moving):
        return Advice("rest", f"{name} is at an extreme in {100 * most:.1f} % of samples", most, "", "fine")
    shares = ((rest.low, "lowest", float(y.min())), (rest.high, "highest", float(y.max())))
    where = [f"{100 * s:.0f} % at its {word} ({v:.4g}{unit})" for s, word, v in shares if s > max(0.08, 1.5 * moving)]
    return Advice(
        "rest",
        f"{name} rests for {' and '.join(where)}: an end stop or a saturation",
        most,
        "use an output map that saturates, or reduce the amplitude; a linear model cannot describe an end stop",
        "note",
    )


def _outliers(data: IOData, j: int, white: Whitened | None, name: str) -> Advice:
    y = data.y[:, j]
    found = hampel(y) & data.observed[:, j] if data.N >= 11 else np.zeros(data.N, dtype=bool)
    if white is not None and found.any():
        # A step of the plant differs from its neighbours too; an outlier is only what the past does not predict.
        e = white.regression.e
        size = np.abs(e - np.median(e))
        odd = np.zeros(data.N, dtype=bool)
        odd[white.times[size > max(6.0, float(-ndtri(LEVEL / 2 / len(e)))) * 1.4826 * np.median(size)]] = True
        found &= odd
    found = _returning(y, found)
    n = int(found.sum())
    if not n:
        return Advice("outliers", f"{name} has no isolated outliers", 0.0, "", "fine")
    first = ", ".join(map(str, np.flatnonzero(found)[:5])) + (", ..." if n > 5 else "")
    return Advice(
        "outliers",
        f"{name} has {n} isolated outlier(s), {100 * n / data.N:.2g} % of samples: {first}",
        n,
        "mark them as missing (preprocess.outliers) or fit with a robust loss",
        "warning",
    )


def _returning(y: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Those of the found samples (N,) that lie further from both neighbours than these from each other.

    The neighbours are the nearest samples that are not found. A sudden move does not come back.
    """
    sound = np.flatnonzero(~found)
    kept = np.zeros(len(y), dtype=bool)
    for t in np.flatnonzero(found):
        k = int(np.searchsorted(sound, t))
        before, after = y[sound[max(k - 1, 0)]], y[sound[min(k, len(sound) - 1)]]
        kept[t] = min(abs(y[t] - before), abs(y[t] - after)) > 2.0 * abs(after - before)
    return kept


def _between(data: IOData, j: int, white: Whitened) -> Iterator[Advice]:
    """Findings on one output together with the inputs."""
    y, nk = _name(data, "y", j), 1
    for i in range(data.u.shape[1]):
        u = _name(data, "u", i)
        d = delay(white, i, LEVEL)
        nk = nk if d.nk is None else d.nk
        yield _delay(u, y, d, white.order)
        yield _feedback(u, y, feedback(white, i))
        if d.models:
            yield _rate(data, d, u, y)
    yield _nonlinearity(data, white, y, nk)
    yield _drift(y, white)


def _drift(y: str, white: Whitened) -> Advice:
    p = drift(white)
    if p >= LEVEL:
        said = f"{y} has no linear drift that the input does not explain (p = {p:.2g})"
        return Advice("drift", said, p, "", "fine")
    size = drift_size(white)
    return Advice(
        "drift",
        f"{y} has a linear drift of {size:.2g} standard deviations that the input does not explain (p = {p:.2g})",
        p,
        "remove linear trends (preprocess.Trend) or find the cause, such as warming or the supply",
        "warning" if size > _DRIFT else "note",
    )


def _delay(u: str, y: str, d: Delay, longest: int) -> Advice:
    if d.nk is None:
        return Advice(
            "delay",
            f"lags 0..{longest} of {u} together show no effect on {y} (p = {d.p:.2g})",
            float("nan"),
            "check that the columns belong together, or increase the excitation",
            "warning",
        )
    between = "" if d.low == d.high else f", {d.low} to {d.high} with 99 % confidence"
    sentence = f"{y} responds to {u} after {d.nk} sample(s){between} (p = {d.p:.2g} without any response)"
    if d.nk == 0:
        action = "use nk=0 if the plant has direct feedthrough; otherwise a controller responds within the sample"
        return Advice("delay", sentence, 0.0, action, "note", (d.low, d.high))
    action = f"use nk={d.nk}"
    if d.low < d.high:
        action += f", and compare fits with nk {d.low} to {d.high}"
    return Advice("delay", sentence, d.nk, action, "fine", (d.low, d.high))


def _feedback(u: str, y: str, p: float | None) -> Advice:
    if p is None:
        return Advice(
            "feedback", f"the past of {u} determines its future: no test for feedback from {y}", 1.0, "", "note"
        )
    if p >= LEVEL:
        return Advice("feedback", f"no sign of feedback from {y} to {u} (p = {p:.2g})", p, "", "fine")
    return Advice(
        "feedback",
        f"feedback from {y} to {u}: later inputs depend on present outputs (p = {p:.2g})",
        p,
        "record in open loop, or excite the reference of the loop and model the noise: output error is biased here",
        "warning",
    )


def _nonlinearity(data: IOData, white: Whitened, y: str, nk: int) -> Advice:
    found = nonlinearity(white, nk)
    if found is None:
        return Advice("nonlinearity", f"a nonlinearity of {y} cannot be tested with these data", 1.0, "", "note")
    share = f"{100 * found.share:.1f} % of the linear model's one-step error"
    said = f"squares and cubes explain {share} (p = {found.p_value:.2g})"
    if found.p_value >= LEVEL:
        return Advice("nonlinearity", f"{y}: {said}, no sign of a nonlinearity", found.p_value, "start linear", "fine")
    return Advice("nonlinearity", f"{y}: {said}", found.p_value, "add an input or an output map", "note")


def _rate(data: IOData, d: Delay, u: str, y: str) -> Advice:
    """What the likely models of the response say of the rate; the smallest claim that all of them support."""
    longest = int(np.clip(data.N // 4, 50, 5000))
    rises = [signals.rise(np.r_[np.zeros(m.nk), m.b], np.r_[1.0, m.f], longest) for m in d.models]
    samples, settles = rises[0]
    if not settles or samples is None:
        return Advice(
            "rate",
            f"{y} does not settle within {longest} samples after a step of {u}: it integrates or is slower",
            float("nan"),
            "expect a pole near 1",
            "note",
        )
    found = [n for n, settled in rises if settled and n is not None]
    low, high = min(found), max(found)
    tau = f"{y} reaches 63 % of its response to a step of {u} after {samples} samples ({samples * data.Ts:.3g} s)"
    swing = min(signals.swing(m.f) for m in d.models)
    if high < 3 and not 6.0 <= swing < np.inf and signals.reaches(data.u, _FAST):
        action = "sample at least 3 times faster: most of the response is lost"
        return Advice("rate", tau, samples, action, "warning", (low, high))
    slower = int(min(low // 30, swing / 15.0))
    if low > 100 and slower > 1:
        action = f"resample {slower} times slower: the poles are all close to 1"
        return Advice("rate", tau, samples, action, "note", (low, high))
    return Advice("rate", tau, samples, "", "fine", (low, high))


def _too_little(data: IOData, j: int) -> Advice:
    return Advice(
        "data",
        f"{data.N} samples of {_name(data, 'y', j)} are too few, or vary too little, to test for delay, feedback and "
        "nonlinearity",
        data.N,
        "record more",
        "warning",
    )


def _name(data: IOData, which: str, k: int) -> str:
    name = data.u_name if which == "u" else data.y_name
    many = (data.u if which == "u" else data.y).shape[1] > 1
    return f"{name}{k + 1}" if many else name
