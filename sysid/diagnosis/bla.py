"""Best linear approximation (BLA) of a system under periodic excitation, with variances from noise and distortion.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, chapter 4: the part that
repeats from period to period is the system, the rest is noise. Differences between realisations of the input (new
random phases, same spectrum) beyond the noise are nonlinear distortion.
"""

from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.poles import mirrored
from sysid.data.record import IOData, siso


@dataclass(frozen=True)
class Bla:
    """Frequency response G (F,) at `frequency` [Hz] (F,) and the variances of its parts, all in the unit of |G|^2.

    noise_variance (F,) and total_variance (F,) belong to G averaged over all periods and realisations: from noise
    alone, and from noise and distortion. distortion_variance (F,) belongs to the response of one realisation, not
    averaged; it is nan where the data do not determine it. The input is empty at the detection lines, so the output
    there, `detected` (D,) [y^2 per line, noise removed], is distortion: from odd nonlinearities at odd multiples of
    the base frequency, from even nonlinearities at even multiples.
    """

    frequency: np.ndarray
    G: np.ndarray
    noise_variance: np.ndarray
    total_variance: np.ndarray
    distortion_variance: np.ndarray
    detection_lines: np.ndarray
    detected: np.ndarray
    output_noise: np.ndarray  # variance of the output's spectrum at the detection lines, averaged over periods (D,)
    Ts: float
    period: int
    periods: int
    realisations: int
    method: str

    @property
    def sentence(self) -> str:
        """The data used and the result."""
        shape = (
            f"{self.realisations} realisation(s) of {self.periods} period(s) of {self.period} samples, "
            f"{len(self.frequency)} lines: "
        )
        noise = 10 * np.log10(np.mean(self.noise_variance) / np.mean(np.abs(self.G) ** 2) + 1e-300)
        if not np.isfinite(self.distortion_variance).any():
            return f"{shape}noise {noise:.0f} dB below the response; add realisations to see nonlinear distortion"
        share = max(float(np.nanmean(self.distortion_variance)), 0.0) / float(np.mean(np.abs(self.G) ** 2))
        level = 10 * np.log10(share + 1e-300)
        return f"{shape}noise at {noise:.0f} dB, nonlinear distortion at {level:.0f} dB of |G|^2"


