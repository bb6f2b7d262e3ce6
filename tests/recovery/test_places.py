"""Break points chosen among places: the best choices, found again by trying all."""

from itertools import combinations

import numpy as np
import pytest

from sysid.estimation.starts.portfolio import curves
from sysid.estimation.starts.portfolio.exchange import Polygons


def loss(M, y, places, chosen):
    """|y - M v|^2 of the best polygon v through places[chosen]."""
    hat = np.eye(len(chosen))
    W = np.column_stack([np.interp(places, places[chosen], row) for row in hat])
    v = np.linalg.lstsq(M @ W, y, rcond=None)[0]
    return float(np.sum((y - M @ W @ v) ** 2))


@pytest.fixture(params=range(4))
def case(request):
    rng = np.random.default_rng(request.param)
    k = 9 + request.param
    places = np.sort(rng.uniform(0, 1, k))
    M = rng.normal(size=(80, k))
    return places, M, M @ np.sin(8 * places) + 0.3 * rng.normal(size=80)


def test_no_place_can_be_exchanged_for_a_better_one(case):
    places, M, y = case
    k, m = len(places), 5
    first = np.linspace(0, k - 1, m).astype(np.int64)
    found, cost = Polygons(M.T @ M, M.T @ y, places, 1e-12).exchanged(first, 50, 0.0)
    assert cost + y @ y == pytest.approx(loss(M, y, places, found), rel=1e-8)
    assert loss(M, y, places, found) < loss(M, y, places, first)
    for turn in range(1, m - 1):
        for i in set(range(1, k - 1)) - set(found.tolist()):
            other = np.sort(np.append(np.delete(found, turn), i))
            assert loss(M, y, places, other) >= loss(M, y, places, found) * (1 - 1e-9)


def test_a_polygon_is_that_of_least_squares(case):
    places, M, y = case
    chosen = np.array([0, 3, 5, len(places) - 1])
    assert Polygons(M.T @ M, M.T @ y, places, 0.0).best(chosen)[1] + y @ y == pytest.approx(loss(M, y, places, chosen))


def test_fewer_places_are_the_best_of_all_choices(case):
    places, _, y = case
    k, values, mass = len(places), y[: len(places)], np.abs(y[-len(places) :])

    def away(chosen):
        return np.sum(mass * (values - np.interp(places, places[chosen], values[chosen])) ** 2)

    best = min(([0, *inner, k - 1] for inner in combinations(range(1, k - 1), 3)), key=away)
    np.testing.assert_array_equal(curves.thin_places(places, values, mass, 5), places[best])
