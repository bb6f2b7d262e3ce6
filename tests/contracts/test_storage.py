"""Saved fits: the same model bit for bit, readable text, and one sentence for every file that is not one."""

import json
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from hypothesis import given
from hypothesis import strategies as st

import sysid
from sysid import InputError, IOData
from sysid.base.criteria import TABLE as TABLE_OF_CRITERIA
from sysid.base.criteria import Criterion, criteria
from sysid.blocks import TABLE, TransferFunction
from sysid.estimation.codec import VERSION, Step, save
from sysid.estimation.result import Fit
from sysid.estimation.storage import load
from sysid.joint.values import joint_values
from sysid.model.chain import Chain
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Options, Stop

SAVED = {**{k: v for k, v in BLOCKS.items() if k != "custom"}, **VARIANTS, **MOVING}


def same(a, b, where="fit"):
    """Equal to the last bit and of the same types, through every dataclass."""
    if not (isinstance(a, float) and isinstance(b, float)):  # np.float64 comes back as float
        assert type(a) is type(b), where
    if is_dataclass(a):
        for f in fields(a):
            same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        for k in a:
            same(a[k], b[k], f"{where}.{k}")
    elif isinstance(a, (tuple, list)):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}[{k}]")
    elif isinstance(a, float):
        assert a == b or (np.isnan(a) and np.isnan(b)), where
    else:
        assert a == b, where


@pytest.fixture(scope="module")
def searched():
    """A real fit with a fixed and a bounded parameter, and a validation record."""
    rng = np.random.default_rng(1)
    u = rng.uniform(-2, 2, 500)
    y = np.tanh(np.convolve(np.clip(u, -1, 1.2), [0, 0.5, 0.3])[:500]) + 0.01 * rng.normal(size=500)
    blocks = sysid.structures.hammerstein_wiener(2, 2, 1, "saturation", "polynomial").blocks
    chain = Chain(blocks, "hammerstein_wiener", {"output.c1": -0.2}, {"input.upper": (0.5, np.inf)})
    return sysid.fit(chain, IOData(u[:300], y[:300], 0.1), starts=2), IOData(u[300:], y[300:], 0.1)


def test_round_trip_is_the_same_fit_bit_for_bit(searched, tmp_path):
    fit, validation = searched
    back = load(save(fit, tmp_path / "fit.json"))
    same(fit, back)
    np.testing.assert_array_equal(back.simulate(validation), fit.simulate(validation))
    np.testing.assert_array_equal(back.simulate(validation.u), fit.simulate(validation.u))
    assert back.summary() == fit.summary()
    np.testing.assert_array_equal(back.pole_std, fit.pole_std)


def around(block, theta):
    """A fit of this block, before a filter where it has one channel; with numbers that are hard on a text."""
    blocks = (block,)
    if block.channels == (1, 1):
        blocks, theta = (block, TransferFunction(1, 1, 1, role="linear")), np.concatenate([theta, [0.5, -0.5, 0.1]])
    P = len(theta)
    rng = np.random.default_rng(2)
    cov = rng.normal(size=(P, P)) * 10.0 ** rng.integers(-300, 300, (P, P))
    np.fill_diagonal(cov, np.abs(np.diag(cov)))
    return Fit(
        model=Chain(blocks),
        theta=theta,
        Ts=0.1,
        criteria=criteria(1.0, 5, 5),  # FPE and AICc are infinite
        covariance=Covariance(cov, rng.uniform(size=P) < 0.5, 1 / 3),
        stop=Stop('ended; ünïcode "quoted"', False, 7, 9),
        history=({"iteration": 1, "loss": 0.1 + 0.2, "method": "lm", "expected": np.inf},),
        warnings=("a warning",),
        losses=(np.nan, 1e-320),
        seconds=0.5,
        search="lm",
        n_init=8,
    )


@pytest.mark.parametrize("name", sorted(SAVED))
def test_every_block_with_every_option_comes_back(name, tmp_path):
    fit = around(*SAVED[name])
    back = load(save(fit, tmp_path / "fit.json"))
    same(fit, back)
    u = np.random.default_rng(3).uniform(-3, 3, (50, fit.model.channels[0]))
    np.testing.assert_array_equal(back.simulate(u), fit.simulate(u))


def test_an_actuated_joint_comes_back_with_its_physical_values(tmp_path):
    chain = sysid.structures.actuated_joint(driver="dead_zone_saturation", knots=4)
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-6.0, 6.0, 30), 10)
    y = np.clip(np.cumsum(np.where(np.abs(u) > 2.0, 0.02 * u, 0.0)), -1.0, 1.0) + 0.01 * rng.normal(size=300)
    fit = sysid.fit(chain, IOData(u, y, 0.1), starts=1, options=Options(max_iterations=5))
    back = load(save(fit, tmp_path / "fit.json"))
    same(fit, back)
    assert joint_values(back) == joint_values(fit)
    np.testing.assert_array_equal(back.simulate(IOData(u, y, 0.1)), fit.simulate(IOData(u, y, 0.1)))


