"""A measured frequency response: from arrays, from a coherence, or from a `control.FRD`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError

_FEWEST = 3  # frequencies


@dataclass(frozen=True)
class FrequencyData:
    """The response (n,) [y/u], complex, at rising angular frequencies w (n,) [rad/s].

    std (n,): standard deviation of its real part and, the same, of its imaginary part [y/u]; None where it is unknown.
    With `absolute` False only the ratios of std are known. Ts [s]: of a response of samples whose input is held
    between them; None of a response of continuous signals, such as those of a sine test.
    """

    w: np.ndarray
    response: np.ndarray
    std: np.ndarray | None = None
    absolute: bool = True
    Ts: float | None = None
    y_unit: str = ""
    u_unit: str = ""

    def __post_init__(self) -> None:
        n = len(self.w)
        if np.shape(self.w) != (n,) or np.shape(self.response) != (n,) or n < _FEWEST:
            raise InputError(
                f"frequencies and response have shapes {np.shape(self.w)} and {np.shape(self.response)}; give one "
                f"complex number for each of at least {_FEWEST} frequencies"
            )
        if not (np.all(np.isfinite(self.w)) and np.all(np.isfinite(self.response))):
            raise InputError("a frequency or a response is not a finite number; leave that row out")
        if not (np.all(np.diff(self.w) > 0.0) and self.w[0] > 0.0):
            raise InputError("the frequencies do not rise from above 0; sort the rows, and leave out 0 and repetitions")
        if not np.any(self.response):
            raise InputError("the response is 0 at all frequencies; give one that is not")
        if self.std is not None and (
            np.shape(self.std) != (n,) or not np.all(self.std > 0.0) or not np.all(np.isfinite(self.std))
        ):
            raise InputError("std must hold one positive number for each frequency; leave it out where it is unknown")
        if self.Ts is not None and not 0.0 < self.Ts * self.w[-1] <= np.pi * (1.0 + 1e-9):
            raise InputError(
                f"Ts is {self.Ts:g} s and the highest frequency {self.w[-1]:g} rad/s; give none for continuous "
                f"signals, or the sampling time, up to pi / {self.w[-1]:g} = {np.pi / self.w[-1]:.4g} s"
            )


@checked(deferred=("w", "response"))
def frequency_data(
    w: Any,
    response: np.ndarray | None = None,
    std: np.ndarray | None = None,
    coherence: np.ndarray | None = None,
    averages: float | None = None,
    Ts: float | None = None,
    y_unit: str = "",
    u_unit: str = "",
) -> FrequencyData:
    """Frequency response data for `sysid.fit`, from arrays as in `FrequencyData` or a `control.FRD` in place of w.

    The coherence (n,) in place of std gives |G| sqrt((1 - c) / (2 m c)) for `averages` of m independent periodograms
    (Bendat and Piersol, Random Data, 4th ed. 2010, section 9.2), and without m the ratios alone. Rows may come in any
    order. Raises InputError for arrays that do not go together, several inputs or outputs, and a coherence outside 0
    to 1.
    """
    if response is None:
        w, response, Ts = _of_object(w, Ts)
    w, response = np.asarray(w, dtype=float), np.asarray(response, dtype=complex)
    if std is not None and coherence is not None:
        raise InputError("std and coherence are given, and either tells the errors; leave one out")
    absolute = coherence is None or averages is not None
    if coherence is not None:
        std = _of_coherence(response, np.asarray(coherence, dtype=float), 1.0 if averages is None else averages)
    order = np.argsort(w, kind="stable") if w.ndim == 1 and w.shape == response.shape else slice(None)
    if std is not None:
        std = np.asarray(std, dtype=float)
        std = std[order] if std.shape == w.shape else std
    return FrequencyData(w[order], response[order], std, absolute, Ts, y_unit, u_unit)


def _of_object(frd: Any, Ts: float | None) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Frequencies, response and sampling time of a `control.FRD`."""
    if not (hasattr(frd, "frdata") and hasattr(frd, "omega")):
        raise InputError("response is missing; give frequencies and responses, or a control.FRD alone")
    response = frd.frdata
    if np.shape(response)[:-1] != (1, 1):
        raise InputError(f"the response has shape {np.shape(response)}; give that of one input and one output")
    dt = getattr(frd, "dt", None)
    return np.asarray(frd.omega), np.asarray(response)[0, 0], Ts or (float(dt) if dt and dt is not True else None)


def _of_coherence(response: np.ndarray, coherence: np.ndarray, averages: float) -> np.ndarray | None:
    """Standard deviations (n,) of each part; None where every coherence is 1."""
    if coherence.shape != response.shape or not np.all((coherence > 0.0) & (coherence <= 1.0)):
        raise InputError("coherence must lie above 0 and up to 1 at every frequency; leave other rows out")
    if not averages > 0.0:
        raise InputError(f"averages is {averages}; give how many independent periodograms were averaged")
    rest = 1.0 - coherence
    if not rest.any():
        return None
    rest = np.maximum(rest, rest[rest > 0.0].min())  # a coherence that was rounded to 1 is not without errors
    return np.asarray(np.abs(response) * np.sqrt(rest / (2.0 * averages * coherence)))
