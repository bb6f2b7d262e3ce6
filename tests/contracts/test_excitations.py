"""Every excitation: within amplitude and band, repeatable by seed, held, about its offset, refusing what it cannot."""

from dataclasses import fields, replace

import numpy as np
import pytest
from cases import EXCITATIONS
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from sysid.excitations import PACES, TABLE, Aprbs, Chirp, Multisine, Prbs, Staircase, Steps, Sweep, excitation

NAMES = sorted(TABLE)
DECLARED = ("seeded", "paces", "travel_less", "travel_more", "least_samples", "centred")


def drawn(make, N=2000, Ts=0.1, seed=1):
    return make.generate(N, Ts, np.random.default_rng(seed))


def test_every_registered_excitation_has_a_case():
    assert set(EXCITATIONS) == set(TABLE)


@pytest.mark.parametrize("name", NAMES)
@given(
    N=st.integers(400, 1000), Ts=st.sampled_from([0.05, 0.1, 0.15]), seed=st.integers(0, 10**6), offset=st.floats(-4, 4)
)
def test_length_bound_and_offset(name, N, Ts, seed, offset):
    make = EXCITATIONS[name]
    u = drawn(make, N, Ts, seed)
    assert u.shape == (N,)
    assert u.dtype == np.float64
    assert np.abs(u).max() <= make.amplitude
    np.testing.assert_allclose(drawn(replace(make, offset=offset), N, Ts, seed), offset + u, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_seed_and_nothing_else_decides(name):
    make = EXCITATIONS[name]
    u = drawn(make)
    assert np.ptp(u) > make.amplitude
    np.testing.assert_array_equal(u, drawn(replace(make)))
    assert np.array_equal(u, drawn(make, seed=2)) != make.seeded


@pytest.mark.parametrize("name", NAMES)
def test_a_class_says_all_that_an_experiment_is_shaped_by(name):
    kind = TABLE[name]
    missing = [each for each in DECLARED if each not in vars(kind)]
    assert not missing, f"{kind.__name__} does not say {', '.join(missing)}; sysid.excitations.Excitation says what"
    known = {field.name for field in fields(kind)}
    make = EXCITATIONS[name]
    named = (*make.travel_less, *make.travel_more, *make.least_samples, *make.centred)
    assert {*named, *(each for pace in kind.paces.values() for each in pace)} <= known
    assert set(kind.paces) == set(PACES)
    # The times among what is turned down are those that have a shortest.
    assert set(make.least_samples) == set(make.travel_less) - {"reach", "amplitude"}


def excursion(make, seed, Ts=0.1):
    """How far an integrator without friction travels from its start in 100 s, as a whole range."""
    return np.ptp(np.cumsum(drawn(make, 1000, Ts, seed)) * Ts)


@pytest.mark.parametrize("name", NAMES)
def test_every_pace_makes_a_signal_and_the_fast_one_reaches_higher_frequencies(name):
    paces = {pace: TABLE[name](amplitude=1.0, **TABLE[name].paces[pace]) for pace in PACES}
    for make in paces.values():
        assert np.ptp(drawn(make)) > 1.0  # 200 s of 0.1 s carry it
    assert paces["fast"].band[1] > 1.5 * paces["slow"].band[1]


@pytest.mark.parametrize("name", NAMES)
def test_what_travels_less_and_more_does(name, seeds):
    """Half of a setting that reduces travel, and twice the times that let it go further; on average over draws."""
    make = TABLE[name](amplitude=1.0, **TABLE[name].paces["slow"])
    whole = np.mean([excursion(make, seed) for seed in seeds])
    for setting in make.travel_less:
        half = {setting: 0.5 * getattr(make, setting) or 0.2 * whole}  # a reach of 0 is none
        assert np.mean([excursion(replace(make, **half), seed) for seed in seeds]) < 0.85 * whole, setting
    if make.travel_more:
        longer = replace(make, **{each: 2 * getattr(make, each) for each in make.travel_more})
        assert np.mean([excursion(longer, seed) for seed in seeds]) > 1.15 * whole


@pytest.mark.parametrize("name", NAMES)
def test_the_shortest_times_can_be_generated(name):
    for setting, least in TABLE[name].least_samples.items():
        u = drawn(replace(EXCITATIONS[name], **{setting: 0.1 * least}))
        assert np.ptp(u) > EXCITATIONS[name].amplitude
        levels = drawn(replace(EXCITATIONS[name], **{setting: 0.1 * (least + 1)}))
        assert not np.array_equal(u, levels)  # the shortest is not a longer one in disguise


@pytest.mark.parametrize("name", [name for name in NAMES if TABLE[name].centred])
def test_a_centred_signal_keeps_an_integrator_about_its_start(name):
    """As far up as down, which it does not do as it is by default."""

    def lean(options):
        total = np.cumsum(drawn(TABLE[name](amplitude=1.0, **{**TABLE[name].paces["slow"], **options}), 3200))
        return abs(total.max() + total.min()) / np.ptp(total)

    assert lean(TABLE[name].centred) < 0.05
    assert lean({}) > 0.25


@pytest.mark.parametrize("name", NAMES)
def test_amplitude_is_a_pure_scale(name):
    make = EXCITATIONS[name]
    np.testing.assert_allclose(drawn(replace(make, amplitude=2 * make.amplitude)), 2 * drawn(make), rtol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_power_lies_in_the_band(name, seeds):
    make = EXCITATIONS[name]
    low, high = make.band
    for seed in seeds:
        u = drawn(make, seed=seed)
        power = np.abs(np.fft.rfft(u - u.mean())) ** 2
        f = np.fft.rfftfreq(len(u), 0.1)
        assert power[(low - 1e-9 <= f) & (f <= high + 1e-9)].sum() > 0.9 * power.sum()


@pytest.mark.parametrize("name", NAMES)
def test_mean_is_the_offset(name, seeds):
    make = replace(EXCITATIONS[name], offset=1.5)
    # Random levels: a standard error of amplitude / sqrt(3 levels), of which 200 s hold about 167 (aprbs) and 50
    # (steps, half of the time); four of them. The others: what a cut last period leaves.
    allowed = {"aprbs": 4 / np.sqrt(3 * 167), "steps": 0.5 * 4 / np.sqrt(3 * 50)}.get(name, 0.03)
    for seed in seeds:
        assert abs(drawn(make, seed=seed).mean() - 1.5) < allowed * make.amplitude


def runs(u):
    """Lengths of constant stretches."""
    edges = np.flatnonzero(np.diff(u)) + 1
    return np.diff(np.concatenate([[0], edges, [len(u)]]))


@pytest.mark.parametrize("Ts", [0.05, 0.1])
@pytest.mark.parametrize(
    ("make", "seconds"),
    [
        (Prbs(hold=0.3), 0.3),
        (Staircase(hold=1.5), 1.5),
        (Staircase(hold=1.5, order="alternating"), 1.5),
        (Steps(hold=0.8, rest=0.8), 0.8),
        (Sweep(half_period=2.0), 2.0),
    ],
    ids=lambda value: type(value).__name__.lower(),
)
def test_levels_change_at_the_clock_alone(make, seconds, Ts):
    u = drawn(make, Ts=Ts)
    assert not np.any((np.flatnonzero(np.diff(u)) + 1) % round(seconds / Ts))


def test_sweep_edges_stand_where_they_should():
    u = Sweep(amplitude=2.0, half_period=0.3).generate(30, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(runs(u), np.full(10, 3))
    half = Sweep(amplitude=2.0, half_period=0.4, first=0.5).generate(30, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(runs(half), [2, *[4] * 7])


def test_jitter_moves_every_edge_within_its_share():
    u = Sweep(amplitude=2.0, half_period=1.0, jitter=0.3).generate(100_000, 0.01, np.random.default_rng(0))
    lengths = runs(u)[1:-1]
    assert lengths.min() >= 69  # 0.7 s less one sample of rounding
    assert lengths.max() <= 131
    assert lengths.mean() == pytest.approx(100, abs=4 * 30 / np.sqrt(3 * len(lengths)))


def test_aprbs_holds_and_levels():
    u = Aprbs(amplitude=1.0, hold_min=0.5, hold_max=2.0).generate(20000, 0.1, np.random.default_rng(4))
    lengths = runs(u)[:-1]
    assert lengths.min() >= 5
    assert lengths.max() <= 20
    levels = u[np.flatnonzero(np.diff(u))]
    # Uniform levels: mean 0 and variance 1/3, within four standard errors of about 1600 levels.
    assert abs(levels.mean()) < 4 * np.sqrt(1 / 3 / len(levels))
    assert abs(levels.var() - 1 / 3) < 4 * np.sqrt(4 / 45 / len(levels))


@pytest.mark.parametrize("make", [Aprbs(amplitude=1.0, reach=2.0), Steps(amplitude=1.0, reach=0.8)])
@pytest.mark.parametrize("dead", [0.0, 0.2])
def test_reach_bounds_the_running_integral(make, dead, seeds):
    for seed in seeds:
        u = drawn(replace(make, dead=dead), 20000, 0.1, seed)
        moving = np.sign(u) * np.maximum(np.abs(u) - dead, 0.0)
        assert np.abs(np.cumsum(moving) * 0.1).max() < make.reach + 1e-9
        levels = np.abs(u[np.flatnonzero(np.diff(u))])
        assert levels.max() > 0.98  # sizes stay as drawn, only signs and holds change


def test_staircase_by_hand():
    u = Staircase(amplitude=3.0, steps=3, hold=0.2).generate(28, 0.1, np.random.default_rng(0))
    np.testing.assert_allclose(u[::2], [0, 1, 2, 3, 2, 1, 0, -1, -2, -3, -2, -1, 0, 1], atol=1e-12)
    np.testing.assert_array_equal(u[::2], u[1::2])
    u = Staircase(amplitude=3.0, steps=3, hold=0.1, order="alternating").generate(12, 0.1, np.random.default_rng(0))
    np.testing.assert_allclose(u, [1, -1, 2, -2, 3, -3, 2, -2, 1, -1, 1, -1], atol=1e-12)


def test_steps_by_hand():
    u = Steps(2.0, hold=0.2, rest=0.3, levels="fixed", offset=1.0).generate(14, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(u, [1, 1, 1, 3, 3, 1, 1, 1, -1, -1, 1, 1, 1, 3])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("sweep", {"half_period": 0.0}), "half period of a sweep is 0.0; give a number above 0"),
        (("sweep", {"jitter": 1.0}), "jitter is 1.0"),
        (("sweep", {"first": 1.5}), "first is 1.5"),
        (("aprbs", {"hold_min": 2.0, "hold_max": 1.0}), "hold_min <= hold_max"),
        (("aprbs", {"reach": -1.0}), "reach of an aprbs is -1.0; give a number of at least 0"),
        (("steps", {"levels": "some"}), "unknown levels of steps 'some'; choose one of random, fixed"),
        (("steps", {"rest": float("nan")}), "rest of steps is nan"),
        (("staircase", {"steps": 2.5}), "steps of a staircase is 2.5; give a whole number"),
        (("staircase", {"order": "spiral"}), "unknown order of a staircase"),
        (("prbs", {"nbits": 40}), "nbits of a prbs is 40; give a whole number from 2 to 20"),
        (("prbs", {"hold": "long"}), "hold of a prbs is 'long'"),
        (("multisine", {"f_min": 2.0, "f_max": 1.0}), "has no band"),
        (("multisine", {"grid": "even"}), "choose one of full, odd, odd_odd, random_odd"),
        (("multisine", {"phases": "zero"}), "unknown phases of a multisine"),
        (("chirp", {"f_min": 0.0}), "f_min of a chirp is 0.0"),
        (("chirp", {"f_min": 1.0, "f_max": 1.0}), "has no band"),
        (("chirp", {"spacing": "octave"}), "choose one of linear, log"),
        (("noise", {}), "unknown excitation 'noise'; choose one of aprbs, chirp"),
    ],
)
def test_bad_settings_say_what_is_allowed(arguments, says):
    name, settings = arguments
    with pytest.raises(InputError, match=says):
        excitation(name, **settings)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("setting", ["amplitude", "offset"])
@pytest.mark.parametrize("value", [float("inf"), "loud", True, None])
def test_amplitude_and_offset_are_numbers(name, setting, value):
    with pytest.raises(InputError, match=f"{setting} of .* is {value!r}"):
        excitation(name, **{setting: value})


@pytest.mark.parametrize("name", NAMES)
def test_settings_are_plain_numbers_and_names(name):
    assert {type(getattr(TABLE[name](), field.name)) for field in fields(TABLE[name])} <= {int, float, str}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (Multisine(f_max=5.0), "f_max of a multisine is 5 Hz, and half the sampling rate is 5 Hz"),
        (Multisine(period=400.0), "a record of 200 s is shorter than one period of the multisine, 400 s"),
        (Multisine(f_min=0.11, f_max=0.14), "no line of the full grid from 0.11 to 0.14 Hz"),
        (Chirp(f_max=6.0), "f_max of a chirp is 6 Hz"),
        (Chirp(period=10.0), "less than one cycle of f_min 0.05 Hz"),
        (Prbs(hold=0.02), "hold of a prbs is 0.02 s, less than one sample of 0.1 s"),
        (Staircase(hold=0.02), "less than one sample"),
        (Steps(rest=0.02), "rest of steps is 0.02 s, less than one sample"),
    ],
)
def test_what_a_record_cannot_carry_is_refused(make, says):
    with pytest.raises(InputError, match=says):
        drawn(make)
