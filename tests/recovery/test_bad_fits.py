"""Records that no search can use: a sentence or a warning, never a silent nan, never a hang."""

import numpy as np
import pytest

import sysid

HW = sysid.structures.hammerstein_wiener


def record(N=400, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=N)
    return u, np.convolve(u, [0, 0.5, 0.3])[:N] + 0.01 * rng.normal(size=N)


def test_constant_signals():
    u, y = record()
    with pytest.raises(sysid.InputError, match="input is constant"):
        sysid.fit(HW(), sysid.IOData(np.ones(400), y, 1.0))
    with pytest.raises(sysid.InputError, match="output is constant"):
        sysid.fit(HW(), sysid.IOData(u, np.ones(400), 1.0))


def test_too_short_for_the_orders():
    u, y = record(30)
    with pytest.raises(sysid.InputError, match="30 samples are too few"):
        sysid.fit(HW(), sysid.IOData(u, y, 1.0))
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(u, y, 1.0))
    with pytest.raises(sysid.InputError, match="give a longer one"):
        fit.fit_percent(sysid.IOData(u[:4], y[:4], 1.0), n_init=7)


def test_a_two_level_input_names_what_it_cannot_tell():
    rng = np.random.default_rng(1)
    u = np.sign(rng.normal(size=600))
    y = np.convolve(u, [0, 0.5, 0.3])[:600] + 0.01 * rng.normal(size=600)
    fit = sysid.fit(HW(2, 2, 1), sysid.IOData(u, y, 1.0), starts=1)
    assert np.all(np.isfinite(fit.theta))
    assert any("do not determine" in w and "parameters of input" in w for w in fit.warnings)
    assert any(p.std is None for p in fit.parameters)


def test_several_channels_and_other_rates_are_refused():
    u, y = record()
    with pytest.raises(sysid.InputError, match=r"2 input\(s\) and 1 output"):
        sysid.fit(HW(), sysid.IOData(np.column_stack([u, u]), y, 1.0))
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(u, y, 1.0))
    with pytest.raises(sysid.InputError, match="resample"):
        fit.simulate(sysid.IOData(u, y, 0.5))


def test_huge_and_tiny_units_change_nothing_but_the_unit():
    """A fit in other units is the same fit: poles agree, the fit in % agrees."""
    u, y = record()
    plain = sysid.fit(HW(2, 2, 1), sysid.IOData(u, y, 1.0), starts=1, search="lm")
    scaled = sysid.fit(HW(2, 2, 1), sysid.IOData(1e6 * u, 1e-6 * y, 1.0), starts=1, search="lm")
    data = sysid.IOData(u, y, 1.0)
    assert scaled.fit_percent(sysid.IOData(1e6 * u, 1e-6 * y, 1.0)) == pytest.approx(plain.fit_percent(data), abs=0.05)


def test_an_unknown_search_and_too_few_starts():
    u, y = record()
    with pytest.raises(sysid.InputError, match="gna, gradient, lm"):
        sysid.fit(HW(), sysid.IOData(u, y, 1.0), search="newton")
    with pytest.raises(sysid.InputError, match="at least 1"):
        sysid.fit(HW(), sysid.IOData(u, y, 1.0), starts=0)


def test_a_fixed_parameter_keeps_its_value_and_a_bound_holds():
    rng = np.random.default_rng(5)
    u = rng.normal(size=2000)
    y = np.zeros(2000)
    for t in range(1, 2000):
        y[t] = 0.9 * y[t - 1] + 0.5 * u[t - 1]
    recipe, data = sysid.structures.output_error, sysid.IOData(u, y, 1.0)
    held = sysid.fit(recipe(1, 1, 1, fixed={"linear.f1": -0.8}), data)
    assert held.poles[0] == pytest.approx(0.8, abs=1e-12)
    assert [p.free for p in held.parameters if p.name == "linear.f1"] == [False]
    bounded = sysid.fit(recipe(1, 1, 1, bounds={"linear.b0": (-1.0, 0.4)}), data)
    assert bounded.theta[0] == pytest.approx(0.4, abs=1e-9)  # the optimum 0.5 lies beyond it
    block = sysid.fit(recipe(1, 1, 1, fixed={"linear": [0.5, -0.9]}), data)
    np.testing.assert_array_equal(block.theta[:2], [0.5, -0.9])
    assert block.criteria.d == 1  # the initial state alone
    with pytest.raises(sysid.InputError, match="2 parameters and is fixed at 1"):
        recipe(1, 1, 1, fixed={"linear": [0.5]})
    with pytest.raises(sysid.InputError, match="one finite number"):
        recipe(1, 1, 1, fixed={"linear.f1": np.nan})


def awkward():
    """Records that say little or nothing, by name: u, y (N,)."""
    rng = np.random.default_rng(7)
    u, y = record()
    n = np.arange(400)
    impulse = np.eye(1, 400, 5)[0]
    return {
        "one impulse": (impulse, np.convolve(impulse, 0.9**n)[:400]),
        "one step": (1.0 * (n > 200), np.where(n > 200, 1 - 0.9 ** (n - 200.0), 0.0)),
        "huge": (1e150 * u, 1e150 * y),
        "tiny": (1e-150 * u, 1e-150 * y),
        "no dynamics": (u, u),
        "no relation": (u, rng.normal(size=400)),
        "double drift": (u, np.cumsum(np.cumsum(rng.normal(size=400)))),
        "exploding": (u, np.exp(0.5 * n)),
        "integers": (rng.integers(-3, 4, 400), rng.integers(0, 5, 400)),
        "strided": (np.repeat(u, 2)[::2], np.repeat(y, 3)[::3]),
    }


MAPS = {"hats": ("piecewise_linear", "piecewise_linear"), "curves": ("saturation", "sigmoid_network")}


@pytest.mark.parametrize(
    ("maps", "name"),
    [
        # By day each record once: with one kind of maps or the other.
        pytest.param(maps, name, marks=[pytest.mark.nightly] * ((k + each) % 2))
        for each, maps in enumerate(("curves", "hats"))
        for k, name in enumerate(awkward())
    ],
)
def test_awkward_records_end_with_finite_numbers_and_a_reason(name, maps):
    fit = sysid.fit(HW(2, 2, 1, *MAPS[maps]), sysid.IOData(*awkward()[name], 1.0), starts=2)
    assert np.all(np.isfinite(fit.theta))
    assert np.isfinite(fit.criteria.loss)
    assert fit.stop.reason
    if not fit.stop.converged:
        assert any("did not converge" in w for w in fit.warnings)


def test_an_unstable_start_and_one_of_the_wrong_length_are_refused():
    u, y = record()
    unstable = np.array([1.0, 0.5, -2.5, 1.6, 0.0, 0.0])
    with pytest.raises(sysid.InputError, match="not a valid model"):
        sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(u, y, 1.0), start=unstable)
    with pytest.raises(sysid.InputError, match="6 finite values"):
        sysid.fit(sysid.structures.output_error(2, 2, 1), sysid.IOData(u, y, 1.0), start=unstable[:4])