def test_every_registered_block_is_among_them():
    assert {type(block) for block, _ in SAVED.values()} == set(TABLE.values()) - {TABLE["custom"]}


def test_a_byte_order_mark_of_an_editor_is_no_damage(searched, tmp_path):
    path = save(searched[0], tmp_path / "fit.json")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    same(load(path), searched[0])


def test_a_person_can_read_it(searched, tmp_path):
    """Parameters stand by name, a line each; no line is longer than a row of the covariance."""
    fit, _ = searched
    text = save(fit, tmp_path / "fit.json").read_text()
    document = json.loads(text)
    assert document["version"] == VERSION
    assert document["theta"] == dict(zip(fit.model.names, fit.theta.tolist(), strict=True))
    filter_text = {"kind": "transfer_function", "role": "linear", "nb": 2, "nf": 2, "nk": 1}
    assert document["model"]["blocks"][1].items() >= filter_text.items()
    assert document["model"]["bounds"]["input.upper"] == [0.5, "inf"]
    assert f'  "linear.b0": {float(fit.theta[2])!r}' in text
    assert len(text.splitlines()) < 80 + len(fit.theta) * 2 + len(fit.history)  # not a line a number


def test_a_function_of_one_s_own_is_refused_before_anything_is_written(tmp_path):
    block, theta = BLOCKS["custom"]
    with pytest.raises(InputError, match="cannot store; use a piecewise linear map"):
        save(around(block, theta), tmp_path / "fit.json")
    assert not list(tmp_path.iterdir())


def test_a_failed_save_leaves_the_old_file_and_nothing_else(searched, tmp_path, monkeypatch):
    fit, _ = searched
    path = save(fit, tmp_path / "fit.json")
    before = path.read_text()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InputError, match="No space left on device"):
        save(replace(fit, seconds=99.0), path)
    assert path.read_text() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="folder that exists"):
        save(fit, tmp_path / "nowhere" / "fit.json")


def damaged(path, change):
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


def put(*keys_and_value):
    *keys, last, value = keys_and_value

    def change(document):
        for k in keys:
            document = document[k]
        document[last] = value

    return change


def drop(*keys):
    def change(document):
        *path, last = keys
        for k in path:
            document = document[k]
        del document[last]

    return change


DAMAGES = {
    "newer": (put("version", VERSION + 1), f"newer version of this library .file version {VERSION + 1}, this"),
    "no version": (put("version", "1"), "version is '1'"),
    "other json": (drop("format"), "not a saved fit"),
    "missing field": (drop("covariance"), "covariance is missing"),
    "missing in a field": (drop("criteria", "d"), "criteria: d is missing"),
    "unknown field": (put("colour", 1), "colour is not known to this version"),
    "word for number": (put("Ts", "fast"), "Ts: input should be a valid number"),
    "true for a number": (put("stop", "iterations", True), "iterations: input should be a valid integer"),
    "unknown block": (put("model", "blocks", 0, "kind", "staircase"), "unknown block 'staircase'; choose one of"),
    "impossible orders": (put("model", "blocks", 1, "nb", 0), "nb >= 1"),
    "wrong option": (put("model", "blocks", 1, "na", 2), "na is not known"),
    "parameter missing": (drop("theta", "linear.f2"), r"see linear\.f2"),
    "parameter not finite": (put("theta", "linear.f2", "nan"), "not a valid model"),
    "parameter a word": (put("theta", "linear.f2", "one"), "theta: this list has an entry that is not a number"),
    "unstable": (put("theta", "linear.f2", 3.0), "not a valid model"),
    "covariance cut": (put("covariance", "cov", [[1.0]]), "covariance does not have a row and a column for each"),
    "covariance ragged": (put("covariance", "cov", [[1.0], [1.0, 2.0]]), "rows of this table have different lengths"),
    "fixed without parameter": (put("model", "fixed", {"linear.f9": 0.0}), r"unknown parameter 'linear\.f9'"),
    "negative Ts": (put("Ts", -1.0), "Ts must be above 0"),
    "beside its fixed value": (put("model", "fixed", {"output.c1": 99.0}), r"output\.c1 is -0\.2 and fixed at 99"),
    "bounds exchanged": (put("model", "bounds", {"linear.f2": [9.0, -9.0]}), r"bounds of linear\.f2 are 9 and -9"),
    "negative variance": (put("covariance", "cov", 0, 0, -1.0), "a variance below 0"),
    "negative mse": (
        lambda document: (drop("criteria", "loss")(document), put("criteria", "mse", -1.0)(document)),
        "loss = nan and mse = -1; N is at least 1, none of the others is below 0",
    ),
    "negative noise": (put("covariance", "noise_variance", -1.0), "a variance below 0"),
}  # fmt: skip


def test_a_name_that_stands_twice_is_refused(searched, tmp_path):
    """JSON takes the last of both, so that a line that was left from an edit would decide."""
    path = save(searched[0], tmp_path / "fit.json")
    text = path.read_text()
    path.write_text(text.replace('"Ts": 0.1,', '"Ts": 0.1, "Ts": 0.2,'))
    with pytest.raises(InputError, match="it names 'Ts' twice in one table"):
        load(path)


