"""Findings on one output together with the inputs: delay, feedback, nonlinearity, rate and drift."""

from collections.abc import Iterable, Iterator

import numpy as np

from sysid.base.quantities import probability
from sysid.data.record import IOData
from sysid.diagnosis import signals
from sysid.diagnosis.delays import Delay, delay_from_input
from sysid.diagnosis.finding import LEVEL, Advice, aprbs, channel
from sysid.diagnosis.whitening import Whitened, bent_effect, drift, drift_size, feedback, is_computed, nonlinearity

NO_EFFECT = "the record shows no effect of"
_DRIFT = 0.3  # standard deviations of the output over the record; less hardly moves a fit
_CREEP = 0.05  # the same, below which a drift is of no account however sure it is
COMPUTED = "follows to the last digit from"
_TOGETHER = 0.7  # correlation of columns that nobody suspects
_FAST = 0.1  # cycles per sample: slower inputs do not show what happens within three samples


def advise_relation(data: IOData, j: int, white: Whitened) -> Iterator[Advice]:
    """Findings on one output together with the inputs."""
    y, nk = channel(data, "y", j), 1
    for i in range(data.u.shape[1]):
        u = channel(data, "u", i)
        d = delay_from_input(white, i, LEVEL)
        nk = nk if d.nk is None else d.nk
        yield _no_lag(u, y, d, data, white, i) if d.nk is None else _delay(u, y, d, d.nk, data)
        yield _computed(u, y, data) if is_computed(white, i) else _feedback(u, y, feedback(white, i), _is_single(data))
        if d.models:
            yield _rate(data, d, u, y)
    yield _nonlinearity(data, white, y, nk)
    yield _drift(y, white)


def without_effect(findings: Iterable[Advice]) -> Advice | None:
    """The first finding that an input shows no effect, of a record in which none shows one; None of others."""
    delays = [a for a in findings if a.topic == "delay"]
    return delays[0] if delays and all(a.sentence.startswith(NO_EFFECT) for a in delays) else None


def _drift(y: str, white: Whitened) -> Advice:
    p = drift(white)
    if p >= LEVEL:
        sentence = f"{y} has no linear drift that the input does not explain ({probability(p)})"
        return Advice("drift", sentence, p, "", "fine")
    size = drift_size(white)
    if size < _CREEP:
        sentence = f"{y} has a linear drift of {size:.2g} standard deviations only ({probability(p)})"
        return Advice("drift", sentence, p, "", "fine")
    return Advice(
        "drift",
        f"{y} has a linear drift of {size:.2g} standard deviations that the input does not explain ({probability(p)})",
        p,
        "find the cause, such as warming or the supply, or remove linear trends",
        "warning" if size > _DRIFT else "note",
        call='sysid.data.trends.Trend.of(data, "linear").remove(data)',
    )


def _no_lag(u: str, y: str, d: Delay, data: IOData, white: Whitened, i: int) -> Advice:
    """No linear effect: of a nonlinear one, or of none, which wakes the suspicion that the columns are not a pair."""
    lags = f"lags 0..{d.high} of {u}"
    p, is_single = bent_effect(white, i), _is_single(data)
    if p < LEVEL:
        return Advice(
            "delay",
            f"{lags} together show no linear effect on {y} ({probability(d.p)}), but a nonlinear one "
            f"({probability(p)})",
            float("nan"),
            f"increase the excitation, or {'search the structures for' if is_single else 'fit'} a nonlinear model",
            "note",
            call="sysid.select(data).fit" if is_single else "",
            command=("identify", "--structure", "auto" if is_single else "hammerstein_wiener"),
        )
    if abs(float(np.corrcoef(white.X[:, white.lags(i).start], white.y)[0, 1])) > _TOGETHER:
        return Advice(
            "delay",
            f"{u} and {y} move together, but too slowly to tell a response from chance ({probability(d.p)})",
            float("nan"),
            "record with an input that changes more often",
            "warning",
            call=aprbs(data, i),
        )
    return Advice(
        "delay",
        f"{NO_EFFECT} {u} on {y} ({probability(d.p)}, lags 0..{d.high} together)",
        float("nan"),
        f"record again with an input that moves {y}, or look whether the columns belong together",
        "warning",
        call="sysid.plots.record(data)",
        command=("info",),
    )


def _delay(u: str, y: str, d: Delay, nk: int, data: IOData) -> Advice:
    interval = "" if d.low == d.high else f", {d.low} to {d.high} with 99 % confidence"
    sentence = f"{y} responds to {u} after {nk} sample(s){interval} ({probability(d.p)} without any response)"
    sentence += f"; {d.limit}" if d.limit else ""
    if nk == 0:
        action = "if the plant has direct feedthrough, use nk=0; otherwise a controller responds within the sample"
        return Advice("delay", sentence, 0.0, action, "note", (d.low, d.high), *_orders(0, data))
    action = f"use nk={nk}"
    if d.low < d.high:
        action += f", and compare fits with nk {d.low} to {d.high}"
    return Advice("delay", sentence, nk, action, "note" if d.limit else "fine", (d.low, d.high), *_orders(nk, data))


