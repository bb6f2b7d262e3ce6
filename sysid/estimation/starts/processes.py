"""Starts of a process: time constants and delays of a grid, the rest by least squares.

For given poles and a given delay the output is linear in the gain, in the gain times the zero, in the initial states
and in the offset (separable least squares; Golub and Pereyra 1973, SIAM J. Numer. Anal. 10). A whole number of samples
of delay moves a response, so that one response of each set of poles serves all delays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, zip_longest

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks import Process
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, delay, generators, longest
from sysid.model.chain import Chain

_MOST = 2000  # samples that are looked at; of a longer record the means of as many parts, and its first samples
_RATIOS = {1: 1.4, 2: 1.7, 3: 2.5}  # between neighbouring time constants, by how many there are
_DAMPED = {0.02: 1.05, 0.1: 1.15, 0.3: 1.3, 0.8: 1.5}  # damping ratios, and between frequencies: a peak is that narrow
_SHORTEST = 0.3  # samples of the shortest time constant
_APART = 1.3  # between time constants of two starts, or delays at that share of one
_EMPTY = 1e-10


@dataclass(frozen=True)
class _Place:
    """Poles by the names of their parameters, and a delay, both in seconds, and the squares that they leave.

    `steady` where the record begins at rest: the transient of free initial states may look like the answer to a step.
    """

    values: dict[str, float]
    Td: float
    left: float
    steady: bool


class Processes(Start):
    """A process, beside offsets alone: the best places of the grid that lie apart, then variations of the best.

    Places with free initial states and at rest take turns.
    """

    blocks = (Process,)

    def suits(self, chain: Chain) -> bool:
        return chain.channels == (1, 1)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record = longest(data)
        block = next(b for b in chain.blocks if isinstance(b, Process))
        u, y = np.ascontiguousarray(record.u[:, 0]), np.ascontiguousarray(record.y[:, 0])
        held = {name.rpartition(".")[2]: value for name, value in chain.fixed.items()}
        found: dict[bool, list[_Place]] = {False: [], True: []}
        for part_u, part_y, ratio in _parts(u, y, record.observed[:, 0]):
            for steady, places in found.items():
                places += _places(replace(block, Ts=block.Ts * ratio), part_u, part_y, held, steady)
        if not found[False]:
            raise InputError(
                "the input does not change, so that no time constant shows; record its changes, or give fit() a start"
            )
        best = [_apart(sorted(places, key=lambda place: place.left), count) for places in found.values()]
        places = [place for pair in zip_longest(*best) for place in pair if place is not None][:count]
        points = [_point(chain, block, place, u, y) for place in places]
        for rng in generators(count, seed)[len(points) - 1 :]:
            varied = points[0].copy()
            varied[chain.index(block)] = block.vary(chain.part(varied, block), rng)
            points.append(_with_rest(chain, varied, u, y))
        return points


def _parts(u: np.ndarray, y: np.ndarray, observed: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
    """Records of up to `_MOST` samples, and how many samples of u and y (N,) each of theirs stands for."""
    y = np.where(observed, y, np.interp(np.arange(len(y)), np.flatnonzero(observed), y[observed]))
    yield u[:_MOST], y[:_MOST], 1
    thin = -(-len(u) // _MOST)
    if thin > 1:
        n = len(u) // thin * thin
        yield u[:n].reshape(-1, thin).mean(axis=1), y[:n:thin], thin


def _places(block: Process, u: np.ndarray, y: np.ndarray, held: dict[str, float], steady: bool) -> list[_Place]:
    """The best delay of every set of poles, with the share of the variance of y (N,) that it leaves."""
    found = []
    spread = float(np.sum((y - y.mean()) ** 2)) or 1.0
    if not np.ptp(u):
        return []
    for values in _poles(block, len(y)):
        values = {name: held.get(name, value) for name, value in values.items()}
        response, rest = _responses(block, values, u, steady)
        Q = np.linalg.qr(rest)[0]
        target = y - Q @ (Q.T @ y)
        best = _Place(values, 0.0, np.inf, steady)
        for samples in _delays(block, len(y), held):
            moved = np.column_stack([delay(column, samples) for column in response.T])
            moved -= Q @ (Q.T @ moved)
            size = np.linalg.norm(moved, axis=0)
            moved = moved[:, size > _EMPTY * size.max()] / size[size > _EMPTY * size.max()]
            e = target - moved @ np.linalg.lstsq(moved, target, rcond=_EMPTY)[0]
            left = float(e @ e) / spread
            if left < best.left:
                best = _Place(values, held.get("Td", samples * block.Ts), left, steady)
        found.append(best)
    return found


def _poles(block: Process, N: int) -> Iterator[dict[str, float]]:
    """Sets of poles, from below a sample to half of a record of N samples."""
    if block.pair:
        for zeta, ratio in _DAMPED.items():
            for wn in np.geomspace(2.0 / N, 3.0, 1 + int(np.log(1.5 * N) / np.log(ratio))):
                yield {"wn": wn / block.Ts, "zeta": zeta}
        return
    ratio = _RATIOS.get(block.lags, 2.0)
    times = block.Ts * np.geomspace(0.5 * N, _SHORTEST, 1 + int(np.log(N / (2.0 * _SHORTEST)) / np.log(ratio)))
    for chosen in combinations_with_replacement(times.tolist(), block.lags):
        yield {f"T{k}": value for k, value in enumerate(chosen, 1)}


def _delays(block: Process, N: int, held: dict[str, float]) -> list[int]:
    """Whole delays [samples], every one at first and then every tenth part, to a quarter of the record."""
    if not block.delayed:
        return [0]
    if "Td" in held:
        return [min(round(held["Td"] / block.Ts), N - 1)]
    return np.unique(np.geomspace(1.0, max(min(N // 4, 1000), 2), 60).astype(int) - 1).tolist()


def _responses(block: Process, values: dict[str, float], u: np.ndarray, steady: bool) -> tuple[np.ndarray, np.ndarray]:
    """What a delay moves (N, 2 or 4): responses to u (N,) less its first value and to a step, then the parts of a zero.

    And what it does not (N, k): the decay of each initial state, and the offset. Of a `steady` beginning the response
    to u (N, 1 or 2) and the offset alone.
    """
    plain = replace(block, zero=False, delayed=False)
    names = [slot.name for slot in plain.slots()]
    theta = np.array([{"K": 1.0, **values}.get(name, 0.0) for name in names])
    J = np.empty((len(u), len(names)))
    moved = [plain.propagate(theta, x, J, 0) for x in (u - u[0], np.ones(len(u)))]
    if block.zero:
        with_zero = replace(block, delayed=False)
        theta_zero = np.array([{"K": 1.0, "Tz": 1.0, **values}.get(s.name, 0.0) for s in with_zero.slots()])
        moved += [with_zero.output(theta_zero, x) - y for x, y in zip((u - u[0], np.ones(len(u))), moved, strict=True)]
    states = J[:, [k for k, slot in enumerate(plain.slots()) if slot.initial]]
    offset = np.arange(len(u)) / len(u) if block.integrator else np.ones(len(u))
    if steady:
        return np.column_stack(moved[::2]), offset[:, None]
    return np.column_stack(moved), np.column_stack([states, offset])


def _apart(places: list[_Place], count: int) -> list[_Place]:
    """The first of the places, and those after it that differ in a time constant or in the delay, up to `count`."""
    chosen = [places[0]]
    for place in places[1:]:
        if len(chosen) == count:
            break
        if all(_differ(place, other) for other in chosen):
            chosen.append(place)
    return chosen


def _differ(a: _Place, b: _Place) -> bool:
    ratios = [max(a.values[name] / b.values[name], b.values[name] / a.values[name]) for name in a.values]
    slow = max((v for n, v in a.values.items() if n != "wn"), default=1.0)
    return max(ratios, default=1.0) > _APART or abs(a.Td - b.Td) > (_APART - 1.0) * slow


def _point(chain: Chain, block: Process, place: _Place, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta (P,) at a place, with the gain and all that is linear by least squares."""
    theta, at = np.zeros(len(chain.names)), chain.index(block)
    names = [slot.name for slot in block.slots()]
    theta[at] = [{"K": 1.0, "Td": place.Td, **place.values}.get(name, 0.0) for name in names]
    response, rest = _responses(block, place.values, u, place.steady)
    samples = round(place.Td / block.Ts)
    moved = np.column_stack([delay(column, min(samples, len(u) - 1)) for column in response.T])
    solution = np.linalg.lstsq(np.column_stack([moved, rest]), y, rcond=_EMPTY)[0]
    gain = float(solution[0])
    values = {"K": gain, "Tz": float(solution[1 if place.steady else 2]) / gain if block.zero and gain else 0.0}
    for name, value in values.items():
        if name in names:
            theta[at.start + names.index(name)] = value
    return _with_rest(chain, theta, u, y)


def _with_rest(chain: Chain, theta: np.ndarray, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """theta with initial states, the input before the record and the offset by least squares."""
    theta = np.where(chain.initial, 0.0, theta)
    linear = chain.initial | np.array([name == "offset.y0" for name in chain.names])
    y0, J = chain.tangent(theta, u)
    theta[linear] += np.linalg.lstsq(J[:, linear], y - y0, rcond=_EMPTY)[0]
    return theta
