"""A user's own block with a memory, ten lines: recovered from a bad start, written out, saved, and honest at rest."""

import json

import numpy as np
import pytest
from exported import agrees, c_run, made, python_run

import sysid
from sysid.base.errors import InputError
from sysid.blocks import Polynomial, TransferFunction, dynamic
from sysid.model.chain import Chain


def begin(s, x, p):
    s.level = p.y0


def step(s, x, p):
    y = s.level
    change = p.speed * (p.gain * x - y)
    s.level += min(max(change, -p.fall), p.rise)
    return y


BLOCK = dynamic(
    step,
    {"gain": 1.0, "speed": 0.8, "rise": 0.2, "fall": 0.1, "y0": 0.0},
    begin=begin,
    bounds={"speed": (0.0, 1.0), "rise": (0.0, np.inf), "fall": (0.0, np.inf)},
    initial=("y0",),
    span=(-3.0, 3.0),
    role="lag",
)
TRUE = np.array([2.5, 0.25, 0.6, 0.35, 0.4])


def record(N=1500, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2.0, 2.0, N // 12), 12)[:N] + 0.2 * rng.normal(size=N)
    y = Chain((BLOCK,)).simulate(TRUE, u)
    return sysid.IOData(u, y + noise * rng.normal(size=N), 0.1)


def run(step, begin, p, u):
    """The two functions themselves, run by Python sample by sample."""

    class Names:
        pass

    s, own = Names(), Names()
    vars(own).update(p)
    begin(s, u[0], own)
    return np.array([step(s, x, own) for x in u])


def test_the_compiled_block_is_the_step_itself():
    u = record().u[:, 0]
    names = ("gain", "speed", "rise", "fall", "y0")
    expected = run(step, begin, dict(zip(names, TRUE, strict=True)), u.tolist())
    np.testing.assert_allclose(Chain((BLOCK,)).simulate(TRUE, u), expected, rtol=0, atol=1e-13)


def test_its_true_parameters_come_back_from_a_bad_start():
    """All four constants start at a factor of two to four off, the limits where they show: one that nothing reaches
    has no derivative."""
    fit = sysid.fit(Chain((BLOCK,)), record(noise=0.01), search="lm", start=np.array(BLOCK.first))
    values = fit.theta
    np.testing.assert_allclose(values[:4], TRUE[:4], rtol=0.01)
    for found, true in zip(fit.parameters, TRUE, strict=True):
        assert found.std is not None
        assert abs(found.value - true) < 4.0 * found.std


def test_intervals_have_the_size_of_the_scatter():
    """Standard deviations that a fit reports against the scatter of 40 fits to fresh noise."""
    chain = Chain((BLOCK,))
    fits = [sysid.fit(chain, record(600, 0.05, seed), search="lm", start=TRUE) for seed in range(40)]
    scatter = np.std([f.theta[:4] for f in fits], axis=0)
    reported = np.mean([[p.std for p in f.parameters[:4]] for f in fits], axis=0)
    assert np.all(reported / scatter > 0.6)
    assert np.all(reported / scatter < 1.6)


def test_c_and_python_files_agree_with_its_run(tmp_path):
    fit, u = made(Chain((BLOCK,)), TRUE), record().u[:, 0]
    agrees(python_run(fit, u), fit.simulate(u))
    agrees(c_run(fit, u, tmp_path), fit.simulate(u))


def test_a_saved_fit_of_it_is_the_same_model_again(tmp_path):
    fit = made(Chain((BLOCK, TransferFunction(1, 1, 1, role="sensor"))), np.concatenate([TRUE, [0.3, -0.7, 0.0]]))
    again = sysid.load(fit.save(tmp_path / "fit.json"))
    u = record().u[:, 0]
    np.testing.assert_array_equal(again.simulate(u), fit.simulate(u))
    assert again.model == fit.model


def test_a_saved_step_is_read_and_never_run(tmp_path):
    """A file that somebody has put other text into is refused with the line, before any of it could act."""
    path = made(Chain((BLOCK,)), TRUE).save(tmp_path / "fit.json")
    document = json.loads(path.read_text(encoding="utf-8"))
    block = document["model"]["blocks"][0]
    mark = tmp_path / "ran"
    for bad in (
        f"open({str(mark)!r}, 'w')\n" + block["text"],
        block["text"].replace("    y = s.level", f"    open({str(mark)!r}, 'w')\n    y = s.level"),
        block["text"].replace("s.level = p.y0", f"s.level = __import__('os').system('touch {mark}')"),
    ):
        assert bad != block["text"]
        path.write_text(json.dumps({**document, "model": {**document["model"], "blocks": [{**block, "text": bad}]}}))
        with pytest.raises(InputError, match="line "):
            sysid.load(path)
    assert not mark.exists()


def test_a_block_that_holds_rests_where_the_fit_has_it():
    """Hysteresis keeps its place between records, a lag's level begins at zero; neither is named in a list."""

    options = {"bounds": {"width": (0.0, np.inf)}, "initial": ("place0",)}
    text = "def begin(s, x, p):\n    s.place = p.place0\n\ndef step(s, x, p):\n"
    text += "    s.place = min(max(s.place, x - p.width), x + p.width)\n    return s.place\n"
    for holds, expected in ((("place0",), 0.7), ((), 0.0)):
        block = dynamic(text, {"width": 1.0, "place0": 0.0}, holds=holds, **options)
        fit = made(Chain((block,)), [1.0, 0.7])
        assert fit.simulate(np.zeros(3))[0] == expected


def test_a_state_that_blows_up_does_not_kill_the_search():
    """x grows without end for a > 1: trials beyond lose, and the search comes back to the truth."""
    text = "def step(s, x, p):\n    y = s.x\n    s.x = p.a * y + p.b * x + p.c * y * y * y\n    return y\n"
    block = dynamic(text, {"a": 1.4, "b": 0.3, "c": 0.5})
    u = np.random.default_rng(3).normal(size=600)
    chain = Chain((block,))
    with np.errstate(all="ignore"):
        assert not np.all(np.isfinite(chain.simulate(np.array([1.4, 0.3, 0.5]), u)))
    data = sysid.IOData(u, chain.simulate(np.array([0.7, 0.5, -0.05]), u), 0.1)
    fit = sysid.fit(chain, data, search="lm", start=np.array([0.2, 1.5, 0.0]))
    np.testing.assert_allclose(fit.theta, [0.7, 0.5, -0.05], atol=1e-6)


def test_a_gain_that_a_neighbour_could_take_over_is_found():
    """A lag's gain and the scale of the map behind it are one number."""
    behind = Polynomial(degree=1, role="map")
    text = "def step(s, x, p):\n    y = s.x\n    s.x += p.speed * (p.gain * x - y)\n    return y\n"
    block = dynamic(text, {"gain": 1.0, "speed": 0.5}, bounds={"speed": (0.0, 1.0)})
    chain = Chain((block, behind))
    theta = np.array([1.3, 0.4, 0.9, -0.1])
    G = chain.gauge(theta)
    _, J = chain.tangent(theta, record().u[:, 0])
    s = np.linalg.svd(J / np.linalg.norm(J, axis=0), compute_uv=False)
    assert G.shape[1] == 4 - np.sum(s > 1e-8 * s[0]) == 1
    assert np.abs(J @ G).max() < 1e-9 * np.abs(J).max()


def test_it_starts_by_itself_and_comes_back_with_a_map_behind_it():
    """Several starts around the values that `dynamic` was given: the same optimum as from the truth."""
    chain = Chain((BLOCK, Polynomial(2, role="map")), fixed={"map.c1": 0.1, "map.c2": 1.0, "map.c3": 0.0})
    data = record(600, noise=0.01)
    y = chain.simulate(np.concatenate([TRUE, [0.1, 1.0, 0.0]]), data.u[:, 0])
    data = sysid.IOData(data.u, y + 0.01 * np.random.default_rng(1).normal(size=(600,)), 0.1)
    fit = sysid.fit(chain, data, starts=5)
    np.testing.assert_allclose(fit.theta[:5], TRUE, atol=0.05)