def _is_single(data: IOData) -> bool:
    """Whether the record has one input and one output, as some structures and the search over them need."""
    return data.u.shape[1] == data.y.shape[1] == 1


def _call(structure: str, nk: int, data: IOData) -> str:
    """The call that fits a structure of this delay to a record of so many channels."""
    size = "" if _is_single(data) else f", nu={data.u.shape[1]}, ny={data.y.shape[1]}"
    return f"sysid.fit(sysid.structures.{structure}(nb=2, nf=3, nk={nk}{size}), data)"


def _orders(nk: int, data: IOData) -> tuple[str, tuple[str, ...]]:
    """The call and the command that fit a linear model of this delay."""
    call = _call("output_error", nk, data)
    return call, ("identify", "--structure", "output_error", "--orders", f"2,3,{nk}")


def _computed(u: str, y: str, data: IOData) -> Advice:
    """An input of this kind; a model that predicts has one input and one output."""
    is_single = _is_single(data)
    return Advice(
        "feedback",
        f"{u} {COMPUTED} {y} of the same sample, so a controller computes it, and a fit may find the controller",
        0.0,
        "record with a reference that changes" + (", or fit a model that predicts, with nk = 1 or more" * is_single),
        "warning",
        call="sysid.fit(sysid.structures.armax(nb=2, nf=2, nk=1), data)" if is_single else "",
        command=("identify", "--structure", "armax") if is_single else (),
    )


def _feedback(u: str, y: str, p: float | None, is_single: bool) -> Advice:
    """Whether later inputs depend on the output; a model that holds the noise has one input and one output."""
    if p is None:
        return Advice(
            "feedback", f"{u} changes too seldom, or too regularly, to test for feedback from {y}", 1.0, "", "note"
        )
    if p >= LEVEL:
        return Advice("feedback", f"no sign of feedback from {y} to {u} ({probability(p)})", p, "", "fine")
    return Advice(
        "feedback",
        f"feedback from {y} to {u}: later inputs depend on present outputs ({probability(p)})",
        p,
        "output error is biased in a loop: record in open loop"
        + (", or fit a model that holds the noise too" if is_single else ""),
        "warning",
        call="sysid.fit(sysid.structures.armax(), data)" if is_single else "",
        command=("identify", "--structure", "armax") if is_single else (),
    )


def _nonlinearity(data: IOData, white: Whitened, y: str, nk: int) -> Advice:
    effect = nonlinearity(white, nk)
    if effect is None:
        return Advice("nonlinearity", f"a nonlinearity of {y} cannot be tested with these data", 1.0, "", "note")
    share = f"{100 * effect.share:.1f} % of the linear model's one-step error"
    sentence = f"squares and cubes explain {share} ({probability(effect.p_value)})"
    if effect.p_value >= LEVEL:
        return Advice(
            "nonlinearity",
            f"{y}: {sentence}, no sign of a nonlinearity",
            effect.p_value,
            "start linear",
            "fine",
            None,
            *_orders(nk, data),
        )
    return Advice(
        "nonlinearity",
        f"{y}: {sentence}",
        effect.p_value,
        "add an input or an output map",
        "note",
        call=_call("hammerstein_wiener", nk, data),
        command=("identify", "--structure", "hammerstein_wiener", "--orders", f"2,3,{nk}"),
    )


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
            "expect a pole near 1, and record longer if the plant does not integrate",
            "note",
        )
    rise_samples = [n for n, settles_too in rises if settles_too and n is not None]
    low, high = min(rise_samples), max(rise_samples)
    tau = f"{y} reaches 63 % of its response to a step of {u} after {samples} samples ({samples * data.Ts:.3g} s)"
    swing = min(signals.swing(m.f) for m in d.models)
    if high < 3 and not 6.0 <= swing < np.inf and signals.reaches(data.u, _FAST):
        action = f"most of the response is lost: sample every {data.Ts / 3.0:.3g} s or faster"
        return Advice("rate", tau, samples, action, "warning", (low, high))
    slower = int(min(low // 30, swing / 15.0))
    if low > 100 and slower > 1:
        action = f"the poles are all close to 1: resample {slower} times slower"
        call = f"sysid.data.resampling.resample(data, {slower * data.Ts:.9g}).data"
        return Advice("rate", tau, samples, action, "note", (low, high), call)
    return Advice("rate", tau, samples, "", "fine", (low, high))
