"""Advice on a record before a model is fitted: what it can show, what disturbs it, and what to do about it.

Every line has the number behind it. The tests' false-alarm rates and power are measured in tests/recovery.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from sysid.base.checks import checked
from sysid.base.parallel import one_blas_thread
from sysid.base.quantities import Quantity, display_quantity, unit_of_channel
from sysid.data.outliers import hampel, returning
from sysid.data.record import IOData, check_magnitudes
from sysid.diagnosis import signals
from sysid.diagnosis.finding import LEVEL, Advice, aprbs, channel
from sysid.diagnosis.relation import advise_relation
from sysid.diagnosis.signals import (
    NO_VALUE,
    constant_warning,
    may_be_place,
    missing_code,
    stuck_warning,
    word_warning,
    wrap_warning,
)
from sysid.diagnosis.whitening import Whitened, free_run, nonlinearity, whiten

LEAST = 40  # samples for each signal that the tests need
KNOTS = 10  # break points of the default piecewise linear map
_END_STOPS = (  # what to do about a rest
    "a linear model cannot describe it: fit a model with end stops if a motor moves this, else one whose output map "
    "saturates",
    "note",
    None,
    "sysid.fit_joint(data).fit",
    ("identify", "--structure", "actuated_joint"),
)
_SATURATES = (  # what to do about a rest of what is no place, such as a temperature
    "a linear model cannot describe it: fit a model whose input or output map saturates",
    "note",
    None,
    "sysid.fit(sysid.structures.hammerstein_wiener(), data)",
    ("identify", "--structure", "hammerstein_wiener"),
)
_RESTING = 0.08  # of the samples, from which an output rests at an end
_STILL = 0.05  # of the range of a speed, below which it is none
_FOLLOWED = 0.1  # of the output's standard deviation: the free run's error at a rest that a linear model explains
ORDER = 10  # twice the order of excitation that a model with nb + nf = 5 needs


@checked(late=True)
def advise(data: IOData) -> tuple[Advice, ...]:
    """Findings on the record, by topic, for every input and output.

    Topics: wraps, excitation, levels, delay, feedback, nonlinearity, rate, rest, resolution, outliers, drift. The
    level of the statistical tests is 1 % false alarms per record; `scripts/study.py advice_rates` prints their rates by
    class of input. The tests use at most the first 20,000 samples. Raises InputError for magnitudes that no plant has.
    """
    check_magnitudes(data)
    with one_blas_thread():
        warnings = ((j, word_warning(data, "y", j) or wrap_warning(data, j)) for j in range(data.y.shape[1]))
        raw, (data, none_places) = data, signals.without_words(data)
        wrap_warnings = {j: jump for j, jump in warnings if jump is not None and ("y", j) not in none_places}
        # First: they are in the way of all others.
        findings = [*wrap_warnings.values(), *(_none(raw, *place, mask) for place, mask in none_places.items())]
        findings += [a for i in range(data.u.shape[1]) for a in _input(data, i)]
        for j in range(data.y.shape[1]):
            if (warning := constant_warning(data, "y", j)) is not None:
                findings.append(warning)
                continue
            if (warning := stuck_warning(data, j)) is not None:
                findings.insert(0, warning)
            white = whiten(data, j)
            output_findings = list(_output(data, j, white, jumps=j in wrap_warnings))
            if ("y", j) in none_places:
                output_findings = [a for a in output_findings if a.topic != "outliers" or a.severity != "fine"]
            findings += output_findings
            if white is None:
                findings += [] if not np.ptp(data.u, axis=0).any() else [_too_little(data, j)]
            else:
                stopped = any(a.topic == "rest" and a.severity != "fine" for a in output_findings)
                findings += [_at_stops(a) if stopped else a for a in advise_relation(data, j, white)]
    return tuple(findings)


def _input(data: IOData, i: int) -> Iterator[Advice]:
    name, u = channel(data, "u", i), data.u[:, i]
    if (warning := constant_warning(data, "u", i)) is not None:
        yield warning
        return
    if (warning := word_warning(data, "u", i)) is not None:
        yield warning
    order = signals.persistence(u)
    if order >= ORDER:
        yield Advice("excitation", f"{name} is persistently exciting of order {order} or more", order, "", "fine")
    else:
        yield Advice(
            "excitation",
            f"{name} is persistently exciting of order {order} only: it identifies at most {order} linear parameters",
            order,
            f"keep nb + nf at most {order}, or record with an input of many levels",
            "warning",
            call=aprbs(data, i),
        )
    n = signals.levels(u)
    if n >= KNOTS:
        yield Advice("levels", f"{name} takes {n} distinct levels", n, "", "fine")
    else:
        yield Advice(
            "levels",
            f"{name} takes {n} distinct level(s): the record shows a static map of it there and nowhere between",
            n,
            "use a model without an input map, or record with an input of many levels",
            "note",
            call=aprbs(data, i),
        )


def _output(data: IOData, j: int, white: Whitened | None, jumps: bool = False) -> Iterator[Advice]:
    name, y_unit = channel(data, "y", j), unit_of_channel(data.y_unit, j)
    y_shown = display_quantity("", y_unit)
    unit = f" {y_shown.unit}" if y_shown.unit else ""
    y = data.y[data.observed[:, j], j]
    bend = None if white is None else nonlinearity(white)
    noise = _noise(y, white)
    straight = white is not None and bend is not None and bend.p_value >= LEVEL
    odd = _odd(data, j, white)
    code = missing_code(data.y[:, j], odd)
    if odd.any():  # an isolated spike, or a number that stands for none, is no end of the output's range
        y = data.y[data.observed[:, j] & ~odd, j]
        y = y if code is None else y[y != code]
    if not jumps:  # what wraps is near both ends of its turn, and rests at none
        yield _rest(name, y, noise, y_shown, white if straight else None, may_be_place(y_unit, name))
    of_speed = y_unit.endswith("/s") and may_be_place(y_unit.removesuffix("/s"), name)
    if white is not None and of_speed and data.u.shape[1] == 1:
        yield from _stands(name, white, noise, straight)
    q = signals.step(y)
    if q is None:
        yield Advice("resolution", f"{name} shows no converter step", 0.0, "", "fine")
    else:
        coarse = q > 0.02 * float(np.ptp(y))
        yield Advice(
            "resolution",
            f"{name} moves in steps of {q * y_shown.factor:.4g}{unit}, 1/{np.ptp(y) / q:.0f} of its range: rounding "
            f"alone is noise of {q * y_shown.factor / np.sqrt(12):.3g}{unit}",
            q,
            f"use more of the converter's range, or sample faster than every {data.Ts:.4g} s and average with "
            "sysid.data.resampling.resample"
            if coarse
            else "",
            "warning" if coarse else "note",
        )
    yield _outliers(odd, name, code if code is None else code * y_shown.factor, y_shown.unit)


def _noise(y: np.ndarray, white: Whitened | None) -> float:
    """Noise level: the smaller of two estimates, from second differences (valid at rest) and a linear model."""
    second = np.abs(np.diff(y, 2)) / np.sqrt(6.0)
    errors = np.abs(white.regression.e) if white is not None else second
    return 1.4826 * min(float(np.median(second)) if len(second) else 0.0, float(np.median(errors)))


def _followed(white: Whitened, at_rest: np.ndarray, noise: float) -> bool:
    """Whether a linear model's free run follows the output where it rests (M,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.sqrt(np.mean((white.y - free_run(white))[at_rest] ** 2)))
    return error <= _FOLLOWED * float(white.y.std()) + 2.0 * noise


