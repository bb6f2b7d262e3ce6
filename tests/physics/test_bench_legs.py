"""Scenarios on the leg: the same twice, with a true reading, a true pole, one imperfection at a time, and new legs."""

import pickle

import numpy as np
import pytest
from often import FULL

from sysid.base.errors import InputError
from twin.bench import TABLE
from twin.bench.families import ALONE, KINDS, Joints, Legs, Mismatch, left_out
from twin.hardware.linkage import end_angles
from twin.imperfections import IMPERFECTIONS
from twin.parameters import Parameters

QUICK = [("twin", "thigh-only-dropouts-servo"), ("legs", "thigh-servo"), ("mismatch", "thigh")]
EVERY = [(name, scenario) for name, family in TABLE.items() for scenario in family.scenarios()]


@pytest.mark.slow
@pytest.mark.parametrize(("family", "scenario"), EVERY if FULL else QUICK)
def test_a_task_is_the_same_twice_bit_for_bit_and_another_seed_is_another_one(family, scenario):
    one, again = (f.make(scenario, 3) for f in (TABLE[family], pickle.loads(pickle.dumps(TABLE[family]))))
    for a, b in ((one.train, again.train), (one.tests["test"], again.tests["test"])):
        np.testing.assert_array_equal(a.u, b.u)
        np.testing.assert_array_equal(a.y, b.y)
    np.testing.assert_array_equal(one.truth.y["test"], again.truth.y["test"])
    assert (one.given, one.drop, one.unit, one.orders) == (again.given, again.drop, again.unit, again.orders)
    other = TABLE[family].make(scenario, 4)
    assert not np.array_equal(one.train.u, other.train.u)
    assert not np.array_equal(one.train.u[: len(one.tests["test"].u)], one.tests["test"].u)


def test_the_pole_of_an_ideal_shoulder_is_in_its_record():
    """A shoulder turns about a fixed axis: its record obeys y[k] = (p + 1) y[k-1] - p y[k-2] + b u, to rounding."""
    task = Joints().make("shoulder-ideal", 5)
    u, y = task.train.u[:, 0], task.train.y[:, 0]
    regressors = np.column_stack([y[2:-1], y[1:-2], u[2:-1], u[1:-2], u[:-3]])
    a1, a2, *_ = np.linalg.lstsq(regressors, y[3:], rcond=None)[0]
    lag, integrator = np.sort(np.roots([1.0, -a1, -a2]))
    assert integrator == pytest.approx(1.0, abs=1e-6)
    assert task.truth.poles == pytest.approx([lag], abs=1e-4)
    assert task.truth.noise == 0.0


def test_the_noise_of_a_record_is_that_of_its_parameters():
    """The reading of a test is the record less white noise of the potentiometer's standard deviation."""
    task = Joints().make("shoulder-only-noise", 6)
    sigma, test = Parameters()["pot_noise"], task.tests["test"]
    off = test.y[:, 0] - task.truth.y["test"]
    assert task.truth.noise == pytest.approx(sigma, rel=0.06)  # four standard deviations of 2500 samples
    assert np.std(off) == pytest.approx(sigma, rel=0.09)
    assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 4.0 / np.sqrt(len(off))


def test_one_imperfection_at_a_time_and_all_of_them():
    """Named by hand: what stays in; the end stops hold a joint on its way, and parts of friction need friction."""
    stays = {kind: set(IMPERFECTIONS) - set(left_out(kind)) for kind in KINDS}
    assert stays[""] == set(IMPERFECTIONS)
    assert stays["ideal"] == set()
    assert stays["only-noise"] == {"noise"}
    assert stays["only-backlash"] == {"backlash", "end_stops"}
    assert stays["only-end_stops"] == {"end_stops"}
    assert stays["only-stribeck"] == {"stribeck", "friction", "end_stops"}
    assert all(name in stays[f"only-{name}"] for name in ALONE)
    assert len(Joints().scenarios()) == len(set(Joints().scenarios())) == 3 * 2 * (len(ALONE) + 2)


@pytest.mark.parametrize("joint", ["shoulder", "shank"])
def test_an_ideal_joint_stays_within_its_stroke_without_stops(joint):
    low, high = end_angles(Parameters(), joint)
    task = Joints().make(f"{joint}-ideal", 7)
    for y in (task.train.y, task.tests["test"].y):
        assert low < y.min()
        assert y.max() < high
        assert np.ptp(y) > 0.3 * (high - low)


def test_every_seed_is_another_leg():
    given = {Legs().make("shoulder", seed).given for seed in (0, 1)}
    assert len(given) == 2
    assert all("shoulder.no_load_speed" in text for text in given)


def test_an_unknown_scenario_names_the_known_ones():
    wrong = ((Joints(), "knee"), (Joints(), "thigh-only-contact"), (Legs(), "thigh-ideal"), (Mismatch(), "shank-servo"))
    for family, name in wrong:
        with pytest.raises(InputError, match=f"{name}.*thigh"):
            family.make(name, 0)
