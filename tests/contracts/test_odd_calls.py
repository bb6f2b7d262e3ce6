"""Public calls with odd values: a sentence, or a result of finite numbers; `scripts/attack/calls.py` has them all."""

import inspect
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import sysid
import twin
from sysid import InputError
from sysid.base.checks import checked, short_text
from sysid.base.kinds import Span
from sysid.base.limits import BY_NAME
from sysid.selection.space import Space
from sysid.structures import hammerstein, output_error
from sysid.uncertainty.information import information
from twin.pendulum import Pendulum, respond


def record(n: int = 200) -> sysid.IOData:
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, n // 5), 5)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + 0.4 * u[k - 1]
    return sysid.IOData(u, y + 0.01 * rng.standard_normal(n), Ts=0.1)


DATA = record()
MODEL = output_error(1, 1, 1)
N = DATA.N
LOG = twin.Log(DATA.u[:, 0], DATA.y[:, 0], 0.1, joint="thigh")
INFO = information(sysid.fit(MODEL, DATA, starts=1), DATA)


class Refuses:
    """An array of another library that raises an error of its own, as a tensor that records gradients does."""

    def __array__(self, *_, **__):
        raise RuntimeError("call detach() first")


ODD = {
    "fit of a text": (lambda: sysid.fit(MODEL, "log.csv"), "data is 'log.csv'; give an IOData"),
    "fit of None": (lambda: sysid.fit(None, DATA), "model is None; give a Chain or a"),
    "seed below 0": (lambda: sysid.fit(MODEL, DATA, seed=-1), "seed is -1; give a whole number of at least 0"),
    "seed of a half": (lambda: sysid.fit(MODEL, DATA, seed=0.5), "seed is 0.5; give a whole number"),
    "seed of 1e30": (lambda: sysid.fit(MODEL, DATA, seed=10**30), "seed is 10+; give a whole number up to 9,2"),
    "starts of 1e9": (lambda: sysid.fit(MODEL, DATA, starts=10**9), "starts is 10+; give a whole number up to 100,000"),
    "options of a dict": (lambda: sysid.fit(MODEL, DATA, options={}), "options is {}; give an Options or None"),
    "iterations of nan": (lambda: sysid.Options(max_iterations=float("nan")), "max_iterations is nan"),
    "seconds of nan": (lambda: sysid.Options(max_seconds=float("nan")), "max_seconds is nan; give a finite number"),
    "folds of a text": (lambda: sysid.cross_validate(MODEL, DATA, folds="5"), "folds is '5'; give a whole number"),
    "knots of 1e9": (lambda: hammerstein(input=sysid.blocks.PiecewiseLinear(knots=10**9)), "up to 10,000"),
    "nb of 1e9": (lambda: output_error(nb=10**9), "nb is 10+; give a (whole )?number up to 1,000"),
    "nk of 1e9": (lambda: output_error(nk=10**9), "nk is 10+; give a (whole )?number up to 100,000"),
    "complex residuals": (lambda: sysid.residual_tests(np.ones(N) * 1j, DATA.u), "e is an array of .*real numbers"),
    "residuals of nan": (lambda: sysid.residual_tests(np.full(N, np.nan), DATA.u), "entry 0, from 0, is nan"),
    "objects": (lambda: sysid.residual_tests(np.array([None] * N), DATA.u), "give an array of real numbers"),
    "dates": (lambda: sysid.residual_tests(np.arange(N).astype("datetime64[s]"), DATA.u), "array of real numbers"),
    "masked": (lambda: sysid.residual_tests(np.ma.masked_less(np.arange(N), 3), DATA.u), "without masked values"),
    "a foreign array that refuses": (
        lambda: sysid.residual_tests(Refuses(), DATA.u),
        "e is a Refuses; give an array of numbers",
    ),
    "ragged": (lambda: sysid.residual_tests([[1.0], [2.0, 3.0]], DATA.u), "e is .*rows of one length"),
    "empty path": (lambda: sysid.load(""), "path is ''; give the path of a file"),
    "path of code 0": (lambda: sysid.read("a\0b.csv"), "give the path of a file"),
    "path of a number": (lambda: sysid.read(3), "path is 3; give the path of a file"),
    "joint of a list": (lambda: twin.truth(["thigh"]), r"joint is \['thigh'\]; give a text"),
    "parameters of a dict": (lambda: twin.truth("thigh", parameters={}), "parameters is {}; give a Parameters or None"),
    "level of -1": (
        lambda: sysid.residual_tests(DATA.y, DATA.u, level=-1),
        "level is -1; give a probability between 0 and 1",
    ),
    "merged numbers": (lambda: sysid.IOData.merge(1.0), "records is 1.0; give an IOData"),
    "offsets": (lambda: sysid.IOData(DATA.u, DATA.y, 0.1, u_offset=np.ones(3)), r"u_offset is .*give 1 number"),
    "phases of an array": (lambda: sysid.excitations.Multisine(phases=np.empty(0)), "phases is an array"),
    "masked values": (lambda: sysid.IOData(DATA.u, np.ma.array(DATA.y, mask=DATA.y > 0.0)), "has masked values; give"),
    "volts and millivolts": (
        lambda: sysid.IOData.merge(replace(DATA, u_unit="V"), replace(DATA, u_unit="mV")),
        "record 2 has a signal in mV that the first has in V; convert one",
    ),
    "search of a slice": (lambda: sysid.solver.searches.search(slice(None)), "name is a slice; give a text"),
    "no log": (lambda: twin.compare.compare_log(1.0, 2.0, "thigh", "a"), "log is 1.0; give a Log"),
    "resampled text": (lambda: sysid.data.preprocess.resample("log.csv", 0.2), "data is 'log.csv'; give an IOData"),
    "options of fit_from": (
        lambda: sysid.fit_from(sysid.fit(MODEL, DATA, starts=1), MODEL, DATA, options=3),
        "options is 3; give an Options or None",
    ),
    "seed of a search of structures": (lambda: sysid.select(DATA, seed="1"), "seed is '1'; give a whole number"),
    "orders of nan": (lambda: Space(nb=np.nan), "nb is nan; give a tuple"),
    "an empty space": (lambda: Space(nb=()), "the search space has no nb; name at least one"),
    "a role that is no text": (
        lambda: sysid.Chain((sysid.blocks.DeadZone(role=0.5),)),
        "role is 0.5; give a text",
    ),
    "a role of inf": (lambda: sysid.blocks.Rectifier(role=-np.inf), "role is -inf; give a text"),
    "stops of an array": (
        lambda: sysid.blocks.ServoMotor(stops=np.full(3, np.nan)),
        "stops is an array .*; give True, False or one of",
    ),
    "a run from a type": (lambda: sysid.fit(MODEL, DATA, starts=1).runs(DATA, n_init=int), "n_init is .*; give"),
    "a mass of a table": (lambda: twin.pendulum.pendulum(twin.Parameters(), {}, 0.1), "mass is {}; give a"),
    "an offset of 1e30": (
        lambda: sysid.excitations.Aprbs(offset=10**30),
        r"offset of an aprbs is 1e\+30; give a number up to 1e\+12",
    ),
    "a pendulum of 1e30": (lambda: Pendulum(0.1, -(10**30)), r"length of the pendulum is -1e\+30; give a number of"),
    "starts of pendulums": (
        lambda: respond([Pendulum(0.1, 0.1)], np.zeros(9), 0.02, [0.0, 1.0]),
        "2 starts are given for 1 pendulums; give one for each",
    ),
    "a model that is none": (lambda: twin.compare.compare_model(LOG, "thigh", "fit", "a"), "fit is 'fit'; give a Fit"),
    "an order of a filter": (
        lambda: sysid.data.preprocess.butterworth(DATA, 1.0, order=10**9),
        "order is 1000000000; give a whole number from 1 to 1,000",
    ),
    "missing dates": (
        lambda: sysid.data.preprocess.fill(DATA.y, missing=np.arange(N).astype("datetime64[s]")),
        "missing is an array .*; give True where a sample is missing",
    ),
    "a period of nothing": (lambda: sysid.diagnosis.bla.find_period(np.empty(0)), "does not repeat within 0 samples"),
    "orders in rows of two lengths": (lambda: sysid.structures.wiener(nk=[[1, 2], [3]]), "give one integer or 1 rows"),
    "a run of nothing": (lambda: sysid.plots.close_ups(DATA, []), "run has 0 values over an output of 200"),
    "fits of nothing": (lambda: sysid.plots.fitted(DATA, DATA.y, []), r"fits has 0 values for 1 output\(s\)"),
    "a pole that is not there": (
        lambda: sysid.plots.pole_zero([0.5], zoom=10**9),
        "zoom is 1000000000 and there are 1 poles; give the index of one",
    ),
    "axes that are none": (
        lambda: sysid.plots.pole_zero([0.5], axes=[3]),
        "an entry of axes is a int; give Axes of matplotlib",
    ),
    "an imperfection that is none": (
        lambda: twin.Parameters().switched_off(["a"]),
        "unknown imperfection 'a'; choose one of",
    ),
    "a side as an array": (
        lambda: twin.Follower(LOG, "thigh", pot_side=np.ones(3)),
        "pot_side is an array of shape .*; give a text",
    ),
    "a band of other points": (
        lambda: sysid.uncertainty.intervals.band(INFO, DATA.t, np.ones(3), np.ones((N, len(INFO.theta)))),
        "value has 3 values and gradient 200 rows; give one for each",
    ),
    "Ts of years": (lambda: twin.truth("thigh", Ts=1e9), r"Ts is 1000000000.0 s; give at most 1000 s"),
    "Ts of 1e308": (lambda: twin.truth("thigh", Ts=1e308), "Ts is 1e[+]308; give a number up to 1e[+]12"),
}