def _at_extreme(y: np.ndarray, band: float) -> np.ndarray:
    return np.asarray((y <= y.min() + band) | (y >= y.max() - band))


def _stands(name: str, white: Whitened, noise: float, straight: bool) -> Iterator[Advice]:
    """A speed that is zero under an input that moves it elsewhere: that of a joint whose angle rests at an end."""
    u, y = np.abs(white.data.u[white.times, 0]), np.abs(white.y)
    driven, still = u >= 0.5 * u.max(), y <= _STILL * float(np.ptp(white.y))
    still[1:-1] &= still[:-2] & still[2:]
    stands = driven & still
    share = float(stands.mean())
    moves = float(np.mean(driven & (y > 2.0 * _STILL * np.ptp(white.y))))
    if min(share, moves) > _RESTING and not (straight and _followed(white, stands, noise)):
        sentence = f"{name} is zero in {100 * share:.0f} % of samples, under inputs that move it elsewhere"
        yield Advice("rest", f"{sentence}: an end stop, or what sticks", share, *_END_STOPS)


def _rest(name: str, y: np.ndarray, noise: float, as_shown: Quantity, linear: Whitened | None, place: bool) -> Advice:
    """Rests at the extremes, of what may be a `place` at end stops.

    `linear` is a regression that leaves no nonlinearity; None if there is none. One step ahead, a linear model predicts
    any rest. If its free run follows too, the input holds the output there.
    """
    rest = signals.rests(y, noise)
    moving = signals.sine_rest(rest.band / (float(np.ptp(y)) or 1.0))
    largest_share = max(rest.low, rest.high)
    if largest_share <= max(_RESTING, 1.5 * moving):
        return Advice(
            "rest", f"{name} is at an extreme in {100 * largest_share:.1f} % of samples", largest_share, "", "fine"
        )
    shares = ((rest.low, "lowest", float(y.min())), (rest.high, "highest", float(y.max())))
    extremes = [(s, word, f"{v * as_shown.factor:.4g} {as_shown.unit}".rstrip()) for s, word, v in shares]
    places = [f"{100 * s:.0f} % at its {word} ({v})" for s, word, v in extremes if s > max(_RESTING, 1.5 * moving)]
    sentence = f"{name} rests for {' and '.join(places)}"
    if linear is not None and _followed(linear, _at_extreme(linear.y, rest.band), noise):
        return Advice(
            "rest", f"{sentence}, where the input holds it: a linear model explains that", largest_share, "", "fine"
        )
    if not place:
        return Advice("rest", f"{sentence}: a saturation", largest_share, *_SATURATES)
    return Advice("rest", f"{sentence}: {signals.AT_STOPS}", largest_share, *_END_STOPS)


