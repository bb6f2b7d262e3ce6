"""docs/identify.md: its records are made, its commands run and find the plant that the page speaks of."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import sysid
from twin.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "identify.md").read_text(encoding="utf-8")
RECORDS, FREQUENCY, PYTHON = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
COMMANDS = re.findall(r"^qpal (identify .*)$", PAGE, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        exec(RECORDS, {})
        yield made


def test_every_command_runs_and_says_what_the_page_says(folder, capsys):
    found = []
    for k, line in enumerate(COMMANDS):
        words = shlex.split(line)
        out = [] if "--out" in words else ["--out", f"run{k}"]
        assert main([*words, *out, "--json"]) == 0, capsys.readouterr().err
        found.append(json.loads(capsys.readouterr().out))
    files, channels, part, known, linear, wiener, held, oven, oven_held, frd, loop, bj = found
    np.testing.assert_allclose(sorted(pole["re"] for pole in files["poles"]), [0.6, 0.9], atol=0.02)
    assert files["read"]["validation"]["file"] == "friday.csv"
    fits = channels["fit_percent"]["outputs"]
    assert set(fits) == {"level", "flow"}
    assert min(value for each in fits.values() for value in each.values()) > 95.0
    np.testing.assert_allclose(sorted(pole["re"] for pole in channels["poles"]), [0.6, 0.6, 0.8, 0.8], atol=0.02)
    assert part["read"]["Ts"] == 0.2
    values = {p["name"]: p["value"] for p in known["parameters"]}
    assert values["linear.f1"] == -1.5
    assert values["linear.f2"] == pytest.approx(0.54, abs=0.01)
    assert wiener["fit_percent"]["estimation"] > 95.0
    assert linear["fit_percent"]["estimation"] < 90.0 < held["fit_percent"]["estimation"]
    values = {v["name"]: v for v in oven["values"]}
    for name, true in (("gain", 2.5), ("time constant T1", 120.0), ("delay", 8.0)):
        assert values[name]["low"] < true < values[name]["high"]
    assert next(v["value"] for v in oven_held["values"] if v["name"] == "delay") == 8.0
    for value, true in zip(frd["values"], (2.0, 3.0, 0.5, 0.7), strict=True):
        assert value["low"] < true < value["high"]
    np.testing.assert_allclose(sorted(pole["re"] for pole in bj["poles"]), [0.6, 0.9], atol=0.02)
    assert loop["poles"][0]["re"] == pytest.approx(1.05, abs=0.01)
    low, high = loop["poles"][0]["intervals"]["real"]
    assert low < 1.05 < high
    assert loop["criteria_of"] == "one step ahead"
    assert loop["fit_percent"]["validation"] < loop["one_step_fit_percent"]["ahead"]["fit"]
    for folder_of, summary in (("run1", channels), ("linear", linear)):  # the model tells the fit that was printed
        assert sysid.load(f"{folder_of}/model.json").origin.fit == summary["fit_percent"]["estimation"]
    filters = [[p["value"] for p in each["parameters"][:4]] for each in (linear, held)]
    assert filters[0] == filters[1]


def test_the_python_does_the_same(folder, capsys):
    exec(PYTHON, {})
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 4
    assert said[0] == "data = sysid.data.preparation.between(data, 1.0, 20.0)"


def test_a_frequency_response_is_fitted_in_python_too(folder, capsys):
    names = {}
    exec(FREQUENCY, names)
    assert "60 frequencies, 0.01 to 10 rad/s" in capsys.readouterr().out
    assert sysid.load("model.json").theta == pytest.approx(names["result"].fit.theta)
