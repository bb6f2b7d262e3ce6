"""Starts of two filters in series, with maps between them."""

import itertools

import numpy as np

from sysid.base.poles import monic
from sysid.blocks import TransferFunction, TransferMatrix
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, generators, longest, output_error_start, solve_linear, start_maps
from sysid.model.chain import Chain


class TwoFilters(Start):
    """Wiener-Hammerstein, with or without a map before it: one linear model of the total order, its poles divided
    between both filters in every way.

    The starts differ in the division of the poles (Sjoberg and Schoukens 2012, Automatica 48); then the maps are
    varied.
    """

    blocks = (TransferFunction, TransferMatrix)

    def suits(self, chain: Chain) -> bool:
        return chain.channels == (1, 1) and len(chain.dynamics) == 2

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record, draws = longest(data), generators(count, seed)
        u, y = record.u[:, 0], record.y[:, 0]
        (_, first), (_, second) = chain.dynamics
        series = TransferFunction(first.nb + second.nb - 1, first.nf + second.nf, first.nk + second.nk)
        poles = series.poles(output_error_start(series, u - u.mean(), y - y.mean()))
        deals = _deals(poles, first.nf)
        points = []
        for k in range(len(draws) + 1):
            first_numbers = deals[k % len(deals)]
            rng = draws[k - 1] if k >= len(deals) else None
            points.append(_start_of_division(chain, poles, first_numbers, u, y, rng))
        return points


def _deals(poles: np.ndarray, n: int) -> list[tuple[int, ...]]:
    """Ways to choose n of the poles with complex pairs kept together; any n poles if there is no such way."""
    real_subsets = []
    for subset in itertools.combinations(range(len(poles)), n):
        chosen_poles = poles[list(subset)]
        if np.abs(np.imag(np.poly(chosen_poles))).max() < 1e-9:
            real_subsets.append(subset)
    return real_subsets or [tuple(range(n))]


def _start_of_division(
    chain: Chain,
    poles: np.ndarray,
    first_numbers: tuple[int, ...],
    u: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator | None,
) -> np.ndarray:
    """theta (P,) with these poles in the first filter and the others in the second; maps varied with `rng`."""
    (at_first, first), (at_second, second) = chain.dynamics
    theta = np.zeros(len(chain.names))
    maps_before = chain.blocks[: chain.blocks.index(first)]
    u = start_maps(chain, theta, maps_before, u, u - u.mean())
    second_numbers = [i for i in range(len(poles)) if i not in first_numbers]
    part = np.zeros(first.n_parameters)
    F = np.concatenate([[1.0], monic(poles[list(first_numbers)])])
    part[first.nb : first.nb + first.nf] = F[1:]
    part[0] = F.sum() if abs(F.sum()) > 1e-9 else 1.0  # gain 1, so that the map between sees the scale of u
    theta[at_first] = part
    x = first.output(part, u)
    maps_between = chain.blocks[chain.blocks.index(first) + 1 : chain.blocks.index(second)]
    x = start_maps(chain, theta, maps_between, x, x - x.mean())
    if rng is not None:
        for b in (*maps_before, *maps_between):
            theta[chain.index(b)] = b.vary(theta[chain.index(b)], rng)
    theta[at_second] = solve_linear(second, monic(poles[second_numbers]), x, y)
    return theta
