"""Names of a thousand parts, links to themselves, a home and a disk that take nothing, and signals of 1e90."""

import errno
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.base.files import DEEPEST, toml_values
from sysid.blocks import Polynomial, Saturation, TransferFunction
from sysid.channels.mapping_file import read_map
from sysid.diagnosis.residuals import residual_tests
from sysid.structures import TABLE
from sysid.workflow.identification import _check_once
from twin import parameter_file
from twin.app.session import Session
from twin.cli import results
from twin.cli.output import run_folder
from twin.rig import calibration

DEEP = {
    "a name": ".".join(["a"] * 20_000) + " = 1\n",
    "a table": "[" + ".".join(["a"] * 20_000) + "]\n",
    "spaces": " . ".join(["a"] * 9_000) + " = 1\n",
    "quotes": ".".join(['"a b"', "'c.d'"] * 9_000) + " = 1\n",
    "lists": "a = " + "[" * 20_000 + "]" * 20_000 + "\n",
}


@pytest.mark.parametrize("read", [read_map, parameter_file.read, calibration.read], ids=["map", "parameters", "rig"])
@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP)
def test_a_name_of_thousands_of_parts_is_a_sentence_at_once(tmp_path, read, text):
    """tomllib takes 5 s for 20,000 parts, and an hour for half a million."""
    (tmp_path / "x.toml").write_text(text)
    begin = time.process_time()
    with pytest.raises(InputError, match=r"x\.toml"):
        read(tmp_path / "x.toml")
    assert time.process_time() - begin < 1.0


def test_names_of_usual_depth_and_numbers_and_texts_are_read():
    name = ".".join(["a"] * DEEPEST)
    assert toml_values(f'{name} = 1.5\nb = "x.y"\nc = [1.0, 2.0]')["b"] == "x.y"
    for text in ("a" * 10**6, '"' * 10**5, "a." * (DEEPEST - 1) * 10**4):  # no time is lost on what has no end
        begin = time.process_time()
        with pytest.raises((ValueError, RecursionError)):
            toml_values(text)
        assert time.process_time() - begin < 5.0


def test_a_link_to_itself_is_a_sentence_wherever_it_is_given(tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    _check_once([loop], [])  # the reader says it
    with pytest.raises(InputError, match="given twice"):
        _check_once([loop], [loop])
    with pytest.raises(InputError, match="cannot be a session"):
        Session.open(loop)


def test_what_stands_is_told_where_the_folder_cannot_be_put_into_its_place(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    results.begin()
    monkeypatch.setattr(results, "move", full)
    told = pytest.raises(InputError, match=r"cannot write to .*No space left.*its results are whole, in map\.toml")
    with told, run_folder(str(tmp_path / "out"), "info"):
        results.note_result("map.toml")
    results.begin()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.isdir("/proc"), reason="a folder that takes no file")
def test_a_home_that_cannot_be_written_to_is_no_news(tmp_path):
    program = "from twin.cli.environment import within_reason\nwith within_reason():\n    import matplotlib.pyplot"
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "MPLCONFIG"))}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**variables, "HOME": "/proc/nowhere", "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""


@pytest.mark.parametrize("size", [2.0**300, 2.0**-300])
def test_residual_tests_have_no_unit(size):
    rng = np.random.default_rng(0)
    e, u = rng.standard_normal((2, 400))
    plain, scaled = residual_tests(e, u), residual_tests(e * size, u * size)  # a warning is an error here
    for name in ("autocorrelation", "cross_correlation", "independence_bound", "independence_p"):
        np.testing.assert_array_equal(getattr(scaled, name), getattr(plain, name))


@pytest.mark.parametrize("block", [TransferFunction(2, 3, 1), TransferFunction(1, 1, 0), TransferFunction(3, 0, 2)])
def test_a_filter_of_a_lower_input_is_lower_from_the_first_sample(block):
    rng = np.random.default_rng(1)
    theta = np.concatenate([rng.uniform(0.1, 1.0, block.nb), [-0.9, 0.2, -0.05][: block.nf], np.ones(block.n_state)])
    u, level = rng.standard_normal(50), 1e3
    lowered = block.output(block.lowered(theta, level), u - level)
    np.testing.assert_allclose(lowered, block.output(theta, u) - level * block.gain(theta), atol=1e-9)


@pytest.mark.parametrize("level", [0.0, 1e3])
def test_named_maps_are_found_at_any_level_of_the_record(level):
    """A saturation before and a curve behind a lag, also where the record stands at 1000."""
    rng = np.random.default_rng(7)
    u = np.repeat(rng.uniform(-3.0, 3.0, 172), 5)
    y = lfilter([0.0, 0.3], [1.0, -0.7], np.clip(u, -1.0, 1.0))
    y = (np.tanh(y) + 0.1 * rng.standard_normal(860))[60:]
    data = sysid.IOData(u[60:] + level, y + level, 0.1).split(0.5)[0]
    model = TABLE["hammerstein_wiener"]().model_of(data)
    blocks = sysid.fit(model, data, starts=2, seed=0).model.blocks
    assert isinstance(blocks[0], Saturation)
    assert isinstance(blocks[-1], Polynomial)
