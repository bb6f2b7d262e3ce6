"""Automatic starts: which one a chain gets, and what every starting point keeps to."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, LimitedIntegrator, Motor, Play, ProfiledMotor, TransferFunction, dynamic
from sysid.data.record import IOData
from sysid.estimation import search
from sysid.estimation.fit import without_agreement
from sysid.estimation.objective import Objective
from sysid.estimation.search import SearchContext, SearchResult
from sysid.estimation.starts import TABLE, starts
from sysid.estimation.starts.portfolio.candidates import _distinct_optima
from sysid.estimation.starts.portfolio.surrogate import Surrogate
from sysid.model.chain import Chain
from sysid.solver.iterate import Options
from sysid.structures import (
    actuated_joint,
    armax,
    bj,
    coupled_drives,
    hammerstein_wiener,
    output_error,
    process,
    servo_joint,
    state_space,
    wiener_hammerstein,
)

MADE_FOR = {
    "own_blocks": Chain((dynamic("def step(s, x, p):\n    return p.gain * x\n", {"gain": 1.0}),)),
    "predictors": armax(input="saturation"),
    "box_jenkins": bj(),
    "drives": coupled_drives(),
    "servo": servo_joint(),
    "staged_joint": actuated_joint(motor=Motor(load=3, stribeck=True), play=CoastingPlay()),
    "joint": actuated_joint(play=Play()),
    "processes": process(),
    "profile": Chain((ProfiledMotor(knots=3, low=0.0, high=1.0),)),
    "state_space": state_space(),
    "two_filters": wiener_hammerstein(2, 2, 1),
    "single_linear": hammerstein_wiener(2, 2, 1),
}


def record(N=200, nu=1):
    u = np.repeat(np.random.default_rng(8).uniform(-1.0, 1.0, (N // 5, nu)), 5, axis=0)
    return IOData(u, 0.05 * np.cumsum(u, axis=0) + 0.3 * np.roll(u, 1, axis=0), 0.1)


@pytest.mark.parametrize("name", list(TABLE))
def test_the_first_start_of_the_table_that_applies_is_the_one_that_is_made_for_a_chain(name):
    assert next(n for n, start in TABLE.items() if start.applies(MADE_FOR[name])) == name


@pytest.mark.parametrize("name", ["profile", "two_filters"])
def test_start_k_is_the_same_however_many_are_asked_for(name):
    chain, data = MADE_FOR[name], record()
    few, many = starts(chain, data, 3, 4), starts(chain, data, 5, 4)
    assert len(many) == 5
    np.testing.assert_array_equal(few, many[:3])


@pytest.mark.parametrize(
    "motor", [{"stribeck": True}, {"stribeck": True, "sided": True}, {"loss": True, "load": 3}, {"jams": True}]
)
def test_frictions_of_a_motor_that_cannot_sag_start_within_their_bounds(motor):
    """A motor in a voltage's terms has no supply that sags; a servo's has."""
    chain = actuated_joint(motor=Motor(**motor), play=CoastingPlay())
    points = np.array(starts(chain, record(), 2, 0))
    low, high = chain.limits
    assert points.shape == (2, len(chain.names))
    assert np.all((points >= low) & (points <= high))


def test_every_start_keeps_what_is_held_and_stays_within_bounds():
    chain = output_error(2, 2, 1, fixed={"linear.b0": 7.0}, bounds={"linear.f1": (-0.2, 0.1), "linear.b1": (3.0, 4.0)})
    points = dict(zip(chain.names, np.transpose(starts(chain, record(), 4, 0)), strict=True))
    assert set(points["linear.b0"]) == {7.0}
    assert np.all((points["linear.f1"] >= -0.2) & (points["linear.f1"] <= 0.1))
    assert np.all((points["linear.b1"] >= 3.0) & (points["linear.b1"] <= 4.0))


def test_a_chain_of_no_known_kind_asks_for_a_start_of_its_own():
    several = Chain(tuple(TransferFunction(1, 1, 1, role=role) for role in "abc"))
    for chain in (several, Chain((LimitedIntegrator(),))):
        with pytest.raises(InputError, match="no automatic start; give fit"):
            starts(chain, record(), 1, 0)


def test_a_search_without_agreement_speaks_of_the_starts_that_were_given():
    """Of 20 starts the five that differ were searched to the end: "one of 5 starts" would be another search."""

    def said(starts: int | str, searched: int = 5, agreed: int = 1) -> tuple[str, ...]:
        return without_agreement(
            cast(SearchResult, SimpleNamespace(members=("drawn",) * searched, agreed=agreed)), starts
        )

    assert said(20)[0].startswith("of 20 starts 5 were searched to the end, and only one came to this loss")
    assert said("auto")[0].startswith("5 starts were searched, and only one")
    assert said(20, agreed=2) == said(1, searched=1) == ()


def result(e: np.ndarray, agreed: int) -> SearchResult:
    """A search that ended with these residuals, on which so many starts agreed."""
    problem = SimpleNamespace(plain=SimpleNamespace(residual=lambda p: e), thetas=lambda p: np.zeros((1, 1)))
    outcome = SimpleNamespace(p=np.zeros(1), cost=1.0)
    return SearchResult(cast(Any, problem), cast(Any, outcome), (), (), agreed)


@pytest.mark.parametrize(
    ("memory", "agreed", "rounds"),
    [
        (0.0, [2, 3], 1),
        (0.0, [1, 1, 1, 1, 2, 3], 5),  # a wrong optimum of 28 times the noise was given up after three
        (0.8, [2, 2, 3, 4], 3),  # two had agreed on one of 46 times the noise, whose errors remember
        (-0.8, [2, 2, 3, 4], 3),  # and those that swing, on one of 3100 times
        (0.2, [2, 3], 1),  # tells itself 4 % of its variance
        (0.8, [1] * 20, 6),
    ],
)
def test_rounds_go_on_until_enough_starts_agree_for_errors_like_these(monkeypatch, memory, agreed, rounds):
    e = lfilter([1.0], [1.0, -memory], np.random.default_rng(0).standard_normal(2000))
    turns = iter(agreed)
    monkeypatch.setattr(search, "starting_points", lambda *given: [object()])
    monkeypatch.setattr(search, "_search_round", lambda *given: result(e, next(turns)))
    context = SearchContext(output_error(1, 1, 0), record(), Objective(), "lm", Options().begun(), None)
    assert search.search_portfolio(context, 0, None).agreed == agreed[rounds - 1]
    assert len(agreed) - len(list(turns)) == rounds


def test_two_searches_from_one_candidate_do_not_agree():
    """A candidate is searched coarse to fine and with fine curves at once: the same loss of both says nothing."""
    chain = Chain((TransferFunction(1, 0),))
    ends = [Surrogate(chain, np.zeros(1), loss, number=n) for loss, n in [(1.0, 0), (1.001, 0), (1.002, 4), (3.0, 0)]]
    assert [(s.loss, n) for s, n in _distinct_optima(ends)] == [(1.0, 2), (3.0, 1)]