@pytest.mark.parametrize("name", sorted(DAMAGES))
def test_a_damaged_file_says_what_is_wrong(searched, tmp_path, name):
    change, says = DAMAGES[name]
    path = damaged(save(searched[0], tmp_path / "fit.json"), change)
    with pytest.raises(InputError, match=says) as caught:
        load(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is incomplete or damaged at line 1"),
        (b"\xff\xfe\x00", "not text"),
        (b"[1, 2]", "not a saved fit"),
        (b"NaN", "holds NaN"),
        (b"[" * 100000, "not a fit"),
        (b"null", "not a saved fit"),
        (b'[{"u": 1.0, "y": 2.0}]', r"save\(\) wrote, which this makes of a log: qpal identify .*fit.json$"),
        (b'{"u": [1.0], "y": [2.0]}', r"save\(\) wrote, which this makes of a log: qpal identify .*fit.json$"),
        (b'{"format": "other"}', r"not a saved fit .* save\(\) wrote$"),
    ],
)
def test_a_file_that_never_was_a_fit(tmp_path, content, says):
    path = tmp_path / "fit.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        load(path)


def test_a_path_that_is_no_file(tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(InputError, match="give the path of a saved fit"):
            load(path)


@given(cut=st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_cut_anywhere_is_an_input_error(searched, tmp_path_factory, cut):
    path = save(searched[0], tmp_path_factory.mktemp("cut") / "fit.json")
    whole = path.read_bytes().rstrip()
    path.write_bytes(whole[: int(cut * len(whole))])
    with pytest.raises(InputError):
        load(path)


@given(where=st.floats(0.0, 1.0, exclude_max=True), byte=st.integers(0, 255))
def test_a_flipped_byte_gives_a_fit_or_an_input_error(searched, tmp_path_factory, where, byte):
    path = save(searched[0], tmp_path_factory.mktemp("flip") / "fit.json")
    whole = bytearray(path.read_bytes())
    whole[int(where * len(whole))] = byte
    path.write_bytes(whole)
    try:
        fit = load(path)
    except InputError:
        return
    assert np.all(np.isfinite(fit.simulate(np.ones(5))))


def test_a_field_that_a_file_from_before_lacks_takes_its_default(searched, tmp_path):
    path = damaged(save(searched[0], tmp_path / "fit.json"), drop("u_span"))
    assert load(path).u_span == (0.0, 0.0)


def test_a_file_with_fewer_criteria_or_more_loads(searched, tmp_path, monkeypatch):
    """Both directions: today's file where a criterion was added since, and where one is known no more."""
    fit = searched[0]
    path = save(fit, tmp_path / "fit.json")
    monkeypatch.setitem(TABLE_OF_CRITERIA, "hqic", Criterion(lambda c: c.mse + c.d, "HQIC", "stands for a new one"))
    assert load(path).criteria.as_dict() == {**fit.criteria.as_dict(), "hqic": fit.criteria.mse + fit.criteria.d}
    path = save(load(path), tmp_path / "richer.json")
    assert "hqic" in json.loads(path.read_text())["criteria"]
    monkeypatch.undo()
    same(load(path), fit)
    bare = load(damaged(path, drop("criteria", "mse")))
    assert np.isnan(bare.criteria.fpe)
    assert bare.summary()["criteria"]["bic"] is None
    assert bare.criteria.loss == fit.criteria.loss


def test_a_renamed_kind_option_and_parameter_take_a_line_each(searched, tmp_path, monkeypatch):
    """A file in other words, told from today's by replacing them in its text, loads through one step."""
    fit = searched[0]
    path = save(fit, tmp_path / "fit.json")
    text = path.read_text()
    for new, old in (
        ("transfer_function", "filter"), ('"nk"', '"late"'), ("linear.f", "linear.a"), ("output.c", "output.k"),
        ('"losses"', '"costs"'), ('"structure"', '"recipe"'),
    ):  # fmt: skip
        assert new in text
        text = text.replace(new, old)
    path.write_text(text.replace(f'"version": {VERSION}', '"version": 1'))
    with pytest.raises(InputError):
        load(path)
    step = Step(
        kinds={"filter": "transfer_function"},
        fields={"transfer_function": {"late": "nk"}, "fit": {"costs": "losses"}, "model": {"recipe": "structure"}},
        parameters={
            "transfer_function": {"a1": "f1", "a2": "f2"},
            "polynomial": {f"k{i}": f"c{i}" for i in range(1, 9)},
        },
    )
    monkeypatch.setattr("sysid.estimation.codec.STEPS", (step,))
    same(load(path), fit)


def test_a_block_of_one_s_own_class_is_refused(tmp_path):
    class Mine(TransferFunction):
        pass

    theta = np.array([0.5, -0.5, 0.0])
    with pytest.raises(InputError, match="Mine, not a block of sysid"):
        save(around(Mine(1, 1, 1), theta), tmp_path / "fit.json")
