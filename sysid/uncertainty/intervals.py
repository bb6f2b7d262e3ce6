"""Intervals of the quantities of a fit: poles, zeros, time constants, damping, gains, parameters.

All use the delta method on exact gradients, with Student's t for few samples. The `note` of an interval says why the
record does not determine the quantity, or that the linear approximation is inaccurate; otherwise it is empty.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from scipy.special import chdtri, fdtri

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError
from sysid.base.poles import time_constant
from sysid.blocks import Innovations, Process, StateSpace, TransferFunction
from sysid.model.tangents import Rational, estimator, steady_curve, tangent, transfer
from sysid.uncertainty.information import Information

_ROUGH = "is within three standard deviations of another root: the interval is inaccurate"
_MULTIPLE = "is a multiple root, which has no first derivative"
CANCELLED = "is cancelled by a zero within the accuracy of the record, so the record determines neither of the two"
_DELAY_MODULUS = 1e-9  # modulus of a pole that is a delay
_RESPONSE_SAMPLES = 300  # samples of the impulse response that give the size of a filter


@dataclass(frozen=True)
class Interval:
    """A number, its standard deviation and the limits of its interval; nan and infinite if undetermined (`note`)."""

    value: float
    std: float
    lower: float
    upper: float
    note: str = ""


@dataclass(frozen=True)
class Band:
    """A curve over x (n,): pointwise value, standard deviation and interval (n,)."""

    x: np.ndarray
    value: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    level: float
    note: str = ""

    @classmethod
    def bare(cls, x: np.ndarray, value: np.ndarray) -> "Band":
        """A curve of which nothing but the values (n,) is known: deviation nan, interval infinite."""
        unknown = np.full(len(x), np.inf)
        return cls(x, value, np.full(len(x), np.nan), -unknown, unknown, 0.95)


@dataclass(frozen=True)
class Root:
    """A pole or zero in z, with intervals of the derived quantities.

    `cov` (2, 2) of real and imaginary part; natural frequency [rad/s] and damping of s = ln(z)/Ts; time constant [s] of
    the envelope, -Ts/ln|z|, whose interval is unbounded if the modulus may reach 1.
    """

    value: complex
    cov: np.ndarray
    real: Interval
    imag: Interval
    modulus: Interval
    frequency: Interval
    damping: Interval
    time_constant: Interval
    level: float
    dof: float
    note: str = ""

    @property
    def std(self) -> float:
        """sqrt(var Re + var Im)."""
        return float(np.sqrt(np.trace(self.cov)))

    def ellipse(self) -> tuple[float, float, float]:
        """Semi-axes and angle of the first [rad] of the region that holds the root with probability `level`.

        The second semi-axis of a real root is 0, and the first is that of its interval.
        """
        values, vectors = np.linalg.eigh(np.nan_to_num(self.cov))
        a, b = np.sqrt(np.maximum(values[::-1], 0.0))
        if self.value.imag == 0.0:
            return float(self.real.upper - self.value.real), 0.0, 0.0
        size = _region(self.level, self.dof)
        return float(size * a), float(size * b), float(np.arctan2(vectors[1, 1], vectors[0, 1]))


@checked(deferred=("value", "gradient"))  # an unstable model has infinite ones
def interval(info: Information, value: float, gradient: np.ndarray, level: float = 0.95) -> Interval:
    """Interval of any quantity of theta from its value and gradient (P,)."""
    std = float(info.std_of(_gradients(info, gradient))[0])
    if not np.isfinite(std):
        return Interval(float(value), np.nan, -np.inf, np.inf, info.note_of(gradient))
    half = info.quantile(level) * std
    return Interval(float(value), std, float(value - half), float(value + half))


@checked(deferred=("value", "gradient"))
def band(info: Information, x: np.ndarray, value: np.ndarray, gradient: np.ndarray, level: float = 0.95) -> Band:
    """Pointwise band of a curve from its values (n,) and gradients (n, P); undetermined points have an infinite one."""
    std = info.std_of(_gradients(info, gradient))
    if np.shape(value) != np.shape(std):
        raise InputError(f"value has {np.size(value)} values and gradient {np.size(std)} rows; give one for each point")
    half = np.where(np.isfinite(std), info.quantile(level) * std, np.inf)
    return Band(x, value, std, value - half, value + half, level, info.note_of(gradient))


def _gradients(info: Information, gradient: np.ndarray) -> np.ndarray:
    """Gradients (n, P) or (P,); raises InputError for another number of parameters."""
    if np.ndim(gradient) not in (1, 2) or np.shape(gradient)[-1] != len(info.theta):
        raise InputError(f"gradient is {short_text(gradient)}; give rows of {len(info.theta)} numbers, one a parameter")
    return gradient


@checked
def parameters(info: Information, level: float = 0.95) -> dict[str, Interval]:
    """Interval of every free parameter by name; a parameter that the gauge changes has none."""
    rows = np.eye(len(info.theta))
    return {
        n: interval(info, info.theta[i], rows[i], level) for i, n in enumerate(info.chain.names) if info.chain.free[i]
    }


@checked
def poles(info: Information, level: float = 0.95) -> tuple[Root, ...]:
    """Poles of every transfer function of the chain, in the order of `Fit.poles`; of a state space, the eigenvalues of
    its tangent with the input at its centre.
    """
    roots_found = []
    rational = _of_state_space(info)
    if rational is not None:
        return tuple(_roots(info, rational.F, rational.F_gradient, level))
    for b in _linear(info):
        rational = transfer(info.chain, info.theta, b)
        roots = _roots(info, rational.F[: b.nf + 1], rational.F_gradient[: b.nf + 1], level)
        roots_found += [_open(r) if is_cancelled(info, b, r.value, level) else r for r in roots]
    return tuple(roots_found)


@checked
def zeros(info: Information, level: float = 0.95) -> tuple[Root, ...]:
    """Finite zeros of every transfer function of the chain, in the order of `Fit.zeros`."""
    space_tangent = _of_state_space(info)
    if space_tangent is not None:
        return tuple(_roots(info, space_tangent.B, space_tangent.B_gradient, level))
    roots_found = []
    for b in _linear(info):
        rational = transfer(info.chain, info.theta, b)
        roots_found += _roots(info, rational.B[b.nk : b.nk + b.nb], rational.B_gradient[b.nk : b.nk + b.nb], level)
    return tuple(roots_found)


@checked
def gain(info: Information, u: float = 0.0, level: float = 0.95) -> Interval:
    """Steady-state gain of the tangent at the constant input u, dy/du; independent of the gauge."""
    G = tangent(info.chain, info.theta, u)
    if not np.isfinite(G.gain):
        return Interval(np.inf, np.nan, -np.inf, np.inf, "is infinite: the chain integrates")
    return interval(info, G.gain, G.gain_gradient, level)


@checked
def steady_state(info: Information, u: np.ndarray | None = None, level: float = 0.95) -> Band:
    """Steady-state output for constant inputs u (n,), by default 101 over the record's range, in any gauge."""
    if u is None:
        u = np.linspace(info.data.u.min(), info.data.u.max(), 101)
    u = np.asarray(u, dtype=float)
    if u.ndim != 1:
        raise InputError(f"u is {short_text(u)}; give the constant inputs as one row of numbers")
    return band(info, u, *steady_curve(info.chain, info.theta, u), level)