def _at_stops(advice: Advice) -> Advice:
    """The same about an output that rests at end stops: no advice to start linear beside that of the rests."""
    if advice.topic != "nonlinearity" or advice.severity != "fine":
        return advice
    sentence = f"{advice.sentence}, but a linear model does not follow the rests"
    return replace(advice, sentence=sentence, action="", call="", command=())


def _odd(data: IOData, j: int, white: Whitened | None) -> np.ndarray:
    """The isolated outliers (N,) of an output."""
    y = data.y[:, j]
    mask = hampel(y) & data.observed[:, j] if data.N >= 11 else np.zeros(data.N, dtype=bool)
    if white is not None and mask.any():
        # A step of the plant differs from its neighbours too; an outlier is only what the past does not predict.
        e = white.regression.e
        size = np.abs(e - np.median(e))
        odd = np.zeros(data.N, dtype=bool)
        odd[white.times[size > max(6.0, float(-ndtri(LEVEL / 2 / len(e)))) * 1.4826 * np.median(size)]] = True
        mask &= odd
    return returning(y, mask)


def _none(data: IOData, role: str, k: int, mask: np.ndarray) -> Advice:
    """The finding on the samples of a channel that stand for none."""
    values, unit = (data.u, data.u_unit) if role == "u" else (data.y, data.y_unit)
    shown = display_quantity("", unit_of_channel(unit, k))
    found = _outliers(mask, channel(data, role, k), float(values[mask, k][0]) * shown.factor, shown.unit)
    return (
        found if role == "y" else replace(found, action="write into these cells what the input was, or remove the rows")
    )


def _outliers(mask: np.ndarray, name: str, code: float | None, unit: str) -> Advice:
    """The finding on the samples in `mask` (N,), which all hold `code` in the unit that is shown."""
    n = int(mask.sum())
    if not n:
        return Advice("outliers", f"{name} has no isolated outliers", 0.0, "", "fine")
    first = ", ".join(map(str, np.flatnonzero(mask)[:5])) + (f" and {n - 5} more" if n > 5 else "")
    sentence = f"{name} has {n} isolated outlier{'s' * (n > 1)}, {100 * n / len(mask):.2g} % of samples: {first}"
    if code is not None:
        those = "it is" if n == 1 else "all are"
        sentence += f"; {those} {f'{code:.6g} {unit}'.rstrip()}, far outside the others, {NO_VALUE}"
        return Advice("outliers", sentence, n, "empty these cells, which are then missing samples", "warning")
    todo = "look at them, and mark them as missing or fit with a robust loss, sysid.Objective"
    return Advice("outliers", sentence, n, todo, "warning", call="sysid.data.outliers.outliers(data).data")


def _too_little(data: IOData, j: int) -> Advice:
    return Advice(
        "data",
        f"{data.N} samples of {channel(data, 'y', j)} are too few, or vary too little, to test for delay, feedback and "
        "nonlinearity",
        data.N,
        f"record at least {LEAST * (data.u.shape[1] + 1)} samples in which input and output move",
        "warning",
    )
