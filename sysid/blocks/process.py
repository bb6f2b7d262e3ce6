"""Process: a linear plant in continuous time, by the numbers that engineers name."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
from numpy import cos, exp, sin, sqrt

from sysid.base.checks import checked
from sysid.base.dual import Dual
from sysid.base.errors import InputError
from sysid.block.block import Block, Law, Slot
from sysid.block.compiler.recursion import Recursion
from sysid.block.step import ago, floor
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer
from sysid.blocks.compliance import NEAR

_FASTEST, _SLOWEST = 0.01, 1e6  # samples: a faster lag shows no more than a delay, a slower one than an integrator
_LONGEST = 1000.0  # samples of delay
_LEAST, _MOST = 1e-3, 20.0  # damping ratio
_LAGS = ("first", "second", "third")  # states of the lags in their order, or of a pair
_ALIKE, _TOGETHER = 0.1, 0.1  # exponents so close that a series takes the place of a difference


def begin(s, x, p):
    s.first, s.second, s.third, s.total = p.x1, p.x2, p.x3, p.x4


def step(s, x, p, block):
    if s.samples == 0.0:
        s.before = p.u0 if block.history > 0 else 0.0 if block.rests else x
    else:
        if block.delayed:  # a sample sees the end of one input and the beginning of the next
            whole = int(floor(p.Td / block.Ts))
            late = p.Td - whole * block.Ts
            advance(s, p.K * (ago(x, whole + 2) if whole + 2 <= s.samples else s.before), late, p, block)
            advance(s, p.K * (ago(x, whole + 1) if whole + 1 <= s.samples else s.before), block.Ts - late, p, block)
        else:
            advance(s, p.K * ago(x, 1), block.Ts, p, block)
    s.samples += 1.0
    return output(s, p, block)


def output(s, p, block):
    end = s.first
    if block.lags == 2:
        end = s.second
    elif block.lags == 3:
        end = s.third
    if block.integrator:
        return s.total + p.Tz * end
    if block.pair:
        return s.first + p.Tz * s.second
    if block.lags == 2:
        return end + p.Tz / p.T2 * (s.first - end)
    if block.lags == 3:
        return end + p.Tz / p.T3 * (s.second - end)
    return end


def advance(s, v, h, p, block):
    """The states after a time h of the constant drive v, exactly."""
    area = 0.0  # of the end of the lags, less v
    if block.pair:
        w, decay = p.wn * h, p.zeta * p.wn * h
        square = w * w - decay * decay
        if square > NEAR:
            turn = sqrt(square)
            c, d = exp(-decay) * cos(turn), exp(-decay) * sin(turn) / turn
        elif square < -NEAR:
            turn = sqrt(-square)
            slow, fast = exp(turn - decay), exp(-turn - decay)
            c, d = 0.5 * (slow + fast), 0.5 * (slow - fast) / turn
        else:
            c = exp(-decay) * (1.0 - square * (0.5 - square / 24.0))
            d = exp(-decay) * (1.0 - square * (1.0 / 6.0 - square / 120.0))
        e, rate = s.first - v, s.second
        s.first = v + e * c + (rate * h + decay * e) * d
        s.second = rate * c - (decay * rate + p.wn * w * e) * d
        if block.integrator:
            area = (rate - s.second + 2.0 * p.zeta * p.wn * (e + v - s.first)) / (p.wn * p.wn)
    if block.lags >= 1:
        a, e1 = -h / p.T1, s.first - v
        f1 = e1 * exp(a)
        s.first = v + f1
        if block.integrator:
            area = p.T1 * (e1 - f1)
        if block.lags >= 2:
            b, e2 = -h / p.T2, s.second - v
            f2 = e2 * exp(b) - b * e1 * between(a, b)
            s.second = v + f2
            if block.integrator:
                area += p.T2 * (e2 - f2)
            if block.lags >= 3:
                c, e3 = -h / p.T3, s.third - v
                f3 = e3 * exp(c) - c * e2 * between(b, c) + b * c * e1 * among(a, b, c)
                s.third = v + f3
                if block.integrator:
                    area += p.T3 * (e3 - f3)
    if block.integrator:
        s.total += v * h + area


def between(a, b):
    """(e^a - e^b) / (a - b), the divided difference of the exponential, at any a and b."""
    d = 0.5 * (a - b)
    if abs(d) > _ALIKE:
        return (exp(a) - exp(b)) / (a - b)
    q = d * d
    return exp(0.5 * (a + b)) * (1.0 + q / 6.0 * (1.0 + q / 20.0 * (1.0 + q / 42.0 * (1.0 + q / 72.0))))


def among(a, b, c):
    """The second divided difference of the exponential, at any a, b and c."""
    low, high = min(a, min(b, c)), max(a, max(b, c))
    if high - low > _TOGETHER:
        middle = a + b + c - low - high
        return (between(high, middle) - between(middle, low)) / (high - low)
    m = (a + b + c) / 3.0
    # The complete homogeneous polynomials of what is left of a, b and c, whose sum is zero.
    r, q, t = a - m, b - m, c - m
    two, three = -(r * q + q * t + t * r), r * q * t
    even = 0.5 + two / 24.0 + two * two / 720.0 + (two * two * two + three * three) / 40320.0
    return exp(m) * (even + three / 120.0 + 2.0 * two * three / 5040.0)


@checked(deferred=("Ts",))
@dataclass(frozen=True)
class Process(Recursion):
    """K (1 + Tz s) exp(-Td s) / ((1 + T1 s)(1 + T2 s)(1 + T3 s)), of an input that is held between its samples.

    `lags` time constants T1, T2, T3, or a `pair` in their place, s^2/wn^2 + 2 zeta s/wn + 1, real or complex; with a
    `zero` or an `integrator` 1/s. Times are in seconds, of which `Ts` is a sample; a fit takes that of its record.
    The solution is exact, also where the delay is no whole number of samples: a sample then sees the end of one input
    and the beginning of the next. x1 to x4 are the states in which a record begins, outputs of the lags and of the
    integrator (of a pair the output and its rate). The input before a record is its first one, as of a step from rest.
    Of a record that is cut out of a run, u0, u1, ... are the `history` inputs before it that a delay lets through, the
    latest first; the last of them also stands for all before it. The step of exported files knows u0 alone. The input
    before a run that `rests` is 0.
    """

    functions: ClassVar = {"step": step, "begin": begin}
    absent: ClassVar = dict.fromkeys(("T1", "T2", "T3", "wn", "zeta"), 1.0) | dict.fromkeys(
        ("Tz", "Td", "x1", "x2", "x3", "x4", "u0"), 0.0
    )

    lags: int = 1
    pair: bool = False
    zero: bool = False
    integrator: bool = False
    delayed: bool = True
    history: int = 0
    Ts: float = 1.0
    rests: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.lags <= 3 or (self.lags and self.pair):
            raise InputError(f"a process has {self.lags} lags and pair={self.pair}; give 0 to 3 lags, or a pair alone")
        if self.order < 1 + self.zero:
            raise InputError(
                "a process needs a time constant, a pair or an integrator, and two of them beside a zero: its output "
                "would jump with its input; add one"
            )
        if not 0 <= self.history <= _LONGEST + 3:
            raise InputError(
                f"history of a process is {self.history}; give 0 to {_LONGEST + 3:g} inputs before a record"
            )
        if not 0.0 < self.Ts < np.inf:
            raise InputError(f"Ts of a process is {self.Ts}; give a positive number of seconds")

    @property
    def order(self) -> int:
        """Number of poles."""
        return self.lags + 2 * self.pair + self.integrator

    def asked(self) -> Block | None:
        return replace(self, history=0)

    def recalling(self, theta: np.ndarray, every: bool) -> Block | None:
        """Of every one, one more than the delay holds, since a longer delay may fit better then."""
        held = int(self.by_name(theta).get("Td", 0.0) / self.Ts) + 3 if every else 1
        return replace(self, history=held) if self.delayed and held > self.history else None

    def resting(self) -> Block:
        return self if self.history or not self.delayed else replace(self, rests=True)

    def sampled(self, Ts: float) -> Block:
        return self if self.Ts == Ts else replace(self, Ts=Ts)

    def slots(self) -> tuple[Slot, ...]:
        Ts, size = self.Ts, "time constant"
        slots = [Slot("K", "Y/U/s" if self.integrator else "Y/U", words="gain")]
        slots += [Slot(f"T{k}", "s", _FASTEST * Ts, _SLOWEST * Ts, words=f"{size} T{k}") for k in self._in_order]
        if self.pair:
            slots.append(Slot("wn", "rad/s", 1.0 / (_SLOWEST * Ts), np.pi / Ts, words="natural frequency"))
            slots.append(Slot("zeta", "", _LEAST, _MOST, words="damping ratio"))
        slots += [Slot("Tz", "s", words=f"{size} of the zero")] if self.zero else []
        slots += [Slot("Td", "s", 0.0, _LONGEST * Ts, words="delay")] if self.delayed else []
        slots += [Slot(f"x{k}", initial=True) for k in self._in_order]
        slots += [Slot("x1", initial=True), Slot("x2", initial=True)] if self.pair else []
        slots += [Slot("x4", initial=True, holds=True)] if self.integrator else []
        return (*slots, *(Slot(name, initial=True) for name in self._past))

    @property
    def _past(self) -> list[str]:
        """Names of the inputs before a record."""
        return [f"u{k}" for k in range(self.history if self.delayed else 0)]

    @property
    def _in_order(self) -> range:
        """Numbers of the lags."""
        return range(1, self.lags + 1)

    def start(self, x: np.ndarray) -> np.ndarray:
        """A gain of 1 and the fastest that there is."""
        values = {"K": 1.0, "zeta": 1.0, "wn": np.pi / self.Ts, **dict.fromkeys(("T1", "T2", "T3"), self.Ts)}
        return np.array([values.get(slot.name, 0.0) for slot in self.slots()])

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        """By one recursion of the states, whose matrices come from `advance`: the step itself compiles for a minute."""
        from sysid.block.kernels import held_states

        if self.rests:  # a sample of 0 before the others, in which nothing moves
            wider = np.vstack([np.zeros_like(J[:1]), J])
            y = replace(self, rests=False).propagate(theta, np.append(0.0, x), wider, q)[1:]
            J[:] = wider[1:]
            return y
        m, y, own = self.by_name(theta), np.empty_like(x), self.n_parameters if J.shape[1] else 0
        at_states = [k for k, slot in enumerate(self.slots()) if slot.initial and slot.name not in self._past]
        past = theta[len(theta) - len(self._past) :] if self._past else np.empty(0)
        whole = int(np.clip(np.nan_to_num(m.get("Td", 0.0) / self.Ts), 0.0, len(x)))
        with np.errstate(all="ignore"):  # far from every plant; its cost is then infinite
            (F, *dF), (g, *dg), (c, *dc) = self._matrices({**self.absent, **m}, list(m)[:own], whole)
        S, n = np.zeros((len(F), q + own if own else 0)), len(F)
        if own:
            S[np.arange(n), [q + k for k in at_states]] = 1.0
        slopes = np.reshape(dF, (own, n, n)), np.reshape(dg, (own, n, 2)), np.reshape(dc, (own, n))
        before, dw = len(theta) - len(past), np.ascontiguousarray(J[:, :q])
        held_states(F, g, c, *slopes, whole, past, before, x, dw, theta[at_states], S, y, J, q)
        return y

    def _matrices(self, m: dict[str, float], names: list[str], whole: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F (1 + p, n, n), g (1 + p, n, 2), c (1 + p, n) of `held_states` at m, each before its slopes by p `names`."""
        n, states = self.order, [*(_LAGS[: self.lags + 2 * self.pair]), *["total"] * self.integrator]
        unit = {name: np.array([[name == each] for each in names], dtype=float).reshape(-1, 1) for name in m}
        p = SimpleNamespace(**{name: Dual(value, unit[name]) for name, value in m.items()})
        s = SimpleNamespace(**{name: Dual(0.0, 0.0) for name in (*_LAGS, "total")})
        vars(s).update({name: Dual(np.eye(1, n + 2, k)[0], 0.0) for k, name in enumerate(states)})
        late = p.Td - whole * self.Ts if self.delayed else 0.0
        if self.delayed:
            advance(s, p.K * Dual(np.eye(1, n + 2, n)[0], 0.0), late, p, self)
        advance(s, p.K * Dual(np.eye(1, n + 2, n + 1)[0], 0.0), self.Ts - late, p, self)
        moved = np.stack([_rows(getattr(s, name), len(names), n + 2) for name in states], axis=1)
        vars(s).update({name: Dual(np.eye(1, n, k)[0], 0.0) for k, name in enumerate(states)})
        c = _rows(output(s, p, self), len(names), n)
        return np.ascontiguousarray(moved[:, :, :n]), np.ascontiguousarray(moved[:, :, n:]), c

    def continuous(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Numerator and denominator in falling powers of s, and the delay [s]."""
        m, den = self.by_name(theta), np.ones(1)
        for k in self._in_order:
            den = np.convolve(den, [m[f"T{k}"], 1.0])
        if self.pair:
            den = np.convolve(den, [m["wn"] ** -2, 2.0 * m["zeta"] / m["wn"], 1.0])
        den = np.append(den, 0.0) if self.integrator else den
        return m["K"] * np.array([m["Tz"], 1.0] if self.zero else [1.0]), den, m.get("Td", 0.0)

    def rational(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """B (m,) and F (n + 1,) of the sampled block in powers of q^-1, and their gradients (m, p) and (n + 1, p)."""
        m, n = self.by_name(theta), self.order
        whole = int(m.get("Td", 0.0) / self.Ts)
        F, g, c = self._matrices({**self.absent, **m}, list(m), whole)

        def polynomials(F: np.ndarray, g: np.ndarray, c: np.ndarray) -> np.ndarray:
            f = np.real(np.poly(F))
            response = np.array([np.zeros(2), *(c @ np.linalg.matrix_power(F, k) @ g for k in range(n))])
            early, late = (np.convolve(f, column)[: n + 1] for column in response.T)
            b = np.append(late, 0.0) + np.append(0.0, early)
            return np.concatenate([np.zeros(whole), b if self.delayed else late, f])

        value, slopes = polynomials(F[0], g[0], c[0]), []
        for dF, dg, dc in zip(F[1:], g[1:], c[1:], strict=True):
            h = 1e-6 / max(np.abs(dF).max(), np.abs(dg).max(), np.abs(dc).max(), 1e-300)
            ends = [polynomials(F[0] + s * dF, g[0] + s * dg, c[0] + s * dc) for s in (h, -h)]
            slopes.append((ends[0] - ends[1]) / (2.0 * h))
        gradient, k = np.transpose(slopes), len(value) - n - 1
        return value[:k], value[k:], gradient[:k], gradient[k:]

    def admissible(self, theta: np.ndarray) -> bool:
        return all(s.lower <= value <= s.upper for s, value in zip(self.slots(), theta.tolist(), strict=True))

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        m = self.by_name(theta)
        factors = [f"(1 + {w.num(m[f'T{k}'])}*s)" for k in self._in_order] + ["s"] * self.integrator
        if self.pair:
            factors.append(f"(1 + {w.num(2.0 * m['zeta'] / m['wn'])}*s + {w.num(m['wn'] ** -2)}*s^2)")
        top = w.num(m["K"]) + (f"*(1 + {w.num(m['Tz'])}*s)" if self.zero else "")
        top += f"*exp(-{w.num(m['Td'])}*s)" if self.delayed else ""
        return [
            f"{w.y} = G(s) {w.x}, time in seconds",
            f"  G(s) = {top} / ({' * '.join(factors)})",
            f"  {w.x} is held over each sample of {w.num(self.Ts)} s; the motion is solved exactly",
        ]

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        sizes = {"K": b[0] / a[0], **dict.fromkeys(self._past, a[0]), **dict.fromkeys(("x1", "x2", "x3", "x4"), b[0])}
        return Law(self, np.diag([sizes.get(slot.name, 1.0) for slot in self.slots()]))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        names = [slot.name for slot in self.slots()]

        def marks(*chosen: str) -> np.ndarray:
            return np.array([float(name in chosen) for name in names])

        past, states = marks(*self._past), marks("x1", "x2", "x3", "x4")
        at_input, at_output = theta * (past - marks("K")), theta * (marks("K") + states)
        changes = [Symmetry(at_input, in_scale=1.0), Symmetry(at_output, out_scale=1.0)]
        if self.integrator:
            return [*changes, Symmetry(marks("x4"), out_shift=1.0)]
        levels = marks(*("x1", "x2", "x3")[: max(self.lags, self.pair)])
        return [*changes, Symmetry(past + theta[0] * levels, in_shift=1.0, out_shift=theta[0])]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Times and damping changed by a factor of up to about two, the delay by up to two samples too."""
        varied, names = theta.copy(), [slot.name for slot in self.slots()]
        for k, name in enumerate(names):
            if name in ("T1", "T2", "T3", "wn", "zeta", "Tz", "Td"):
                varied[k] *= np.exp(0.4 * rng.normal())
            varied[k] += 2.0 * self.Ts * rng.uniform() * (name == "Td")
        return np.clip(varied, *np.array([(s.lower, s.upper) for s in self.slots()]).T)


def _rows(x: Dual, p: int, m: int) -> np.ndarray:
    """The value (m,) of x and below it its slopes (p, m)."""
    return np.vstack([x.value, np.broadcast_to(x.slopes, (p, m))])