def _of_state_space(info: Information) -> Rational | None:
    """The tangent of a process, or with the input at its centre, of a chain that begins with a state space."""
    first = info.chain.blocks[0]
    if any(isinstance(b, Process) for b in info.chain.blocks):
        return tangent(info.chain, info.theta)
    return tangent(info.chain, info.theta, float(first.scales()[0][0])) if isinstance(first, StateSpace) else None


def _linear(info: Information) -> list[TransferFunction]:
    filters = [b for b in info.chain.blocks if isinstance(b, TransferFunction)]
    if not filters:
        raise InputError("this chain has no transfer function, so it has no poles and zeros; use a structure with one")
    return filters


def _roots(info: Information, p: np.ndarray, dp: np.ndarray, level: float) -> list[Root]:
    """Roots of a polynomial p (n,), highest power first, with gradient dp (n, P): dz = -sum z^k dp_k / p'(z)."""
    if not np.any(p):
        return []
    lead = int(np.flatnonzero(p)[0])  # leading zeros are roots at infinity, which are left out
    p, dp = p[lead:], dp[lead:]
    roots, slope = np.roots(p).astype(complex), np.polyder(p)
    results = []
    for z in roots:
        d = np.polyval(slope, z)
        if abs(d) < 1e-12 * np.abs(p).max():
            results.append(_root(info, z, None, level, _MULTIPLE))
            continue
        results.append(_root(info, z, -(z ** np.arange(len(p) - 1, -1, -1)) @ dp / d, level))
    return [_with_warning(r, roots) for r in results]