@pytest.mark.parametrize(("call", "sentence"), ODD.values(), ids=ODD)
def test_a_value_that_is_not_allowed_is_a_sentence(call, sentence):
    with pytest.raises(InputError, match=sentence):
        call()


def test_what_stands_for_a_number_or_an_array_is_taken():
    import pandas

    few = sysid.Options(max_iterations=np.int64(5))
    plain = sysid.fit(MODEL, DATA, starts=1, seed=1, options=few)
    other = sysid.fit(MODEL, DATA, starts=np.uint8(1), seed=np.int64(1), options=few)
    assert np.array_equal(plain.theta, other.theta)
    e = plain.residuals(DATA)
    u = DATA.u[-len(e) :, 0]
    expected = sysid.residual_tests(e, u, max_lag=10)
    for values in (e.tolist(), tuple(e.ravel()), pandas.Series(e.ravel()), np.ma.masked_array(e)):
        found = sysid.residual_tests(values, u, max_lag=np.int32(10))
        assert np.array_equal(found.autocorrelation, expected.autocorrelation)
    assert DATA.split(Fraction(1, 2))[0].N == N // 2


def test_a_checked_call_looks_as_it_is_written():
    assert sysid.fit.__doc__.startswith("Fit a chain")
    assert str(inspect.signature(sysid.delay)) == str(inspect.signature(inspect.unwrap(sysid.delay)))
    assert list(inspect.signature(sysid.IOData).parameters)[:3] == ["u", "y", "Ts"]
    with pytest.raises(TypeError, match="unexpected keyword argument 'lag'"):
        sysid.delay(DATA, lag=3)