@checked(late=True)
def find_period(u: np.ndarray, tolerance: float = 1e-9) -> int:
    """The shortest period [samples] of u (N,), which must repeat at least once; raises InputError if there is none."""
    u = np.asarray(u, dtype=float).ravel()
    limit = tolerance * float(np.ptp(u)) if len(u) else 0.0
    for P in range(2, len(u) // 2 + 1):
        head = slice(0, min(len(u) - P, 16))
        if np.all(np.abs(u[P:][head] - u[head]) <= limit) and np.all(np.abs(u[P:] - u[:-P]) <= limit):
            return P
    raise InputError(f"the input does not repeat within {len(u)} samples; excite with whole periods of one signal")


@checked(late=True)
def estimate(data: IOData, period: int | None = None, skip: int = 1) -> Bla:
    """The BLA of a record whose input repeats every `period` samples; every experiment is one realisation.

    The first `skip` periods of each experiment are left out as transient. Several realisations use the robust method
    (section 4.3.1). One realisation uses the fast method (section 4.3.2): it measures the distortion at the detection
    lines and needs an input that leaves some odd lines empty. Raises InputError if the input does not repeat, or if
    fewer than two periods are left.
    """
    siso(data)
    if data.missing is not None:
        raise InputError("the record has missing outputs; a spectrum needs whole periods, so cut out the gaps first")
    if period is None:
        period = find_period(data.experiments[0].u[:, 0])
    U, Y = _spectra(data, int(period), int(skip))
    M, P, _ = Y.shape
    excited = np.abs(U[:, 0]).min(axis=0) > 1e-3 * np.sqrt(np.mean(np.abs(U[:, 0]) ** 2, axis=1)).max()
    excited[0] = False
    if period % 2 == 0:
        excited[-1] = False  # the Nyquist line is real and has no phase to average over
    k = np.flatnonzero(excited)
    if not len(k):
        raise InputError("the input is constant over its period; excite with a multisine or a binary signal")
    mean_Y = Y.mean(axis=1)
    noise_Y = np.sum(np.abs(Y - mean_Y[:, None]) ** 2, axis=1) / (P * (P - 1))  # of the mean over periods (M, lines)
    responses = mean_Y[:, k] / U[:, 0, k]
    G = responses.mean(axis=0)
    noise = np.mean(noise_Y[:, k] / np.abs(U[:, 0, k]) ** 2, axis=0) / M
    quiet = _detection_lines(excited, k)
    distortion_power = np.mean(np.abs(mean_Y[:, quiet]) ** 2 - noise_Y[:, quiet], axis=0)
    if M > 1:
        total = np.sum(np.abs(responses - G) ** 2, axis=0) / (M * (M - 1))
        distortion, method = M * (total - noise), "robust"
    else:
        distortion = _from_detection(k, quiet, distortion_power, np.abs(G) ** 2) / np.abs(U[0, 0, k]) ** 2
        total, method = noise + np.fmax(np.nan_to_num(distortion), 0.0), "fast"
    return Bla(
        frequency=k / (period * data.Ts),
        G=G,
        noise_variance=noise,
        total_variance=total,
        distortion_variance=distortion,
        detection_lines=quiet,
        detected=distortion_power * (2.0 / period**2),  # |Y|^2 of a one-sided DFT to y^2
        output_noise=noise_Y[:, quiet].mean(axis=0) * (2.0 / period**2),
        Ts=data.Ts,
        period=int(period),
        periods=P,
        realisations=M,
        method=method,
    )


def _spectra(data: IOData, period: int, skip: int) -> tuple[np.ndarray, np.ndarray]:
    """DFT of every period: U, Y (realisations, periods, lines)."""
    if period < 4 or skip < 0:
        raise InputError(f"period is {period} and skip {skip}; a period needs 4 samples and skip must not be negative")
    counts = {e.N // period - skip for e in data.experiments}
    P = min(counts)
    if P < 2:
        raise InputError(
            f"{min(data.lengths)} samples hold {P + skip} period(s) of {period}, of which {skip} are left out as "
            "transient; record at least two more"
        )
    spans = [e.select(skip * period, (skip + P) * period) for e in data.experiments]
    u = np.array([e.u[:, 0].reshape(P, period) for e in spans])
    y = np.array([e.y[:, 0].reshape(P, period) for e in spans])
    worst = float(np.abs(u - u[:, :1]).max())
    if worst > 1e-6 * float(np.ptp(u)):
        raise InputError(
            f"the input differs by up to {worst:.3g} between periods of {period} samples; give the true period"
        )
    return np.fft.rfft(u, axis=2), np.fft.rfft(y, axis=2)


def _detection_lines(is_excited: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Lines without input below the highest excited one."""
    quiet = np.flatnonzero(~is_excited[: k.max() + 1])
    return quiet[quiet > 0]


def _from_detection(k: np.ndarray, quiet: np.ndarray, distortion_power: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Distortion at the excited lines k (F,), interpolated from the odd detection lines; nan if there are too few.

    Even lines count too if the input contains them. Between the lines the distortion is assumed to be proportional to
    |G|^2 (F,), and the ratio is smoothed. This is exact for a nonlinearity before the dynamics.
    """
    use = quiet % 2 == 1 if np.all(k % 2 == 1) else np.ones(len(quiet), dtype=bool)
    if use.sum() < 4:
        return np.full(len(k), np.nan)
    share = _smooth(distortion_power[use] / np.interp(quiet[use], k, gain), 5)
    return gain * np.interp(k, quiet[use], share)


@dataclass(frozen=True)
class Parametric:
    """B/F of the given orders, fitted to a BLA: b (nb,), f (nf,), delay nk.

    cost is sum |G - B/F|^2 / total variance over the lines; expected is its expected value if the orders suffice.
    """

    b: np.ndarray
    f: np.ndarray
    nk: int
    cost: float
    expected: float

    @property
    def poles(self) -> np.ndarray:
        """Poles in z (nf,), complex."""
        return np.roots(np.concatenate([[1.0], self.f])).astype(complex)

    @property
    def sentence(self) -> str:
        """Whether the orders suffice."""
        ratio = self.cost / self.expected
        verdict = "the orders suffice" if ratio < 1.5 else "higher orders or another delay would fit better"
        return f"the weighted misfit is {ratio:.2g} times what noise and distortion explain: {verdict}"


@checked(late=True)
def parametric(bla: Bla, nb: int, nf: int, nk: int = 1) -> Parametric:
    """Stable B/F closest to the BLA, weighted with its variance.

    Sanathanan-Koerner iterations give the start and Levenberg-Marquardt the minimum (Pintelon and Schoukens, chapter
    9). Poles outside the unit circle are mirrored inside, and B is fitted again. Raises InputError for more parameters
    than the lines determine.
    """
    from scipy.optimize import least_squares

    F = len(bla.frequency)
    if nb < 1 or nf < 0 or nk < 0 or nb + nf > 2 * F:
        raise InputError(
            f"orders nb {nb}, nf {nf}, nk {nk} for {F} lines; give nb >= 1, nf, nk >= 0, nb + nf <= {2 * F}"
        )
    q = np.exp(-2j * np.pi * bla.frequency * bla.Ts)
    weight = 1.0 / np.sqrt(_weights(bla))
    X, Z = q[:, None] ** (nk + np.arange(nb)), q[:, None] ** (1 + np.arange(nf))

    def response(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        denominator = 1.0 + Z @ p[nb:]
        return (X @ p[:nb]) / denominator, denominator

    def residual(p: np.ndarray) -> np.ndarray:
        return _split((response(p)[0] - bla.G) * weight)

    def jacobian(p: np.ndarray) -> np.ndarray:
        H, denominator = response(p)
        return _split(np.column_stack([X, -Z * H[:, None]]) * (weight / denominator)[:, None])

    p, best = np.zeros(nb + nf), np.inf
    scale = np.ones(F)
    for _ in range(20):
        w = weight / scale
        A = _split(np.column_stack([X, -Z * bla.G[:, None]]) * w[:, None])
        trial = np.linalg.lstsq(A, _split(bla.G * w), rcond=None)[0]
        cost = float(np.sum(residual(trial) ** 2))
        if cost < best:
            p, best = trial, cost
        scale = np.maximum(np.abs(response(trial)[1]), 1e-12)
    p = least_squares(residual, p, jacobian, method="lm", x_scale="jac", max_nfev=500).x if nb + nf <= F * 2 else p
    if np.any(np.abs(np.roots(np.concatenate([[1.0], p[nb:]]))) > 1.0):
        f = mirrored(p[nb:])
        columns = X * (weight / (1.0 + Z @ f))[:, None]
        p = np.concatenate([np.linalg.lstsq(_split(columns), _split(bla.G * weight), rcond=None)[0], f])
    cost = float(np.sum(residual(p) ** 2))
    return Parametric(p[:nb], p[nb:], nk, cost, max(F - 0.5 * (nb + nf), 0.5))


def _weights(bla: Bla) -> np.ndarray:
    """Variance of G for weighting, smoothed over lines because the variance of a few realisations is uncertain."""
    # Smoothed before they are compared: the larger of two uncertain numbers is biased upwards.
    variance = np.maximum(_smooth(bla.total_variance, 9), _smooth(bla.noise_variance, 9))
    return np.maximum(variance, (1e-9 * np.abs(bla.G).max()) ** 2)


def _smooth(x: np.ndarray, width: int) -> np.ndarray:
    """Mean over `width` neighbours, fewer at the ends."""
    window = np.ones(min(width, len(x)))
    return np.convolve(x, window, "same") / np.convolve(np.ones(len(x)), window, "same")


def _split(z: np.ndarray) -> np.ndarray:
    return np.concatenate([z.real, z.imag])
