"""Searches on problems whose derivatives, or their squares, are too large for numbers."""

import numpy as np
import pytest

import sysid
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import TABLE, search


class Line:
    """y = k p with k so large that k times k is no number."""

    size = 2.0

    def __init__(self, steepness: float) -> None:
        self.k = np.full(2, steepness)

    def residual(self, p: np.ndarray) -> np.ndarray:
        return 1.0 - self.k * p[0]

    def repair(self, p: np.ndarray) -> np.ndarray:
        return p

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        return np.zeros(len(p), dtype=bool)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.residual(p), self.k[:, None]


@pytest.mark.parametrize("name", sorted(TABLE))
@pytest.mark.parametrize("steepness", [1e200, 1e308])
def test_a_derivative_without_a_square_ends_a_search_with_its_reason(name, steepness):
    """Warnings are errors here."""
    ended = iterate(Line(steepness), np.zeros(1), search(name), Options())
    assert not ended.stop.converged
    assert "the derivatives of the model are too large for numbers" in ended.stop.reason
    assert ended.p[0] == 0.0


@pytest.mark.parametrize("name", sorted(TABLE))
def test_a_steep_line_is_still_found(name):
    ended = iterate(Line(1e100), np.zeros(1), search(name), Options(max_iterations=1000))
    assert ended.cost <= 1e-8
    assert ended.p[0] == pytest.approx(1e-100, rel=1e-3)


def test_a_servo_in_huge_units_is_fitted_without_a_warning():
    rng = np.random.default_rng(3)
    u, y = np.repeat(rng.normal(size=60), 10), np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.97 * y[t - 1] + 0.03 * np.tanh(2.0 * u[t - 1])
    data = sysid.IOData(u, 1e9 * y, 0.01)
    fit = sysid.fit(sysid.structures.servo_joint(), data, starts=1, options=Options(max_seconds=5.0))
    assert np.all(np.isfinite(fit.theta))
