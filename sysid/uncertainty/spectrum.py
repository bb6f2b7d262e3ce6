"""Spectral estimates: the frequency response of a record without a model, its coherence, and bands.

Means of modified periodograms (Welch 1967, IEEE Trans. Audio and Electroacoustics 15) give the auto and cross spectra;
the error of their ratio follows from the coherence and from how many independent periodograms were averaged (Bendat
and Piersol, Random Data, 4th ed. 2010, chapter 9).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import csd, get_window
from scipy.special import chdtri, stdtrit

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.data.record import IOData, siso
from sysid.uncertainty.intervals import Band
from sysid.uncertainty.responses import FrequencyResponse

_PARTS = 12  # parts of a record by default, before their overlap
_FEWEST = 16  # samples of a part
_LEAST = 3  # independent parts, below which a band says nothing


@dataclass(frozen=True)
class Spectrum(FrequencyResponse):
    """Magnitude [y/u] and phase [deg] over angular frequencies w (n,) [rad/s], with bands, as `FrequencyResponse`.

    response (n,): the complex frequency response. coherence (n,): the share of the output's power that is linear in the
    input, 0 to 1. input and output (n,): auto spectra [unit squared per Hz], one-sided. parts: independent periodograms
    that were averaged. samples: length of each, which resolves frequencies 1 / (samples Ts) apart [Hz].
    """

    response: np.ndarray
    coherence: np.ndarray
    input: np.ndarray
    output: np.ndarray
    parts: float
    samples: int


@checked
def spectrum(data: IOData, samples: int | None = None, level: float = 0.95) -> Spectrum:
    """The frequency response of a record of one input and one output, by Welch's method: Hann windows, overlap a half.

    samples: of each part, by default a twelfth of the record: longer ones resolve more and have wider bands. Peaks that
    are narrower than 4 / (samples Ts) [Hz] come out too low, and so does a response with a delay of more than a small
    share of a part. In a record of a controlled plant the noise goes round the loop and the estimate is biased. Bands
    are those of each frequency alone, for noise that is stationary. Raises InputError for several channels, missing
    outputs, parts that are too short or too few, and a level that is no probability.
    """
    siso(data)
    if data.missing is not None and data.missing.any():
        raise InputError("the record has missing outputs; give a part without gaps (IOData.select), or fill them first")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a probability between 0 and 1, for example 0.95")
    n = max(max(data.lengths) // _PARTS // 2 * 2, _FEWEST) if samples is None else int(samples)
    long = [e for e in data.experiments if n <= e.N]
    count = sum(_segments(e.N, n) for e in long)
    parts = _independent(count, n) if n >= _FEWEST else 0.0
    if parts < _LEAST:
        raise InputError(
            f"parts of {n} samples leave {parts:.2g} independent ones of {data.N} samples; give {_FEWEST} samples or "
            f"more for each, of which at least {_LEAST} fit into the record one behind the other"
        )
    f, sums = np.empty(0), np.zeros(0)
    for e in long:
        u, y = e.u[:, 0], e.y[:, 0]
        each = [csd(a, b, 1.0 / e.Ts, "hann", n, n // 2, detrend="constant") for a, b in ((u, u), (u, y), (y, y))]
        f, weighted = each[0][0], _segments(e.N, n) / count * np.array([density for _, density in each])
        sums = weighted if not len(sums) else sums + weighted
    keep = (f > 0.0) & (np.abs(sums[0]) > 0.0)
    (Suu, Suy, Syy), w = sums[:, keep], 2.0 * np.pi * f[keep]
    if not len(w):
        raise InputError("the input is constant; record one that varies")
    Suu, Syy, G = np.abs(Suu), np.abs(Syy), Suy / np.abs(Suu)
    coherence = np.minimum(np.abs(Suy) ** 2 / np.where(Syy > 0.0, Suu * Syy, np.inf), 1.0)
    freedom = 2.0 * parts - 2.0
    std = np.sqrt((1.0 - coherence) * Syy / Suu / freedom)  # of the real and of the imaginary part
    reach = float(stdtrit(freedom, 0.5 + 0.5 * level)) * std
    size, angle = np.abs(G), np.degrees(np.unwrap(np.angle(G)))
    known = reach < size
    turn = np.degrees(np.arcsin(np.where(known, reach / np.where(size > 0.0, size, 1.0), 0.0)))
    turn = np.where(known, turn, np.inf)
    magnitude = Band(w, size, std, np.maximum(size - reach, 0.0), size + reach, level)
    phase_std = np.degrees(np.divide(std, size, out=np.full_like(size, np.inf), where=size > 0.0))
    phase = Band(w, angle, phase_std, angle - turn, angle + turn, level)
    return Spectrum(magnitude, phase, G, coherence, Suu, Syy, parts, n)


@checked
def noise_spectrum(v: np.ndarray, data: IOData, samples: int | None = None, level: float = 0.95) -> Band:
    """Power [unit of y squared per Hz], one-sided, of errors v (N,) of the record over w (n,) [rad/s], with its band.

    By Welch's method as in `spectrum`; the band is that of chi squared (Bendat and Piersol, section 8.5), for noise
    that is stationary. Raises InputError for parts that are too short or too few.
    """
    errors = replace(data, u=v[:, None], y=v[:, None], missing=None)
    estimate = spectrum(errors, samples, level)
    freedom, S = 2.0 * estimate.parts, estimate.output
    low, high = (freedom / float(chdtri(freedom, 0.5 * (1.0 - sign * level))) for sign in (1.0, -1.0))
    return Band(estimate.magnitude.x, S, S * np.sqrt(2.0 / freedom), S * low, S * high, level)


def _segments(N: int, n: int) -> int:
    """Parts of n samples in N that overlap by a half."""
    return (N - n // 2) // (n - n // 2)


def _independent(count: int, n: int) -> float:
    """How many independent periodograms have the variance of the mean of `count` that overlap by a half."""
    window = get_window("hann", n)
    shared = float(window[n // 2 :] @ window[: n - n // 2]) / float(window @ window)
    return count / (1.0 + 2.0 * shared**2 * max(count - 1, 0) / max(count, 1))
