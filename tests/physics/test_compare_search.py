"""A search over knobs where the error has valleys: the frequency of a wave."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.compare.effects import START, Knob
from twin.compare.search import Search, fit_all, restart

T = np.linspace(0.0, 10.0, 400)
TRUE = 5.0


class Wave:
    """In place of `Trials`: sin(turns t) + start, whose error over the turns has a side valley at 5.77."""

    knobs = {  # noqa: RUF012 - read alone
        START: Knob(START, "rad", 0.0, -1.0, 1.0, 0.01),
        "turns": Knob("turns", "rad/s", 1.0, 0.0, 20.0, 0.1, (4.77, 3.71)),
    }
    follower = SimpleNamespace(joint="")

    def rows(self, states):
        return np.stack([np.sin(state.get("turns", 1.0) * T) + state.get(START, 0.0) for state in states])


def test_a_search_begins_again_at_the_places_that_were_not_the_best():
    y = np.sin(TRUE * T) + 0.01 * np.random.default_rng(0).standard_normal(len(T))
    search = Search("wave", ("turns",))
    fit_all(Wave(), [search], y)
    assert abs(search.state["turns"] - TRUE) > 0.5  # the better of both places is on the slope of the side valley
    restart(Wave(), [search], y, 1e-4)
    assert search.state["turns"] == pytest.approx(TRUE, abs=0.01)
    assert search.cost < 1.2e-4
