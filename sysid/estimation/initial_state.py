"""The initial state of a free run, fitted to the first outputs of a record."""

import numpy as np

from sysid.block.block import StaticBlock
from sysid.blocks import ProfiledMotor, Travel
from sysid.data.record import IOData
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.likely_state import likely_initial
from sysid.estimation.problem import ChainProblem, search_best
from sysid.estimation.state_priors import state_space_of
from sysid.model.chain import Chain
from sysid.solver.iterate import Options

_SEARCH = Options(max_iterations=50, grain=0.0)
_POOR = 0.25  # of the output's variance, left by a state from which a map behind the linear block may be flat
_PACE = 4  # samples whose slope is a speed
_FIRST = 20  # samples that give a motor's initial position


def estimate_initial(
    chain: Chain, theta: np.ndarray, data: IOData, u: np.ndarray | None = None, noise_variance: float | None = None
) -> np.ndarray:
    """theta (P,) with its initial states fitted to a record; all other parameters are kept.

    By least squares: the search starts from rest and from the steady state closest to y; the better result is returned.
    With the noise_variance of a fit [unit of y squared] the initial states of filters, or of a state space, are the
    likely ones instead, see `initial_posterior`: a window of a few noisy outputs then leaves them near rest. u (N, nu)
    is the input of the whole record, of which `data` is the beginning.
    """
    if not chain.initial.any():
        return theta
    if noise_variance is not None and (filters_only(chain) or state_space_of(chain) is not None):
        theta_likely = likely_initial(chain, _at_rest(chain, theta), data, data.u if u is None else u, noise_variance)
        if theta_likely is not None:
            return theta_likely
    candidates = [_at_rest(chain, theta)]
    if is_joint(chain):
        candidates = [_on_map(chain, theta, data.y[:, 0])]
    elif chain.channels == (1, 1) and len(chain.dynamics) == 1:
        candidates.append(_steady(chain, theta, data.u[:, 0], data.y[:, 0]))
    problems = [ChainProblem.initial_state(chain, candidate, data) for candidate in candidates]
    best, cost = search_best(problems, _SEARCH, theta)
    if cost > _POOR * float(np.sum((data.y - data.y.mean(axis=0)) ** 2)) and _maps_behind(chain):
        candidate = _behind_maps(chain, best, data.u[:, 0], data.y[:, 0])
        best, _ = search_best([ChainProblem.initial_state(chain, candidate, data)], _SEARCH, best, cost)
    return best


def filters_only(chain: Chain) -> bool:
    """Whether all initial states of the chain are those of transfer functions."""
    of_filters = np.zeros(len(chain.names), dtype=bool)
    for part, _ in chain.dynamics:
        of_filters[part] = True
    return bool(np.all(of_filters[chain.initial]))


def _maps_behind(chain: Chain) -> bool:
    """Whether the chain is one transfer function of one channel with a map that can be flat behind it."""
    one = chain.channels == (1, 1) and len(chain.dynamics) == 1 and chain.dynamics[0][1] in chain.blocks
    return one and any(b.n_parameters for b in chain.blocks[chain.blocks.index(chain.linear) + 1 :])


