"""Helpers of the excitations: checks of settings, times as whole samples, and a bounded running sum."""

from collections.abc import Iterable, Mapping
from numbers import Integral, Real

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.limits import MOST, SAMPLES, SECONDS, check_steps

# Settings for a plant that crosses its range in about 2 s ("fast") and for one that takes about 6 s ("slow").
Paces = Mapping[str, Mapping[str, float | str]]
PACES = ("fast", "slow")


def check(owner: str, positive: dict[str, float], finite: dict[str, float] | None = None) -> None:
    """Raises InputError if a value is not a number, not finite, or not above zero where it must be."""
    for name, value in positive.items():
        if not _number(value) or not 0 < value < np.inf:
            raise InputError(f"{name} of {owner} is {value!r}; give a number above 0")
        _check_size(owner, name, value)
    for name, value in (finite or {}).items():
        if not _number(value) or not -np.inf < value < np.inf:
            raise InputError(f"{name} of {owner} is {value!r}; give a finite number")
        _check_size(owner, name, value)


def check_from_zero(owner: str, values: dict[str, float]) -> None:
    """Raises InputError if a value is not a finite number of at least 0."""
    for name, value in values.items():
        if not _number(value) or not 0 <= value < np.inf:
            raise InputError(f"{name} of {owner} is {value!r}; give a number of at least 0")
        _check_size(owner, name, value)


def check_whole(owner: str, name: str, value: float, lowest: int, highest: int) -> None:
    """Raises InputError if a value is not a whole number from `lowest` to `highest`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not lowest <= value <= highest:
        raise InputError(f"{name} of {owner} is {value!r}; give a whole number from {lowest} to {highest}")


def check_name(owner: str, name: str, value: str, allowed: Iterable[str]) -> None:
    """Raises InputError if a value is not one of the allowed names."""
    if value not in tuple(allowed):
        raise unknown(f"{name} of {owner}", value, allowed)


def samples(owner: str, name: str, seconds: float, Ts: float) -> int:
    """`seconds` as the nearest whole number of samples of Ts [s]; raises InputError if that is less than one.

    A period is computed as a whole, so it may not be longer than a record may be.
    """
    check_steps(f"{name} of {owner}", seconds / Ts, SAMPLES if name == "period" else MOST)
    count = round(seconds / Ts)
    if count < 1:
        raise InputError(f"{name} of {owner} is {seconds:g} s, less than one sample of {Ts:g} s; give {Ts:g} s or more")
    return count


def check_band(owner: str, f_min: float, f_max: float, Ts: float) -> None:
    """Raises InputError if the band [Hz] does not end below half the sampling rate."""
    if f_max >= 0.5 / Ts:
        raise InputError(
            f"f_max of {owner} is {f_max:g} Hz, and half the sampling rate is {0.5 / Ts:g} Hz; give f_max below that, "
            f"or a shorter Ts"
        )


def within_reach(total: float, step: float, most: float) -> tuple[float, float]:
    """Sign and share of a `step` of a running sum that keep |total + sign share step| <= most.

    The sign changes if the drawn step would exceed the bound; if the opposite step exceeds it too, the step is reduced.
    """
    if abs(total + step) <= most:
        return 1.0, 1.0
    room = most + abs(total)
    return -float(np.sign(total * step) or 1.0), min(1.0, room / abs(step))


def half_way(u: np.ndarray) -> np.ndarray:
    """Indices of a periodic u (P,) from which its running sum moves equally far down and up, to within one step.

    The response of an integrating plant then stays centred on its initial value.
    """
    total = np.cumsum(u - u.mean()) - (u - u.mean())
    distance = np.abs(total - (total.min() + total.max()) / 2)
    return np.flatnonzero(distance <= max(distance.min(), np.abs(u).max() / 2))


def _check_size(owner: str, name: str, value: float) -> None:
    """Raises InputError for a setting that no clock and no amplifier has."""
    if abs(value) > SECONDS:
        raise InputError(f"{name} of {owner} is {value!r}; give a number up to {SECONDS:g}")


def _number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