def _open(root: Root) -> Root:
    """The same pole with unbounded intervals; its deviations remain those of the linear approximation."""
    if root.note not in ("", _ROUGH):
        return root
    names = ("real", "imag", "modulus", "frequency", "damping", "time_constant")
    wide = {n: replace(getattr(root, n), lower=-np.inf, upper=np.inf, note=CANCELLED) for n in names}
    return replace(root, note=CANCELLED, **wide)


def _root(info: Information, z: complex, dz: np.ndarray | None, level: float, note: str = "") -> Root:
    """A root z with the complex gradient dz (P,); None if it has no derivative; `note` says why."""
    if dz is None:
        unknown = [Interval(v, np.nan, -np.inf, np.inf, note) for v in _readings(z, info.Ts)]
        return Root(z, np.full((2, 2), np.nan), *unknown, level, info.dof, note)  # type: ignore[arg-type,call-arg]
    parts = np.array([dz.real, dz.imag])
    note = info.note_of(parts if z.imag else parts[:1])
    cov = np.full((2, 2), np.nan) if note else info.covariance_of(parts)
    real, imag = interval(info, z.real, parts[0], level), interval(info, z.imag, parts[1], level)
    return Root(z, cov, real, imag, *_meaning(info, z, dz, level), level=level, dof=info.dof, note=note)


def _meaning(
    info: Information, z: complex, dz: np.ndarray, level: float
) -> tuple[Interval, Interval, Interval, Interval]:
    """Modulus, natural frequency, damping and time constant of a root."""
    r, Ts = abs(z), info.Ts
    _, _, modulus, frequency, damping, tau = _readings(z, Ts)
    if r == 0.0:
        no_interval = Interval(np.nan, np.nan, -np.inf, np.inf, "has no meaning for a root at 0")
        return interval(info, 0.0, np.abs(dz), level), no_interval, no_interval, no_interval
    size = interval(info, modulus, np.real(np.conj(z) * dz) / r, level)
    spread = size.std * Ts / (np.log(r) ** 2 * r) if np.isfinite(tau) else np.nan
    envelope = Interval(tau, spread, time_constant(size.lower, Ts), time_constant(size.upper, Ts), size.note)
    s, ds = np.log(z) / Ts, dz / (z * Ts)
    if s == 0:
        no_interval = Interval(np.nan, np.nan, -np.inf, np.inf, "has no meaning for a root at 1")
        return size, interval(info, 0.0, np.abs(ds), level), no_interval, envelope
    dw = np.real(np.conj(s) * ds) / abs(s)
    d_damping = -(ds.real * abs(s) - s.real * dw) / abs(s) ** 2
    return size, interval(info, frequency, dw, level), interval(info, damping, d_damping, level), envelope


def _readings(z: complex, Ts: float) -> tuple[float, float, float, float, float, float]:
    """Real part, imaginary part, modulus, natural frequency [rad/s], damping, time constant [s]."""
    if z == 0:
        return 0.0, 0.0, 0.0, np.nan, np.nan, 0.0
    s = np.log(complex(z)) / Ts
    damping = float(-s.real / abs(s)) if s != 0 else np.nan
    return z.real, z.imag, abs(z), float(abs(s)), damping, time_constant(abs(z), Ts)


def _with_warning(root: Root, roots: np.ndarray) -> Root:
    """The root with a note if the linear approximation is inaccurate."""
    distances = np.abs(roots - root.value)
    distance = np.sort(distances)[1] if len(roots) > 1 else np.inf
    return replace(root, note=_ROUGH) if not root.note and distance < 3.0 * root.std else root


def _region(level: float, dof: float) -> float:
    """Radius, in standard deviations, of the ellipse that contains a two-dimensional value with this probability."""
    if not np.isfinite(dof):
        return float(np.sqrt(-2.0 * np.log1p(-level)))
    return float(np.sqrt(2.0 * fdtri(2.0, dof, level)))


