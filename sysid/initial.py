"""Where a search starts: a linear model by refined instrumental variables, maps laid around it, and variations."""

import numpy as np

from sysid.block import StaticBlock
from sysid.blocks import TransferFunction
from sysid.chain import Chain
from sysid.data import IOData
from sysid.errors import InputError
from sysid.iterate import Options, iterate
from sysid.problem import ChainProblem
from sysid.searches import LevenbergMarquardt

_COARSE = 12  # steps with coarse maps


def starts(chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
    """`count` starting points theta (P,): linear models first, then variations of their poles and maps.

    Of several experiments the longest gives the start. Chains of several channels or of two transfer functions start in
    `sysid.initial_multi`. Maps of many knots begin with few: the best of these is a better place to start from.
    """
    record = max(data.experiments, key=lambda e: e.N)
    # One generator a start, so that start k is the same however many are asked for.
    draws = [np.random.default_rng([seed, k]) for k in range(1, count)]
    if chain.channels != (1, 1) or len(chain.dynamics) != 1:
        from sysid.initial_multi import multi_starts

        return [_with_fixed(chain, theta) for theta in multi_starts(chain, record, draws)]
    u, y = record.u[:, 0], record.y[:, 0]
    coarse = chain.coarser()
    simple = coarse or chain
    found = linear_starts(simple, u, y)[: 1 + count // 2]
    found += [_variation(simple, found[k % len(found)], u, y, rng) for k, rng in enumerate(draws[len(found) - 1 :])]
    if coarse is not None:
        found = [chain.refine(coarse, _few_steps(coarse, theta, u, y)) for theta in found]
    return [_with_fixed(chain, theta) for theta in found]


def _few_steps(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (P,) after a few Levenberg-Marquardt steps."""
    problem = ChainProblem.whole(chain, theta, u, y)
    out = iterate(problem, problem.start, LevenbergMarquardt(), Options(max_iterations=_COARSE, tolerance=0.1))
    return problem.thetas(out.p)[0] if np.isfinite(out.cost) else theta


def with_initial_states(chain: Chain, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (K, P) for K experiments: the same model, the initial state of each fitted where there are several."""
    if len(data.lengths) == 1:
        return theta[None, :].copy()
    return np.array([estimate_initial(chain, theta, e) for e in data.experiments])


def linear_starts(chain: Chain, u: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """theta (P,) of linear models of u (N,) to y (N,), the best first, with every map as near the identity as may be.

    The best output-error model leads. Where the plant bends, its poles may serve the bend rather than the dynamics, so
    the refined-IV models that it started from follow: they see the plant's best linear approximation.
    """
    linear = chain.linear
    theta = np.zeros(len(chain.names))
    before = chain.blocks[: chain.blocks.index(linear)]
    w = lay_maps(chain, theta, before, u, u - u.mean())
    level, aim = w - w.mean(), y - y.mean()
    raw = _denominators(linear, level, aim)
    parts = [_polished(linear, raw, level, aim)]
    for f in raw:
        part = np.zeros(linear.n_parameters)
        part[linear.nb : linear.nb + linear.nf] = f
        solve_linear(linear, part, level, aim)
        if not any(_same_poles(linear, part, other) for other in parts):
            parts.append(part)
    found = []
    for part in parts:
        full = theta.copy()
        full[chain.index(linear)] = part
        _finish(chain, full, w, y)
        found.append(full)
    return found


def output_error_start(linear: TransferFunction, w: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Parameters of a linear block (p,) for w, y (N,): the best of several linear starts after output error each."""
    return _polished(linear, _denominators(linear, w, y), w, y)


def _polished(linear: TransferFunction, raw: list[np.ndarray], w: np.ndarray, y: np.ndarray) -> np.ndarray:
    options, best, best_cost = Options(max_iterations=30, tolerance=0.1), np.zeros(linear.n_parameters), np.inf
    for f in raw:
        theta = np.zeros(linear.n_parameters)
        theta[linear.nb : linear.nb + linear.nf] = f
        solve_linear(linear, theta, w, y)
        problem = ChainProblem.whole(Chain((linear,)), theta, w, y)
        out = iterate(problem, problem.start, LevenbergMarquardt(), options)
        if out.cost < best_cost:
            best, best_cost = problem.thetas(out.p)[0], out.cost
    return best


def _same_poles(linear: TransferFunction, a: np.ndarray, b: np.ndarray) -> bool:
    """True where two linear blocks' poles differ by less than a tenth of their distance from the unit circle."""
    p, q = np.sort_complex(linear.poles(a)), np.sort_complex(linear.poles(b))
    return bool(np.all(np.abs(p - q) < 0.1 * np.maximum(1.0 - np.abs(p), 1e-6)))


def refined_iv(nb: int, nf: int, nk: int, w: np.ndarray, y: np.ndarray, iterations: int = 20) -> np.ndarray:
    """f (nf,) of y = B/F w by refined instrumental variables (Young 2011, Recursive Estimation, chapter 7).

    Regressors are filtered by the last 1/F, instruments are the last model's own noise-free output; poles outside the
    unit circle are mirrored inside before each pass. The pass that fits best in free run is returned.
    """
    from sysid.kernels import all_pole

    linear = TransferFunction(nb, nf, nk, initial_state=False)
    f, x, best, best_cost = np.zeros(nf), y, np.zeros(nf), np.inf
    for _ in range(iterations):
        wf, yf, xf = np.empty_like(w), np.empty_like(w), np.empty_like(w)
        for signal, filtered in ((w, wf), (y, yf), (x, xf)):
            all_pole(f, signal, filtered)
        inputs = [_delay(wf, nk + i) for i in range(nb)]
        regressors = np.column_stack([-_delay(yf, j + 1) for j in range(nf)] + inputs)
        instruments = np.column_stack([-_delay(xf, j + 1) for j in range(nf)] + inputs)
        # lstsq, since a poor excitation leaves directions empty.
        theta = np.linalg.lstsq(instruments.T @ regressors, instruments.T @ yf, rcond=1e-12)[0]
        f = _mirrored(theta[:nf])
        with np.errstate(over="ignore", invalid="ignore"):
            x = linear.propagate(np.concatenate([theta[nf:], f]), w, np.empty((len(w), 0)), 0)
            cost = float(np.sum((y - x) ** 2))
        if not np.isfinite(cost):
            break
        if cost < best_cost:
            converged = best_cost - cost < 1e-6 * cost
            best, best_cost = f, cost
            if converged:
                break
    return best


def _denominators(linear: TransferFunction, w: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """Candidates for f (nf,) by refined IV, from the record and from thinned ones.

    A record sampled much faster than its dynamics hides them (all poles crowd at 1); poles of a thinned record are
    brought back to the full rate.
    """
    found = [refined_iv(linear.nb, linear.nf, linear.nk, w, y)]
    for thin in (4, 16, 64, 256):
        n = len(w) // thin
        if linear.nf == 0 or n < 20 * (linear.nb + linear.nf):
            break
        means = w[: n * thin].reshape(n, thin).mean(axis=1)
        slow = refined_iv(linear.nf, linear.nf, 1, means, y[: n * thin : thin])
        poles = np.roots(np.concatenate([[1.0], slow])).astype(complex)
        # A pole on the negative real axis is the alias of none; it becomes a fast one.
        poles = np.where((poles.real <= 0) & (np.abs(poles.imag) < 1e-12), 1e-3, poles)
        found.append(np.real(np.poly(poles ** (1.0 / thin)))[1:])
    return found


def solve_linear(linear: TransferFunction, theta: np.ndarray, w: np.ndarray, y: np.ndarray) -> None:
    """Fill B and the initial state in theta (p,) by least squares for the F that stands there."""
    J = np.empty((len(w), linear.n_parameters))
    linear.propagate(theta, w, J, 0)
    enters = np.r_[0 : linear.nb, linear.nb + linear.nf : linear.n_parameters]  # these enter linearly
    if np.all(np.isfinite(J[:, enters])):
        theta[enters] = np.linalg.lstsq(J[:, enters], y, rcond=1e-12)[0]


def estimate_initial(chain: Chain, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (P,) with its initial states fitted to a record, everything else kept.

    The search starts from rest and from the steady state that comes nearest to y; the better end counts.
    """
    if not chain.initial.any():
        return theta
    candidates = [_at_rest(chain, theta)]
    if chain.channels == (1, 1) and len(chain.dynamics) == 1:
        candidates.append(_steady(chain, theta, data.u[:, 0], data.y[:, 0]))
    best, best_cost = theta, np.inf
    for candidate in candidates:
        problem = ChainProblem.initial_state(chain, candidate, data)
        out = iterate(problem, problem.start, LevenbergMarquardt(), Options(max_iterations=50))
        if out.cost < best_cost:
            best, best_cost = problem.thetas(out.p)[0], out.cost
    return best


def _at_rest(chain: Chain, theta: np.ndarray) -> np.ndarray:
    return np.where(chain.initial, 0.0, theta)


def _steady(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Initial states as if the linear block's output had stood at the level where the chain shows y's first value."""
    linear = chain.linear
    k = chain.blocks.index(linear)
    rest = _at_rest(chain, theta)
    x = chain.simulate(rest, u) if k == len(chain.blocks) - 1 else _tail_input(chain, rest, u)
    span = np.ptp(x) + abs(float(np.mean(x))) + 1e-12
    spans = [span]
    last = chain.blocks[-1]
    if isinstance(last, StaticBlock) and any(s.name.startswith("x") for s in last.slots()):
        knots = chain.part(theta, last)[: last.n_parameters // 2]
        spans.append(float(np.max(np.abs(knots))))
    levels = np.linspace(-2.0, 2.0, 401) * max(spans)
    shown = levels
    for b in chain.blocks[k + 1 :]:
        shown = b.propagate(chain.part(theta, b), shown, np.empty((len(shown), 0)), 0)
    level = float(levels[np.argmin(np.abs(shown - float(np.mean(y[:3]))))])
    # x_t stays at `level` without input if c_t = level * (1 + f1 + ... + ft).
    _, F = linear.padded(chain.part(theta, linear))
    part = rest[chain.index(linear)]
    part[linear.nb + linear.nf :] = level * np.cumsum(F)[:-1]
    rest[chain.index(linear)] = part
    return rest


def _tail_input(chain: Chain, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    k = chain.blocks.index(chain.linear)
    return Chain(chain.blocks[: k + 1]).simulate(theta[: chain.index(chain.linear).stop], u)


def lay_maps(chain: Chain, theta: np.ndarray, blocks: tuple, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Lay static maps from x towards target, write them into theta and return their output."""
    for b in blocks:
        if not isinstance(b, StaticBlock):
            raise InputError(f"block {b.role!r} has no automatic start in this place; give fit() a start")
        part = _shifted(b, b.start(x), x, target)
        theta[chain.index(b)] = part
        x = b.propagate(part, x, np.empty((len(x), 0)), 0)
    return x


def _shifted(block: StaticBlock, theta: np.ndarray, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """theta moved along the block's own output shift, if it has one, so that its mean meets the target's."""
    for s in block.symmetries(theta):
        if s.out_shift == 1.0 and s.in_shift == 0.0:
            y = block.propagate(theta, x, np.empty((len(x), 0)), 0)
            return theta + s.d_theta * float(np.mean(target - y))
    return theta


def _finish(chain: Chain, theta: np.ndarray, w: np.ndarray, y: np.ndarray) -> None:
    """Fit the linear block's initial state and an offset (both enter linearly), then lay the maps behind it."""
    linear = chain.linear
    part = chain.part(theta, linear).copy()
    n = linear.n_state if linear.initial_state else 0
    part[linear.nb + linear.nf :] = 0.0
    J = np.empty((len(w), linear.n_parameters))
    x = linear.propagate(part, w, J, 0)
    impulses = J[:, linear.nb + linear.nf :]
    after = chain.blocks[chain.blocks.index(linear) + 1 :]
    can_shift = any(b.n_parameters for b in after)
    columns = np.column_stack([impulses, np.ones(len(w))]) if can_shift else impulses
    offset = 0.0
    if columns.shape[1] and np.all(np.isfinite(columns)) and np.all(np.isfinite(x)):
        solution = np.linalg.lstsq(columns, y - x, rcond=1e-10)[0]
        part[linear.nb + linear.nf :] = solution[:n]
        offset = float(solution[n]) if can_shift else 0.0
    theta[chain.index(linear)] = part
    x = linear.propagate(part, w, np.empty((len(w), 0)), 0)
    lay_maps(chain, theta, after, x, x + offset)


def _variation(chain: Chain, first: np.ndarray, u: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Maps before the linear block varied, other poles, B by least squares, and the rest laid around them again."""
    linear = chain.linear
    k = chain.blocks.index(linear)
    theta, w = first.copy(), u
    for b in chain.blocks[:k]:
        part = b.vary(chain.part(theta, b), rng)
        theta[chain.index(b)] = part
        w = b.propagate(part, w, np.empty((len(w), 0)), 0)
    part = chain.part(theta, linear).copy()
    if linear.nf:
        part = linear.vary(part, rng)
    J = np.empty((len(w), linear.n_parameters))
    linear.propagate(part, w, J, 0)
    columns = np.column_stack([J[:, : linear.nb], np.ones(len(w))])
    part[: linear.nb] = np.linalg.lstsq(columns, y, rcond=1e-10)[0][: linear.nb]
    theta[chain.index(linear)] = part
    _finish(chain, theta, w, y)
    for b in chain.blocks[k + 1 :]:
        theta[chain.index(b)] = b.vary(chain.part(theta, b), rng)
    return theta


def _with_fixed(chain: Chain, theta: np.ndarray) -> np.ndarray:
    theta = theta.copy()
    for i, (name, slot) in enumerate(zip(chain.names, chain.slots, strict=True)):
        theta[i] = chain.fixed.get(name, float(np.clip(theta[i], slot.lower, slot.upper)))
    return theta


def _delay(x: np.ndarray, k: int) -> np.ndarray:
    return np.concatenate([np.zeros(k), x[: len(x) - k]])


def _mirrored(f: np.ndarray) -> np.ndarray:
    """f (n,) with the roots outside the unit circle mirrored inside."""
    if not len(f) or not np.all(np.isfinite(f)):
        return np.zeros(len(f))
    poles = np.roots(np.concatenate([[1.0], f])).astype(complex)
    outside = np.abs(poles) > 1.0
    poles[outside] = 1.0 / np.conj(poles[outside])
    return np.real(np.poly(poles))[1:]
