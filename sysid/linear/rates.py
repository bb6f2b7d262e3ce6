"""The tangent of a fit in continuous time, and at another sampling time."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm, logm

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.blocks import Process
from sysid.estimation.result import Fit
from sysid.linear.linearize import tangent

if TYPE_CHECKING:
    from control import TransferFunction

METHODS = ("zoh", "tustin")
_REAL = 1e-9  # what rounding leaves of an imaginary part
_ZERO = 1e-9  # modulus of a pole that is a delay


@dataclass(frozen=True)
class Continuous:
    """G(s) exp(-delay s) as a `control.TransferFunction` G and a dead time [s]."""

    G: "TransferFunction"
    delay: float


@checked
def d2c(fit: Fit, u: float = 0.0, method: str = "zoh") -> Continuous:
    """The continuous-time model that the tangent at the constant input u is the sampled form of.

    "zoh": the input is held between samples, as a digital output does it; exact for nk >= 1, and the delay is that
    beyond the one sample that sampling itself brings. "tustin" (the bilinear rule) exists for every model and has the
    right frequency response only well below Nyquist. Raises InputError for another method, and for poles at or left of
    z = 0, which no held input on a model of the same order gives.
    """
    if method not in METHODS:
        raise unknown("method", method, METHODS)
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    if method == "zoh" and (process := _process(fit)) is not None:  # which is in continuous time as it stands
        num, den, delay = process[0].continuous(process[1])
        return Continuous(control.tf(num, den), delay)
    B, F, extra = _parts(fit, u)
    A, b, c, d = _companion(B, F)
    if method == "zoh":
        A, b, c, d = _undo_hold(A, b, c, d, fit.Ts)
    else:
        A, b, c, d = _bilinear(A, b, c, d, fit.Ts)
    return Continuous(control.tf(*_rational(A, b, c, d)), extra * fit.Ts)


def _process(fit: Fit) -> tuple[Process, np.ndarray] | None:
    """The process of a fit and its parameters."""
    return next(((b, fit.model.part(fit.theta, b)) for b in fit.model.blocks if isinstance(b, Process)), None)


@checked(deferred=("Ts",))
def d2d(fit: Fit, Ts: float, u: float = 0.0) -> "TransferFunction":
    """The tangent at the constant input u sampled every `Ts` [s], for an input that is held between samples.

    Raises InputError where `d2c` has no zero-order hold form, and for a delay that is no multiple of the new `Ts`.
    """
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    if not (np.isfinite(Ts) and Ts > 0):
        raise InputError(f"Ts is {Ts}; give the new sampling time as a positive number of seconds")
    if (process := _process(fit)) is not None:
        B, F = replace(process[0], Ts=Ts).rational(process[1])[:2]
        n = max(len(B), len(F))
        return control.tf(np.trim_zeros(np.pad(B, (0, n - len(B))), "f"), np.pad(F, (0, n - len(F))), Ts)
    B, F, extra = _parts(fit, u)
    samples = extra * fit.Ts / Ts
    if abs(samples - round(samples)) > 1e-6:
        raise InputError(
            f"the delay of {extra * fit.Ts:g} s is {samples:g} samples of {Ts:g} s; choose a Ts that divides it"
        )
    A, b, c, d = _apply_hold(*_undo_hold(*_companion(B, F), fit.Ts), Ts)
    num, den = _rational(A, b, c, d)
    return control.tf(num, np.concatenate([den, np.zeros(round(samples))]), Ts)


def _parts(fit: Fit, u: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Numerator and denominator in falling powers of z of the tangent without its extra delay, and that [samples]."""
    G = tangent(fit, u)
    num, den = np.atleast_1d(G.num[0][0]).astype(float), np.atleast_1d(G.den[0][0]).astype(float)
    num = np.trim_zeros(num, "f")
    if not len(num):
        raise InputError("the tangent's gain is 0 at this operating point; choose a u where the maps have a slope")
    # Poles at 0 are delays, as far as the numerator leaves room for them.
    extra = 0
    while len(den) - len(num) > 1 and abs(den[-1]) <= _ZERO * np.abs(den).max():
        den, extra = den[:-1], extra + 1
    return num / den[0], den / den[0], extra


def _companion(num: np.ndarray, den: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A (n, n), b (n, 1), c (1, n), d of num/den, den with its leading 1."""
    n = len(den) - 1
    wide = np.concatenate([np.zeros(n + 1 - len(num)), num])
    A = np.eye(n, k=-1)
    if n:
        A[0] = -den[1:]
    return A, np.eye(n, 1), (wide[1:] - wide[0] * den[1:])[None, :], float(wide[0])


def _undo_hold(
    A: np.ndarray, b: np.ndarray, c: np.ndarray, d: float, Ts: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The inverse of a zero-order hold: the logarithm of [[A, b], [0, 1]]."""
    n = len(A)
    poles = np.linalg.eigvals(A)
    for z in poles:
        if abs(z) <= 1e-6:
            raise InputError(
                "the tangent has a pole at z = 0 that is no delay (nb is above nf), and no held input gives one; "
                'take method="tustin", or nb of at most nf'
            )
        if abs(z.imag) <= _REAL * abs(z) and z.real < 0:
            raise InputError(
                f"the tangent has a pole at z = {z.real:.4g}; a pole left of 0 has no form of the same order in "
                'continuous time: take method="tustin", or a smaller nf'
            )
    logarithm = logm(np.block([[A, b], [np.zeros((1, n)), np.ones((1, 1))]])) / Ts
    generator = np.real(logarithm)
    if not np.all(np.isfinite(generator)) or np.abs(np.imag(logarithm)).max() > 1e-6 * max(
        np.abs(generator).max(), 1e-300
    ):
        raise InputError('the tangent has no real form in continuous time; take method="tustin"')
    return generator[:n, :n], generator[:n, n:], c, d


def _apply_hold(
    A: np.ndarray, b: np.ndarray, c: np.ndarray, d: float, Ts: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    n = len(A)
    exponential = expm(np.block([[A, b], [np.zeros((1, n + 1))]]) * Ts)
    return exponential[:n, :n], exponential[:n, n:], c, d


def _bilinear(
    A: np.ndarray, b: np.ndarray, c: np.ndarray, d: float, Ts: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """z = (1 + s Ts/2)/(1 - s Ts/2)."""
    eye = np.eye(len(A))
    if abs(np.linalg.det(eye + A)) < 1e-12:
        raise InputError("the tangent has a pole at z = -1, for which the bilinear rule has no form; take a smaller nf")
    inverse = np.linalg.inv(eye + A)
    size = 2.0 / np.sqrt(Ts)
    direct = d - float((c @ inverse @ b)[0, 0]) if len(A) else d
    return 2.0 / Ts * inverse @ (A - eye), size * inverse @ b, size * c @ inverse, direct


def _rational(A: np.ndarray, b: np.ndarray, c: np.ndarray, d: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator: c adj(x - A) b + d det(x - A), by the matrix determinant lemma."""
    if not len(A):
        return np.array([d]), np.ones(1)
    den, closed_loop = np.real(np.poly(A)), np.real(np.poly(A - b @ c))
    num = closed_loop - den
    num[np.abs(num) < 1e-12 * (np.abs(closed_loop) + np.abs(den))] = 0.0  # what rounding leaves
    num = num + d * den
    return np.trim_zeros(num, "f") if np.any(num) else np.zeros(1), den