def is_cancelled(info: Information, block: TransferFunction, z: complex, level: float = 0.95) -> bool:
    """Whether the residue of the filter at its pole z may be zero.

    The record shows a pole only through its residue. Where this may be zero, any value of the pole fits, and an
    interval of finite length would hold the true one with no probability that can be stated (Fieller 1954, J. R. Stat.
    Soc. B 16; Gleser and Hwang 1987, Annals of Statistics 15). The residue is taken relative to the filter's impulse
    response, which makes it independent of the gauge. The pole is free where the residue is zero, so the quantile has
    twice as many degrees of freedom as the residue. Of an ARMAX block, the noise shows the pole too: its residue
    in C/A counts beside that in B/A, which is taken relative to B, since the response may grow.
    """
    rational = transfer(info.chain, info.theta, block)
    b, db = rational.B[block.nk : block.nk + block.nb], rational.B_gradient[block.nk : block.nk + block.nb]
    if largest := float(np.abs(b).max(initial=0.0)):  # the answer has no unit, and squares of a tiny gain are no number
        b, db = b / largest, db / largest
    F, dF = rational.F[: block.nf + 1], rational.F_gradient[: block.nf + 1]
    size, d_size = _norm(b, db) if isinstance(block, Innovations) else _response_norm(b, db, F, dF)
    slope = complex(np.polyval(np.polyder(F), z))
    if size == 0.0 or slope == 0.0 or abs(z) <= _DELAY_MODULUS:
        return False
    dz = -(z ** np.arange(len(F) - 1, -1, -1)) @ dF / slope
    d_slope = (np.arange(len(F) - 1, 0, -1) * z ** np.arange(len(F) - 2, -1, -1)) @ dF[:-1]
    d_slope = d_slope + np.polyval(np.polyder(F, 2), z) * dz
    value, parts = _residue(b / size, db / size - np.outer(b, d_size) / size**2, z, dz, slope, d_slope)
    if isinstance(block, Innovations):
        noise = _residue(*estimator(info.chain, info.theta, block), z, dz, slope, d_slope)
        value, parts = np.concatenate([value, noise[0]]), np.concatenate([parts, noise[1]])
    cov = info.covariance_of(parts)
    if info.note_of(parts) or np.trace(cov) <= 1e-24 * float(value @ value):
        return False
    scale = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    value, cov = value / scale, cov / np.outer(scale, scale)
    distance = float(value @ np.linalg.pinv(cov, rcond=1e-12, hermitian=True) @ value)
    m = 2.0 * len(value)
    return distance < (m * fdtri(m, info.dof, level) if np.isfinite(info.dof) else chdtri(m, 1.0 - level))


def _residue(
    b: np.ndarray, db: np.ndarray, z: complex, dz: np.ndarray, slope: complex, d_slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """B(z) / F'(z) as its real and, of a complex z, imaginary part, with gradients; B in powers of 1/z, F in z."""
    past = z ** -np.arange(len(b), dtype=float)
    top, d_top = past @ b, past @ db - (np.arange(len(b)) * past / z) @ b * dz
    residue = top / slope
    d = (d_top - residue * d_slope) / slope
    n = 1 if z.imag == 0.0 else 2
    return np.array([residue.real, residue.imag])[:n], np.array([d.real, d.imag])[:n]


def _norm(b: np.ndarray, db: np.ndarray) -> tuple[float, np.ndarray]:
    """Norm of b (n,) with its gradient (P,)."""
    size = float(np.linalg.norm(b))
    return size, b @ db / (size or 1.0)


def _response_norm(b: np.ndarray, db: np.ndarray, F: np.ndarray, dF: np.ndarray) -> tuple[float, np.ndarray]:
    """Norm of the first samples of the impulse response, with its gradient (P,)."""
    impulse = np.eye(1, _RESPONSE_SAMPLES)[0]
    h = lfilter(b, F, impulse)
    by_b, by_f = lfilter([1.0], F, impulse), -lfilter([1.0], F, h)
    size = float(np.linalg.norm(h))
    if size == 0.0 or not np.isfinite(size):
        return 0.0, np.zeros(db.shape[1])
    by_numerator = [float(h[k:] @ by_b[: _RESPONSE_SAMPLES - k]) for k in range(len(b))]
    by_denominator = [float(h[k:] @ by_f[: _RESPONSE_SAMPLES - k]) for k in range(len(F))]
    return size, (np.array(by_numerator) @ db + np.array(by_denominator) @ dF) / size