def _behind_maps(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta with the initial state of the linear block whose response is nearest to y as seen through the maps.

    From another state a map may be flat, as a saturation beyond its limits: a search does not leave it.
    """
    linear, rest = chain.linear, _at_rest(chain, theta)
    k = chain.blocks.index(linear)
    w, part = chain.through(rest, u, 0, k), rest[chain.index(linear)]
    J = np.empty((len(w), linear.n_parameters))
    x = linear.propagate(part, w, J, 0)
    states = J[:, linear.nb + linear.nf :]
    reach = float(np.ptp(x)) + float(np.ptp(y)) + float(np.abs(y).max())
    levels = np.linspace(x.min() - reach, x.max() + reach, 4001)
    curve = chain.through(theta, levels, k + 1)
    rising = np.diff(curve) if curve[-1] > curve[0] else -np.diff(curve)
    if not states.shape[1] or not np.all(rising >= 0.0) or not np.all(np.isfinite(states)):
        return rest
    steep = np.concatenate([[True], rising > 0.0])  # of a flat part, its beginning
    order = 1 if curve[-1] > curve[0] else -1
    target = np.interp(y, curve[steep][::order], levels[steep][::order])
    part[linear.nb + linear.nf :] = np.linalg.lstsq(states, target - x, rcond=1e-10)[0]
    rest[chain.index(linear)] = part
    return rest


def with_initial_states(chain: Chain, theta: np.ndarray, data: IOData) -> np.ndarray:
    """theta (K, P) for K experiments: the same model, with the initial state of each fitted if there are several.

    Initial states that are all held are not changed: they are known and the same for every experiment. The initial
    position of a motor comes from its first samples. A motor integrates, so a state fitted to a whole record would
    compensate errors of the starting point, and a search seldom corrects this.
    """
    if len(data.lengths) == 1 or not (chain.initial & chain.free).any():
        return np.tile(theta, (len(data.lengths), 1))
    if is_joint(chain):
        return np.array([_on_map(chain, theta, e.y[:, 0]) for e in data.experiments])
    moves = any(isinstance(b, ProfiledMotor) for b in chain.blocks)
    firsts = [e.select(0, min(e.N, _FIRST)) if moves else e for e in data.experiments]
    return np.array([estimate_initial(chain, theta, e) for e in firsts])


def _at_rest(chain: Chain, theta: np.ndarray) -> np.ndarray:
    return np.where(chain.initial, 0.0, theta)


def _steady(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Initial states of a linear block whose output was constant at the level that gives y's first value."""
    linear = chain.linear
    k = chain.blocks.index(linear)
    rest = _at_rest(chain, theta)
    x = chain.through(rest, u, 0, k + 1)
    spans = [float(np.ptp(x)) + abs(float(np.mean(x)))]
    last = chain.blocks[-1]
    places = [s.knot for s in last.slots()]
    if any(places):
        spans.append(float(np.max(np.abs(chain.part(theta, last)[places]))))
    levels = np.linspace(-2.0, 2.0, 401) * max(spans)
    curve = chain.through(theta, levels, k + 1)
    level = float(levels[np.argmin(np.abs(curve - float(np.mean(y[:3]))))])
    # Without input, x_t stays at `level` if c_t = level * (1 + f1 + ... + ft).
    _, F = linear.padded(chain.part(theta, linear))
    part = rest[chain.index(linear)]
    part[linear.states] = level * np.cumsum(F)[:-1]
    rest[chain.index(linear)] = part
    return rest


def _on_map(chain: Chain, theta: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The motor at the position that gives y's first values; at their speed where its initial speed is free.

    From rest no derivative leads to a motion: friction holds it.
    """
    motor = motor_of(chain)
    rest, k = _at_rest(chain, theta), chain.blocks.index(motor)
    levels = np.linspace(*_way(chain, theta, y), 401)
    curve = levels
    for b in chain.blocks[k + 1 :]:
        if isinstance(b, StaticBlock):
            curve = b.output(chain.part(theta, b), curve)
    nearest = int(np.argmin(np.abs(curve - float(np.mean(y[:3])))))
    places = {slot.name: chain.index(motor).start + i for i, slot in enumerate(motor.slots())}
    rest[places["x0"]] = levels[nearest]
    if chain.free[places["v0"]] and len(y) >= _PACE and levels[0] != levels[-1]:  # else y stands still
        slope = np.gradient(curve, levels)[nearest]
        if slope != 0.0:
            rest[places["v0"]] = np.polyfit(np.arange(_PACE), y[:_PACE], 1)[0] / slope
    return rest


def _way(chain: Chain, theta: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Positions of the motor where it may be: between its stops, or, without one, where the record has been.

    With a curved travel map positions are in strokes, and a record leaves the stroke by less than its length.
    """
    motor, travel = motor_of(chain), next((b for b in chain.blocks if isinstance(b, Travel)), None)
    part, mapped = chain.part(theta, motor), travel is not None and not travel.is_line
    low, high = (-1.0, 2.0) if mapped else (float(y.min()), float(y.max()))
    if travel is not None and not mapped:
        first, last = chain.part(theta, travel)
        low, high = sorted(((low - first) / (last - first), (high - first) / (last - first)))
    if not motor.stops:
        return low, high
    lower, upper = (motor.value(part, name) for name in ("lower", "upper"))
    if mapped or not np.isfinite(lower + upper):
        return max(lower, low), min(upper, high)
    return lower, upper
