"""A step test, and a clock without a unit: the ordinary record is fitted as it is, and what is advised can be typed."""

import json
import re
import shlex

import numpy as np
import pytest

import twin.cli

FIT = ("--structure", "output_error", "--orders", "1,1,1", "--starts", "1")


def written(path, at, scale=1.0, header="time,u,y"):
    """A step of 1 at `at` [s] of 8 s, and the answer of a lag of 0.15 s and gain 2."""
    t = np.arange(401) * 0.02
    y = np.where(t >= at, 2.0 * (1.0 - np.exp(-(t - at) / 0.15)), 0.0)
    y += 0.002 * np.random.default_rng(0).standard_normal(401)
    rows = [f"{scale * a:.6g},{int(a >= at - 1e-9)},{b:.6f}" for a, b in zip(t, y, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(*words):
        status = twin.cli.main(list(words))
        captured = capsys.readouterr()
        return status, captured.out + captured.err

    return run


def summary(path):
    found = json.loads((path / "out" / "summary.json").read_text(encoding="utf-8"))
    return found, abs(complex(found["poles"][0]["re"], found["poles"][0]["im"]))


def test_a_step_test_is_fitted_on_all_of_it_and_no_validation_is_claimed(run, tmp_path):
    written(tmp_path / "log.csv", at=1.0)
    status, said = run("identify", "log.csv", *FIT, "--out", "out")
    assert status == 0, said
    found, pole = summary(tmp_path)
    assert pole == pytest.approx(np.exp(-0.02 / 0.15), abs=1e-3)
    assert (found["fit_percent"]["validation"], found["read"]["split"]) == (None, None)
    assert found["fit_percent"]["estimation"] > 99.0
    assert "fit, free run, validation data" not in said
    assert "all of it was used for the fit" in " ".join(said.split())
    assert "not validated" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    # The next step that is named: another record for the validation.
    written(tmp_path / "second.csv", at=2.0)
    status, said = run("identify", "log.csv", "--validation", "second.csv", *FIT, "--out", "second")
    assert status == 0, said


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--split", "0.2", *FIT), "leave --split out"),
        (("--structure", "auto"), "name a structure, such as --structure output_error"),
    ],
)
def test_what_a_step_test_cannot_give_is_refused_with_what_to_do(run, tmp_path, options, sentence):
    written(tmp_path / "log.csv", at=1.0)
    status, said = run("identify", "log.csv", *options, "--out", "out")
    assert status != 0
    assert sentence in " ".join(said.split())


def test_the_advice_on_a_clock_without_a_unit_can_be_typed(run, tmp_path):
    written(tmp_path / "log.csv", at=1.0, scale=100.0, header="t,u,y")
    status, said = run("identify", "log.csv", *FIT, "--out", "out")
    assert status != 0
    advice = re.search(r"--time 't' --time-unit \w+", " ".join(said.split()))
    assert advice, said
    status, said = run("identify", "log.csv", *FIT, *shlex.split(advice[0]), "--out", "out")
    assert status == 0, said