@checked(deferred=("first",))
def divided(first: float, second: float, seed: int = 0, path: "str | Path" = "x", more: tuple[int, ...] = ()) -> object:
    if isinstance(first, int) and first == 0:
        raise InputError("first is 0, which cannot be halved")
    if second == 3.0:
        raise KeyError("a mistake of this function")
    return first / second, seed, path, more


def test_the_function_s_own_sentence_comes_first_and_its_mistakes_stay_visible():
    with pytest.raises(InputError, match="cannot be halved"):
        divided(0, 1.0)
    with pytest.raises(InputError, match="first is 'a'; give a number"):
        divided("a", 1.0)
    with pytest.raises(KeyError, match="a mistake"):
        divided(1.0, 3.0)
    assert divided(1.0, 2.0, more=[np.int8(1), 2]) == (0.5, 0, "x", (1, 2))


@pytest.mark.parametrize("value", [True, 1j, "1", None, [1.0], float("nan"), 10**400, np.array([1.0, 2.0])])
def test_one_number_is_one_real_finite_number(value):
    with pytest.raises(InputError, match=r"^second is .*; give a"):
        divided(1.0, value)


def test_a_value_is_shown_on_one_short_line():
    for value in ("x\n" * 500, 10**5000, np.zeros((3, 4)), object(), dict.fromkeys(range(99))):
        assert len(short_text(value)) < 80
        assert "\n" not in short_text(value)


@pytest.mark.parametrize("span", BY_NAME.values(), ids=BY_NAME)
def test_a_limit_has_a_sentence_for_what_lies_outside(span: Span):
    for value in (span.lowest - 1, span.highest * 2, float("nan")):
        if not span.holds(value):
            assert span.allowed(value, "number").startswith("a ")
    assert not span.holds(float("nan"))
