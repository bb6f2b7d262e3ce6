"""Starts of a fit to a frequency response: a process on a grid, a transfer function by iterated least squares."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np

from sysid.base.poles import mirrored
from sysid.blocks import Process, TransferFunction
from sysid.data.frequency import FrequencyData
from sysid.model.chain import Chain
from sysid.model.frequency import linear_block, response

_RATIOS = {0: 2.0, 1: 1.4, 2: 1.7, 3: 2.5}  # between neighbouring time constants, by how many there are
_DAMPING = (0.02, 0.05, 0.15, 0.4, 1.0)
_MOST = 120  # frequencies that are looked at
_DELAYS = 150
_BEST, _APART = 8, 0.5  # starts, and the least distance between them in logarithms of their poles, or delays
_ITERATIONS = 30


def starts(chain: Chain, data: FrequencyData, std: np.ndarray) -> list[np.ndarray]:
    """theta (P,) of several starts, the best first, for errors of the deviation std (n,) at each frequency."""
    block = linear_block(chain)
    points = _of_grid(chain, block, data, std) if isinstance(block, Process) else _iterated(chain, block, data, std)
    return [np.clip(theta, *chain.limits) for theta in points]


def _of_grid(chain: Chain, block: Process, data: FrequencyData, std: np.ndarray) -> list[np.ndarray]:
    """The best poles of a grid, each with its best delay, gain and zero: these two enter linearly, K and K Tz."""
    thin = -(-len(data.w) // _MOST)
    w, target, weight = data.w[::thin], data.response[::thin], 1.0 / std[::thin]
    s = 1j * w
    plain, part = replace(block, zero=False, delayed=False), chain.index(block)
    names = [slot.name for slot in block.slots()]
    held = {name.rpartition(".")[2]: value for name, value in chain.fixed.items()}
    delays = _delays(data.w) if block.delayed else np.zeros(1)
    delays = np.array([held["Td"]]) if "Td" in held else delays
    turns = np.exp(-np.outer(delays, s))
    found = []
    for poles in _poles(block, data.w):
        values = {"K": 1.0, **poles, **{name: held[name] for name in poles if name in held}}
        theta = np.array([values.get(slot.name, 0.0) for slot in plain.slots()])
        unit = weight * response(Chain((plain,)), theta, w, None)[0]
        e, (k, kz) = _best_gain(turns * unit, turns * unit * s if block.zero else None, weight * target)
        best = int(np.argmin(e))
        values |= {"K": float(k[best]), "Td": float(delays[best]), "Tz": float(kz[best] / k[best]) if k[best] else 0.0}
        point = np.zeros(len(chain.names))
        point[part] = [values.get(name, 0.0) for name in names]
        found.append((float(e[best]), point))
    at = np.array([part.start + k for k, name in enumerate(names) if name in ("T1", "T2", "T3", "wn")], dtype=int)
    late = np.array([part.start + k for k, name in enumerate(names) if name == "Td"], dtype=int)
    chosen: list[np.ndarray] = []
    for _, point in sorted(found, key=lambda pair: pair[0]):
        gaps = (
            max(
                np.abs(np.log(point[at] / c[at])).max(initial=0.0),
                np.abs(point[late] - c[late]).max(initial=0.0) * data.w[-1],
            )
            for c in chosen
        )
        if all(gap > _APART for gap in gaps):
            chosen.append(point)
        if len(chosen) == _BEST:
            break
    return chosen


def _best_gain(
    moved: np.ndarray, zero: np.ndarray | None, target: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Squares left (D,), and the gain and the gain times the zero (D,), of D delays; moved and zero (D, n)."""
    a, p = np.sum(np.abs(moved) ** 2, axis=1), np.real(moved.conj() @ target)
    size = float(np.sum(np.abs(target) ** 2))
    if zero is None:
        return size - p * p / a, (p / a, np.zeros(len(a)))
    c, q, b = np.sum(np.abs(zero) ** 2, axis=1), np.real(zero.conj() @ target), np.real(np.sum(moved.conj() * zero, 1))
    det = np.maximum(a * c - b * b, 1e-12 * a * c)
    k, kz = (c * p - b * q) / det, (a * q - b * p) / det
    return size - k * p - kz * q, (k, kz)


def _poles(block: Process, w: np.ndarray) -> Iterator[dict[str, float]]:
    """Sets of poles, from a third of the highest frequency's time to three times that of the lowest."""
    fast, slow = 0.3 / w[-1], 3.0 / w[0]
    ratio = 1.15 if block.pair else _RATIOS[block.lags]
    times = np.geomspace(slow, fast, 1 + int(np.ceil(np.log(slow / fast) / np.log(ratio)))).tolist()
    if block.pair:
        yield from ({"wn": min(1.0 / T, w[-1]), "zeta": zeta} for T in times for zeta in _DAMPING)
        return
    for chosen in combinations_with_replacement(times, block.lags):
        yield {f"T{k}": T for k, T in enumerate(chosen, 1)}


def _delays(w: np.ndarray) -> np.ndarray:
    """Delays [s] that turn the highest frequency by a radian each, and further apart those of the lowest ones."""
    dense = np.arange(0.0, 0.5 * _DELAYS) / w[-1]
    return np.unique(np.append(dense, np.geomspace(1.0 / w[-1], 2.0 * np.pi / w[0], _DELAYS // 2)))


def _iterated(chain: Chain, block: TransferFunction, data: FrequencyData, std: np.ndarray) -> list[np.ndarray]:
    """B and F that make F G - B small, weighted by the last 1/F (Sanathanan and Koerner 1963, IEEE Trans. AC 8)."""
    assert data.Ts is not None
    powers = np.exp(-1j * data.Ts * np.outer(data.w, np.arange(block.n_state + 1)))
    of_b, of_f = powers[:, block.nk : block.nk + block.nb], powers[:, 1 : block.nf + 1]
    f, found, part = np.zeros(block.nf), [], chain.index(block)
    for _ in range(_ITERATIONS):
        weight = 1.0 / (std * np.abs(1.0 + of_f @ f))
        A = weight[:, None] * np.column_stack([of_b, -data.response[:, None] * of_f])
        target = weight * data.response
        both = np.concatenate([A.real, A.imag]), np.concatenate([target.real, target.imag])
        f = mirrored(np.linalg.lstsq(*both, rcond=1e-12)[0][block.nb :])
        A = of_b / (std * (1.0 + of_f @ f))[:, None]
        target = data.response / std
        both = np.concatenate([A.real, A.imag]), np.concatenate([target.real, target.imag])
        b = np.linalg.lstsq(*both, rcond=1e-12)[0]
        theta = np.zeros(len(chain.names))
        theta[part.start : part.start + block.nb + block.nf] = np.concatenate([b, f])
        found.append((float(np.sum((both[1] - both[0] @ b) ** 2)), theta))
    return [theta for _, theta in sorted(found, key=lambda each: each[0])[:_BEST]]
