"""Small sums of the advice and of the readers, against numbers worked out by hand or by another route."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.data.resampling import mean_of_held
from sysid.diagnosis.low_order import _lies_within
from sysid.diagnosis.whitening import _freedom
from sysid.diagnosis.worth import worth


def test_the_roots_of_a_polynomial_lie_within_a_circle_as_numpy_finds_them():
    rng, inside = np.random.default_rng(0), 0
    for _ in range(2000):
        angle, n = rng.uniform(0.0, 3.0), int(rng.integers(0, 3))
        pair = rng.uniform(0.3, 1.2) * np.exp([1j * angle, -1j * angle])
        roots, radius = np.concatenate([pair, rng.uniform(-1.2, 1.2, n)]), float(rng.uniform(0.6, 1.3))
        largest = float(np.abs(roots).max())
        if abs(largest - radius) < 1e-6:
            continue
        assert _lies_within(radius, np.real(np.poly(roots))[1:].tolist()) == (largest < radius)
        inside += largest < radius
    assert 400 < inside < 1600
    assert _lies_within(0.5, [])
    assert not _lies_within(1.0, [float("nan")])


def test_a_direction_over_all_rows_has_a_degree_of_freedom_for_each_and_one_in_few_rows_few():
    for rows in (1, 5, 200):
        U = np.zeros((200, 1))
        U[:rows] = 1.0 / np.sqrt(rows)
        assert _freedom(U) == pytest.approx(rows)
    two = np.linalg.qr(np.random.default_rng(0).standard_normal((4000, 2)))[0]
    two = two / np.linalg.norm(two, axis=1, keepdims=True) * np.sqrt(2.0 / 4000)  # each row alike
    assert _freedom(two) == pytest.approx(2.0 * 3.0 * 4000 / 8.0 - 1.0)


def test_the_mean_over_a_step_without_width_is_the_value_there():
    t, values = np.array([0.0, 1.0, 3.0]), np.array([2.0, 5.0, -1.0])
    found = mean_of_held(t, values, np.array([0.0, 1.0, 2.0, 0.5]), np.array([3.0, 1.0, 4.0, 0.5]))
    assert found == pytest.approx([(2.0 + 2 * 5.0) / 3.0, 5.0, (5.0 - 1.0) / 2.0, 2.0])


@pytest.mark.parametrize(
    ("percent", "independent", "told"), [(99.6, False, True), (99.4, False, False), (85.0, True, True)]
)
def test_what_is_left_counts_where_it_is_half_a_point(percent, independent, told):
    tests = SimpleNamespace(independent=independent, white=False)
    assert worth(percent, tests) == ("good" if told else "usable")
    assert worth(percent, None) == "good"
